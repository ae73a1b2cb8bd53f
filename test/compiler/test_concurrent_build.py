"""Modules compiled in parts give the bits of the whole; no process outlives its build."""

import ctypes
import os
import re

import casadi as ca
import numpy as np
import pytest

from mbd_sim import disk_cache
from mbd_sim.compiler import concurrent_build, machine_code, split_functions
from mbd_sim.compiler.compile_process import CompileProcess
from mbd_sim.compiler.concurrent_build import ConcurrentBuild
from mbd_sim.compiler.host_module import compile_module, new_module
from mbd_sim.compiler.lowering import export, lower
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
        monkeypatch.setattr(CompileProcess, "code", lambda self: None)
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
        monkeypatch.setattr(concurrent_build, "CompileProcess", lambda *given: pytest.fail("it is compiled again"))
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


def test_an_exception_ends_the_processes(functions, monkeypatch):
    monkeypatch.setattr(disk_cache, "folder", lambda: None)
    monkeypatch.setattr(machine_code, "LONG", 40_000)
    module = new_module()
    with pytest.raises(KeyboardInterrupt), ConcurrentBuild(module) as build:
        add(module, "long", functions)
        build.compile_finished()
        running = [part._process._child.pid for part in build._compiled]
        raise KeyboardInterrupt
    assert running
    for process in running:
        require_ended(process)


def test_an_interrupt_while_processes_are_started_ends_those_that_run(functions, monkeypatch):
    monkeypatch.setattr(disk_cache, "folder", lambda: None)
    monkeypatch.setattr(machine_code, "LONG", 40_000)
    running = []

    def started(*given):
        if running:
            raise KeyboardInterrupt
        process = CompileProcess(*given)
        running.append(process._child.pid)
        return process

    monkeypatch.setattr(concurrent_build, "CompileProcess", started)
    module = new_module()
    with pytest.raises(KeyboardInterrupt), ConcurrentBuild(module) as build:
        add(module, "long", functions)
        build.compile_finished()
    (process,) = running
    require_ended(process)


def require_ended(process):
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)
