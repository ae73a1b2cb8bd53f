"""Modules that are compiled in units: each long function for itself."""

import ctypes

import casadi as ca
import pytest

from mbd_sim import Simulation, load_mechanism
from mbd_sim.compiler.code import host_module, machine_code
from mbd_sim.compiler.code.host_module import compile_module, new_module
from mbd_sim.compiler.ir import module as modules
from mbd_sim.compiler.ir.builder import DOUBLE, INT, IRBuilder, element, integer
from mbd_sim.compiler.ir.module import Function, FunctionType
from mbd_sim.compiler.lists.lowering import define, export, lower
from mbd_sim.files.checks.override import with_values


def test_units_call_each_other_and_share_what_is_inlined_variables_and_tables(monkeypatch):
    module = new_module()
    x = ca.SX.sym("x")
    twice = lower(module, ca.Function("twice", [x], [2.0 * x]), inline=True)
    table = module.table("numbers", [3, 5])
    for place, name in enumerate(("three", "five")):
        function, b = define(module, name, 2, inline=False, lanes=1)
        given, out = function.args
        b.call(twice, [given, out])
        number = b.load(b.gep(table, integer(place), INT), typ=INT)
        b.store(b.fadd(b.load(out, typ=DOUBLE), b.sitofp(number, DOUBLE)), out)
        b.ret_void()
    both, b = define(module, "both", 2, inline=False, lanes=1)
    given, out = both.args
    b.call(module.functions["three"], [given, out])
    b.call(module.functions["five"], [given, element(b, out, 1)])
    b.ret_void()
    export(module, "read", both)
    size = Function(module, FunctionType(INT, ["ptr"]), "size")  # calls what is neither in the module nor inlined
    b = IRBuilder(size.append_basic_block("entry"))
    b.ret(b.call(module.declared("PyTuple_Size", INT, ["ptr"]), size.args))
    monkeypatch.setattr(modules, "LARGE", 5)
    assert [text.count("\ndefine ") for text in module.units()] == [2, 2, 1, 2]
    code = compile_module(module)
    values = (ctypes.c_double * 3)(10.0)
    start = ctypes.addressof(values)
    ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(code.address("read"))(start, start + 8)
    assert list(values) == [10.0, 23.0, 25.0]
    assert ctypes.PYFUNCTYPE(ctypes.c_int64, ctypes.py_object)(code.address("size"))((1, 2)) == 2


@pytest.mark.parametrize("name", ["slider_crank", "rocking"])
def test_a_changed_number_of_the_file_leaves_the_steps_compiled(name, tmp_path, monkeypatch, own_builds):
    """Also those that end at events."""
    monkeypatch.setenv("MBD_SIM_CACHE", str(tmp_path))
    monkeypatch.setattr(machine_code, "LEVEL", 0)
    mechanism, sizes, compile_text = load_mechanism(name), [], host_module.object_code
    Simulation(mechanism).step(1)  # also the code that all mechanisms share

    def counted(text, *rest):
        sizes.append(len(text))
        return compile_text(text, *rest)

    monkeypatch.setattr(host_module, "object_code", counted)
    monkeypatch.setenv("MBD_SIM_CACHE", str(tmp_path / "empty"))
    Simulation(mechanism)
    whole, sizes[:] = sum(sizes), []
    Simulation(with_values(mechanism, {"gravity": [0.0, 0.0, -9.0]}))
    assert 0 < sum(sizes) < 0.5 * whole
