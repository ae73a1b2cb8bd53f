"""Modules compiled in parts give the bits of the whole; no process outlives its build."""

import contextlib
import ctypes
import math
import os
import re
import time
from functools import partial
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from mbd_sim import disk_cache
from mbd_sim.compiler import compile_process, machine_code, split_functions
from mbd_sim.compiler.compile_process import CodeInProgress, CompileProcesses
from mbd_sim.compiler.concurrent_build import ConcurrentBuild, is_likely_long
from mbd_sim.compiler.host_module import compile_module, new_module
from mbd_sim.compiler.kernel import emit_exported, emit_readers
from mbd_sim.compiler.lowering import declare, export, lower
from mbd_sim.compiler.module_parts import ModuleParts, shares

LENGTH = 4


@pytest.fixture
def functions(monkeypatch):
    """A long function in pieces of twenty instructions, which call one sine, and a short one with that inlined."""
    monkeypatch.setattr(split_functions, "PIECE", 20)
    monkeypatch.setattr(split_functions, "UNSPLIT", 40)
    monkeypatch.setattr("mbd_sim.compiler.lowering.INLINE_SINES", 40)
    x = ca.SX.sym("x", LENGTH)
    y = x
    for _ in range(10):
        y = ca.sin(y[[1, 2, 3, 0]]) * x + y
    return {"long": ca.Function("long", [x], [y]), "short": ca.Function("short", [x], [ca.sin(x)])}


def add(module, name, functions):
    export(module, f"read_{name}", lower(module, functions[name], inline=True))


def values(code, name):
    given, out = np.array([0.1, 2.0, -3.0, 40.0]), np.empty(LENGTH)
    call = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(code.address(f"read_{name}"))
    call(given.ctypes.data, out.ctypes.data)
    return out.tolist()


@pytest.mark.parametrize("fails", [False, True])
def test_parts_have_the_bits_of_the_whole(functions, monkeypatch, tmp_path, fails):
    monkeypatch.setenv("MBD_SIM_CACHE", str(tmp_path))
    whole, module = new_module(), new_module()
    for name in functions:
        add(whole, name, functions)
    expected = {name: values(compile_module(whole), name) for name in functions}
    monkeypatch.setattr(machine_code, "LONG", 40_000)
    if fails:
        monkeypatch.setattr(CodeInProgress, "code", lambda self: None)
    with ConcurrentBuild(module) as build:
        add(module, "long", functions)
        build.compile_finished()
        begun = len(build._compiled)
        add(module, "short", functions)
        code = build.machine_code()
    assert 1 < begun < len(code.keys) == len(build._compiled)
    assert {name: values(code, name) for name in functions} == expected
    again = machine_code.load_code(code.keys)
    assert {name: values(again, name) for name in functions} == expected
    (tmp_path / code.keys[-1]).unlink()
    assert machine_code.load_code(code.keys) is None


@pytest.mark.parametrize("fails", [False, True])
def test_functions_that_a_process_emits_have_the_bits_of_the_whole(functions, monkeypatch, tmp_path, fails):
    monkeypatch.setenv("MBD_SIM_CACHE", str(tmp_path))
    whole, module = new_module(), new_module()
    emit_readers(whole, functions)
    expected = {name: values(compile_module(whole), name) for name in functions}
    monkeypatch.setattr(machine_code, "LONG", 40_000)
    with ConcurrentBuild(module) as build:
        assert not build.has_started
        build._processes.start()
        assert build.has_started
        if fails:
            build._processes._server.kill()
        build.emit_apart(partial(emit_exported, function=functions["long"]))
        build.emit_apart(partial(emit_readers, readers={"short": functions["short"]}))
        export(module, "read_long", declare(module, "long", 2))
        code = build.machine_code()
    assert len(code.keys) == 3
    assert {name: values(code, name) for name in functions} == expected
    again = machine_code.load_code(code.keys)
    assert {name: values(again, name) for name in functions} == expected


def test_a_function_that_no_process_can_emit_raises_the_error_of_the_caller(monkeypatch, capfd):
    monkeypatch.setattr(machine_code, "LONG", 40_000)
    x = ca.SX.sym("x")
    unknown = ca.Function("unknown", [x], [ca.erf(x)])
    with ConcurrentBuild(new_module()) as build, pytest.raises(NotImplementedError, match="no kernel instruction"):
        build.emit_apart(partial(emit_exported, function=unknown))
        build.machine_code()
    assert capfd.readouterr() == ("", "")


def test_parts_are_loaded_from_the_cache_without_a_process(functions, monkeypatch, tmp_path):
    monkeypatch.setenv("MBD_SIM_CACHE", str(tmp_path))
    monkeypatch.setattr(machine_code, "LONG", 40_000)
    keys = []
    for _ in range(2):
        module = new_module()
        with ConcurrentBuild(module) as build:
            add(module, "long", functions)
            build.compile_finished()
            keys.append(build.machine_code().keys)
        monkeypatch.setattr(CompileProcesses, "compile", lambda *given: pytest.fail("it is compiled again"))
    assert keys[0] == keys[1]


def test_a_short_module_is_compiled_as_a_whole(functions, monkeypatch):
    module = new_module()
    with ConcurrentBuild(module) as build:
        add(module, "short", functions)
        build.compile_finished()
        assert build.machine_code().keys == compile_module(module).keys


def test_each_function_is_in_one_part(functions):
    module = new_module()
    for name in functions:
        add(module, name, functions)
    parts = ModuleParts(module)
    sizes = parts.sizes()
    texts = [parts.take(share) for share in shares(sizes, 3)]
    assert len(texts) == 3
    assert parts.sizes() == {}
    defined = [name for text in texts for name in re.findall(r'define (?!internal).*?@"([^"]+)"', text)]
    assert sorted(defined) == sorted(sizes)
    inlined = [text.count('define internal {double, double} @"sine_cosine"') for text in texts]
    assert max(inlined) == 1


def test_shares_are_of_similar_size():
    assert shares({"a": 1, "b": 5, "c": 3, "d": 2}, 2) == [["b", "a"], ["c", "d"]]
    assert shares({"a": 1}, 3) == [["a"]]


SLOW_SERVER = """
import time
from mbd_sim.compiler import compile_server, object_code
object_code.object_code = lambda *_, **__: time.sleep(600)
compile_server.main()
"""


def test_an_exception_ends_the_processes(functions, monkeypatch, tmp_path):
    program = tmp_path / "slow_server.py"
    program.write_text(SLOW_SERVER)
    monkeypatch.setattr(compile_process, "PROGRAM", program)
    monkeypatch.setattr(disk_cache, "folder", lambda: None)
    monkeypatch.setattr(machine_code, "LONG", 40_000)
    module = new_module()
    with pytest.raises(KeyboardInterrupt), ConcurrentBuild(module) as build:
        add(module, "long", functions)
        build.compile_finished()
        server = build._processes._server
        while not (running := children(server.pid)):
            time.sleep(0.001)
        raise KeyboardInterrupt
    for process in (server.pid, *running):
        require_ended(process)
    assert all(part._begun._module.closed for part in build._compiled)


def test_an_interrupt_while_parts_are_sent_ends_the_processes(functions, monkeypatch):
    monkeypatch.setattr(disk_cache, "folder", lambda: None)
    monkeypatch.setattr(machine_code, "LONG", 40_000)
    compile_part, servers = CompileProcesses.compile, []

    def interrupted(processes, text):
        if servers:
            raise KeyboardInterrupt
        begun = compile_part(processes, text)
        servers.append(processes._server.pid)
        return begun

    monkeypatch.setattr(CompileProcesses, "compile", interrupted)
    module = new_module()
    with pytest.raises(KeyboardInterrupt), ConcurrentBuild(module) as build:
        add(module, "long", functions)
        build.compile_finished()
    require_ended(*servers)


def test_processes_start_early_only_for_kernels_that_are_likely_long(monkeypatch):
    monkeypatch.setattr(machine_code, "LONG", 1_000_000)
    assert [is_likely_long(joints) for joints in (7, 60)] == [False, True]
    monkeypatch.setattr(machine_code, "LONG", math.inf)
    assert not is_likely_long(60)


def children(parent):
    """The processes whose parent is this one."""
    found = []
    for state in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            if int(state.read_text().rpartition(")")[2].split()[1]) == parent:
                found.append(int(state.parent.name))
    return found


def require_ended(process):
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)
