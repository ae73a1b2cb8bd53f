"""Exported C modules, compiled by the C compiler of this machine and called from Python."""

import ctypes
import functools
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import pytest

from mbd_sim.exports.c_code.model import export_model
from mbd_sim.exports.c_code.module import FLAGS, c_module
from mbd_sim.files.load import load_mechanism
from mbd_sim.integrators.explicit import ADAMS

STRICT = ("-pedantic", "-Wall", "-Wextra", "-Werror")


class CompiledModule:
    """A mechanism as compiled C, with its structures as arrays.

    The bits do not depend on the optimization, which takes most of the time, but some warnings do: only some are `checked`.
    """

    def __init__(self, mechanism, *, checked=False, **options):
        if not shutil.which("gcc"):
            pytest.skip("gcc is not installed")
        self.model = export_model(mechanism, **options)
        self.files, self.name = c_module(self.model), self.model.name
        with tempfile.TemporaryDirectory() as folder:
            for name, text in self.files.items():
                Path(folder, name).write_text(text, encoding="utf-8")
            self.library = Path(folder, f"lib{self.name}.so")
            flags = [*FLAGS.replace("-O3", "-O1" if checked else "-O0").split(), *STRICT, "-shared", "-fPIC"]
            source = str(Path(folder, f"{self.name}.c"))
            subprocess.run(["gcc", *flags, "-o", str(self.library), source, "-lm"], check=True)
            self._loaded = ctypes.CDLL(str(self.library))
            self.symbols = subprocess.run(["nm", "-D", str(self.library)], capture_output=True, text=True, check=True)
        fields = (self.model.states, self.model.inputs, self.model.parameters, self.model.output_variables)
        self.y, self.inputs, self.p, self.out = (np.zeros(max(1, len(variables))) for variables in fields)
        compared = len(self.inputs) + self.model.values.nnz_out(0)
        self.history = np.zeros(ADAMS["adams11"].history_size(len(self.y), compared))
        self.start()

    def start(self):
        self.history[:] = 0.0
        self._loaded[f"{self.name}_start"](*map(address, (self.y, self.inputs, self.p)))

    def assemble(self, given=()):
        """The result of `NAME_assemble`; with the names of `given` states, of `NAME_assemble_given` at the start."""
        arrays = [*map(address, (self.y, self.inputs, self.p))]
        if not given:
            return self._loaded[f"{self.name}_assemble"](*arrays)
        names = [variable.name for variable in (*self.model.states, *self.model.inputs)]
        flags = np.array([name in given for name in names], dtype=np.uint8)
        assert np.sum(flags) == len(given)
        return self._loaded[f"{self.name}_assemble_given"](ctypes.c_double(0.0), *arrays, address(flags))

    def unknown_start(self):
        function = self._loaded[f"{self.name}_unknown_start"]
        function.restype = ctypes.c_char_p
        return (function(address(self.p), None) or b"").decode()

    def step(self, method, index, h):
        function = self._loaded[f"{self.name}_step_{method}"]
        history = (self.history,) if method in ADAMS else ()
        arrays = map(address, (self.y, *history, self.inputs, self.p))
        return function(*arrays, ctypes.c_int64(index), ctypes.c_double(h))

    def outputs(self, time):
        arrays = map(address, (self.y, self.inputs, self.p, self.out))
        self._loaded[f"{self.name}_output"](ctypes.c_double(time), *arrays)
        names = [variable.name for variable in self.model.output_variables]
        return dict(zip(names, self.out.tolist(), strict=True))

    def rates(self, time):
        rates = np.empty_like(self.y)
        arrays = map(address, (self.y, self.inputs, self.p, rates))
        self._loaded[f"{self.name}_rates"](ctypes.c_double(time), *arrays)
        return rates


def address(array):
    return ctypes.c_void_p(array.ctypes.data)


@functools.cache
def compiled(name, **options):
    """A shipped mechanism, at its start; the linkage is checked."""
    return CompiledModule(load_mechanism(name), checked=name == "four_bar", **options)
