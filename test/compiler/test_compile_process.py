"""The process that compiles long modules: its code has the results of the others; it ends if its caller is gone."""

import ctypes
import os
import subprocess
import sys
from pathlib import Path

import casadi as ca
import llvmlite.binding as llvm
import numpy as np
import pytest

from mbd_sim.compiler import machine_code
from mbd_sim.compiler.compile_process import compile_apart
from mbd_sim.compiler.host_module import new_module
from mbd_sim.compiler.lowering import lower
from mbd_sim.compiler.object_code import object_code
from mbd_sim.compiler.readers import export

PROGRAM = "from mbd_sim.compiler import object_code; object_code.object_code = lambda *_, **__: bytes(200_000)\n"


def test_it_says_nothing_where_nobody_waits_for_the_code():
    reader, writer = os.pipe()
    command = [sys.executable, "-c", f"{PROGRAM}object_code.main()", str(os.getpid()), "cpu", "features", "1"]
    with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=writer, stderr=subprocess.PIPE) as child:
        os.close(reader)
        os.close(writer)
        assert (child.communicate()[1], child.returncode) == (b"", 1)


def test_it_compiles_nothing_for_a_caller_that_has_ended():
    command = [sys.executable, "-c", f"{PROGRAM}object_code.main()", "0", "cpu", "features", "1"]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, check=False)
    assert (done.stdout, done.stderr, done.returncode) == (b"", b"", 1)


def swapping_module():
    """A function whose outputs are stored one beside the other."""
    x = ca.SX.sym("x", 4)
    swapped = ca.vertcat(x[0] / x[1], x[2] * x[3] + x[1], x[0], x[1], ca.sin(x), 1.0, 1.0)
    module = new_module()
    export(module, "read", lower(module, ca.Function("f", [x], [swapped]), inline=True))
    return str(module)


def host():
    return llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()


def test_code_compiled_with_the_options_for_long_code_has_the_same_bits():
    text, given, results = swapping_module(), np.array([0.1, 3.0, -0.7, 40.0]), []
    codes = [object_code(text, *host(), 1), compile_apart(text, *host(), 1)]
    assert codes[0] != codes[1]  # neighbors are stored together only without the options
    for key, code in zip(("short", "long"), codes, strict=True):
        loaded, out = machine_code.linked({key: code}), np.empty(10)
        call = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(loaded.address("read"))
        call(given.ctypes.data, out.ctypes.data)
        results.append(out)
    assert results[0].tobytes() == results[1].tobytes()
    np.testing.assert_allclose(results[1][4:8], np.sin(given), rtol=0.0, atol=1e-16)


def test_without_the_process_long_code_is_compiled_in_the_same_way(monkeypatch):
    text = swapping_module()
    short, apart = object_code(text, *host(), 1), compile_apart(text, *host(), 1)
    monkeypatch.setattr(machine_code, "LEVEL", 1)
    monkeypatch.setattr(machine_code, "LONG", 0)
    monkeypatch.setattr(sys, "executable", "/does/not/exist")
    assert compile_apart(text, *host(), 1) is None
    assert machine_code._compiled(text, *host()) == apart != short
    assert object_code(text, *host(), 1) == short  # the options of long code have ended


def test_options_are_part_of_the_key(monkeypatch):
    before = machine_code.compiler_identity()
    monkeypatch.setattr("mbd_sim.compiler.object_code.LONG_CODE_OPTIONS", ())
    assert machine_code.compiler_identity() != before


@pytest.mark.parametrize("changed", ["near_addresses.py", "memory_order.py"])
def test_the_passes_over_assembly_code_are_part_of_the_key(changed, monkeypatch, tmp_path):
    before, digest = machine_code.compiler_identity(), sys.modules[object_code.__module__]._near_addresses_digest
    for name in ("near_addresses.py", "memory_order.py"):
        text = Path(sys.modules[object_code.__module__].__file__).with_name(name).read_text()
        (tmp_path / name).write_text("# another pass" if name == changed else text)
    with monkeypatch.context() as patch:
        patch.setattr("mbd_sim.compiler.object_code.__file__", str(tmp_path / "object_code.py"))
        digest.cache_clear()
        assert machine_code.compiler_identity() != before
    digest.cache_clear()
    assert machine_code.compiler_identity() == before
