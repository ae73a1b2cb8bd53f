"""The processes that compile long modules: their code has the results of others; they end if their caller is gone."""

import ctypes
import os
import signal
import subprocess
import sys
from pathlib import Path

import casadi as ca
import llvmlite.binding as llvm
import numpy as np
import pytest

from mbd_sim.compiler.code import compile_process, machine_code
from mbd_sim.compiler.code.compile_process import compile_apart
from mbd_sim.compiler.code.host_module import new_module
from mbd_sim.compiler.code.object_code import object_code
from mbd_sim.compiler.lists.lowering import lower
from mbd_sim.compiler.python.bound_call import export
from test.waiting import wait_until


def swapping_module():
    """A function whose outputs are stored one beside the other."""
    x = ca.SX.sym("x", 4)
    swapped = ca.vertcat(x[0] / x[1], x[2] * x[3] + x[1], x[0], x[1], ca.sin(x), 1.0, 1.0)
    module = new_module()
    export(module, "read", lower(module, ca.Function("f", [x], [swapped]), inline=True))
    return str(module)


def host():
    return llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()


@pytest.fixture(scope="module")
def apart():
    """The code of the module, compiled by a process."""
    return compile_apart(swapping_module(), *host(), 1)


def test_code_compiled_with_the_options_for_long_code_has_the_same_bits(apart):
    given, results = np.array([0.1, 3.0, -0.7, 40.0]), []
    codes = [object_code(swapping_module(), *host(), 1), apart]
    assert codes[0] != codes[1]  # neighbors are stored together only without the options
    for key, code in zip(("short", "long"), codes, strict=True):
        loaded, out = machine_code.linked(key, code), np.empty(10)
        call = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(loaded.address("read"))
        call(given.ctypes.data, out.ctypes.data)
        results.append(out)
    assert results[0].tobytes() == results[1].tobytes()
    np.testing.assert_allclose(results[1][4:8], np.sin(given), rtol=0.0, atol=1e-16)


def test_a_module_that_fails_gives_no_code_and_prints_nothing(capfd):
    assert compile_apart("no module", *host(), 1) is None
    assert capfd.readouterr() == ("", "")


def test_an_interrupt_ends_the_process(monkeypatch):
    started, start = [], compile_process._started
    monkeypatch.setattr(compile_process, "_started", lambda *given: started.append(start(*given)) or started[0])
    monkeypatch.setattr(compile_process, "REPORT_PERIOD", 0.001)

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(compile_process._log, "info", lambda text, *_: "still" in text and interrupted())
    with pytest.raises(KeyboardInterrupt):
        compile_apart(swapping_module(), *host(), 1)
    assert started[0].returncode == -signal.SIGKILL


def test_the_process_ends_with_its_caller():
    caller = subprocess.Popen(
        [sys.executable, "-c", f"from test.compiler.code.test_compile_process import *; waiting({host()!r})"],
        stdout=subprocess.PIPE,
    )
    pid, holder = map(int, caller.stdout.readline().split())
    caller.kill()
    caller.communicate()
    try:
        wait_until(lambda: not Path(f"/proc/{pid}").exists(), "the end of the process")
    finally:
        os.kill(holder, signal.SIGKILL)


def waiting(host):
    """Start the program, print its process, and give it nothing, but keep its standard input open."""
    process = compile_process._started(*host, "1")
    os.set_inheritable(process.stdin.fileno(), True)
    holder = subprocess.Popen(["sleep", "600"], close_fds=False, stdout=subprocess.DEVNULL)
    print(process.pid, holder.pid, flush=True)
    holder.wait()


def test_progress_is_logged(monkeypatch, caplog):
    monkeypatch.setattr(compile_process, "REPORT_PERIOD", 0.001)
    monkeypatch.setattr(sys, "path", [Path("/does/not/exist"), *sys.path])  # no text: left out, as imports do
    with caplog.at_level("INFO", logger=compile_process.__name__):
        assert compile_apart(swapping_module() + "; more than a pipe holds\n" * 10_000, *host(), 1) is not None
    messages = [record.message for record in caplog.records]
    assert messages[0] == "compiling 0.3 MB of intermediate code"
    assert {message.partition(": ")[0] for message in messages[1:-1]} == {"still compiling"}
    assert messages[-1].startswith("compiled in ")


def test_without_the_process_long_code_is_compiled_in_the_same_way(apart, monkeypatch):
    text = swapping_module()
    short = object_code(text, *host(), 1)
    monkeypatch.setattr(machine_code, "LEVEL", 1)
    monkeypatch.setattr(machine_code, "LONG", 0)
    monkeypatch.setattr(sys, "executable", "/does/not/exist")
    assert compile_apart(text, *host(), 1) is None
    assert machine_code._compiled(text, *host(), 1) == apart != short
    assert object_code(text, *host(), 1) == short  # the options of long code have ended


def test_options_are_part_of_the_key(monkeypatch):
    before = machine_code.compiler_identity()
    monkeypatch.setattr("mbd_sim.compiler.code.object_code.LONG_CODE_OPTIONS", ())
    assert machine_code.compiler_identity() != before
