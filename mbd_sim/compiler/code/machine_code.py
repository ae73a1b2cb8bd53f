"""IR to machine code in memory, with llvmlite, and what that code uses of the interpreter and of NumPy.

The symbols that it uses have names and addresses. See https://numpy.org/doc/stable/reference/c-api/array.html for
NumPy's table of functions.
"""

from __future__ import annotations

import ctypes
import functools
import itertools
from collections.abc import Sequence
from importlib import import_module

import llvmlite
import llvmlite.binding as llvm
import numpy as np

from mbd_sim.base import disk_cache
from mbd_sim.compiler.code.object_code import compiler_options, target_machine

NONE = "_Py_NoneStruct"
NAMES = (
    "PyTuple_GetItem",
    "PyBytes_AsString",
    "PyLong_AsLongLong",
    "PyErr_Occurred",
    "PyErr_Clear",
    "PyObject_Vectorcall",
    "PyEval_SaveThread",
    "PyEval_RestoreThread",
    "Py_IncRef",
    "PyList_Size",
    "PyList_GetItem",
    "PyTuple_Size",
    "PyFloat_AsDouble",
)

VERSION = 0  # of `PyArray_GetNDArrayCVersion` in NumPy's table of functions
_KNOWN = (0x0100_0009, 0x0200_0000)  # binary interfaces: those of NumPy 1 and 2


@functools.cache
def external_symbols() -> dict[str, int]:
    """The addresses by the names that machine code has for them.

    NumPy's arrays must have their fields where machine code reads them; C modules check the same when imported.

    :raises ImportError: this version of NumPy may place the fields differently.
    """
    version = ctypes.CFUNCTYPE(ctypes.c_uint)(_numpy_functions()[VERSION])()
    if version not in _KNOWN:
        raise ImportError(
            f"NumPy {np.__version__} has the binary interface {version:#x}, which mbd_sim does not know. "
            "Install an older NumPy: pip install 'numpy<3'."
        )
    functions = {name: ctypes.cast(getattr(ctypes.pythonapi, name), ctypes.c_void_p).value or 0 for name in NAMES}
    return {**functions, NONE: id(None)}


def _numpy_functions() -> ctypes.Array[ctypes.c_size_t]:
    """The beginning of NumPy's table of functions."""
    core = "numpy._core" if np.lib.NumpyVersion(np.__version__) >= "2.0.0" else "numpy.core"
    capsule = import_module(f"{core}._multiarray_umath")._ARRAY_API
    pointer = ctypes.pythonapi.PyCapsule_GetPointer
    pointer.restype, pointer.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    return (ctypes.c_size_t * (VERSION + 1)).from_address(pointer(capsule, None))


# Of LLVM's code generator. At level 0, which also has loops and calls in place of unrolled and inlined code, small
# mechanisms compile in a tenth of the time, to slower code with the same results.
LEVEL = 1
_NUMBERS = itertools.count()  # of libraries, whose names cannot be used again


class MachineCode:
    """Compiled functions, which live as long as this object; `key` has those of their object code in the cache."""

    def __init__(self, library: llvm.ResourceTracker, linker: llvm.LLJIT, key: str) -> None:
        self.key, self._name = key, library.name
        self._linker, self._in_use = linker, [library]

    def address(self, name: str) -> int:
        """The address of a function."""
        found = self._linker.lookup(self._name, name)
        self._in_use.append(found)  # without it, all functions of the library would be unloaded
        return int(found[name])


def compiler_identity() -> tuple[str, ...]:
    """What object code depends on besides the IR: the processor and its features, LLVM, and how it is used."""
    cpu, features = host()
    version = ".".join(map(str, llvm.llvm_version_info))
    return cpu, features, version, llvmlite.__version__, " ".join(compiler_options(LEVEL))


def load_code(key: str) -> MachineCode | None:
    """The machine code with this key, if it is in the cache."""
    codes = [disk_cache.load(one) for one in key.split()]
    return None if None in codes else linked(key.split(), [code for code in codes if code is not None])


@functools.cache
def host() -> tuple[str, str]:
    """The processor and its features, in the words of LLVM."""
    return llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()


def linked(keys: Sequence[str], codes: Sequence[bytes]) -> MachineCode:
    """The machine code of the object code of units, which are in the cache by these keys."""
    builder = llvm.JITLibraryBuilder().add_current_process()
    for code in codes:
        builder.add_object_img(code)
    for name, address in external_symbols().items():
        builder.import_symbol(name, address)
    linker = _linker()
    return MachineCode(builder.link(linker, f"code {next(_NUMBERS)}"), linker, " ".join(keys))


@functools.cache
def _linker() -> llvm.LLJIT:
    """The one that links all libraries of this process: with a new one each time, to link takes three times as long."""
    return llvm.create_lljit_compiler(target_machine(*host(), LEVEL), use_jit_link=True)
