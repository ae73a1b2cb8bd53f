"""The text of the builder is what `llvmlite.ir` writes for the same calls: LLVM makes the same machine code of both."""

from __future__ import annotations

import llvmlite.binding as llvm
import llvmlite.ir
import pytest

from mbd_sim.compiler.code.object_code import object_code
from mbd_sim.compiler.ir.builder import DOUBLE, INT, IRBuilder, integer, number
from mbd_sim.compiler.ir.lanes import LaneBuilder
from mbd_sim.compiler.ir.module import POINTER, VOID, Function, FunctionType, Module

TYPES = {DOUBLE: llvmlite.ir.DoubleType(), INT: llvmlite.ir.IntType(64), POINTER: llvmlite.ir.PointerType()}
FLOATS = ("fadd", "fsub", "fmul", "fdiv")
INTEGERS = ("add", "sub", "mul", "urem", "and_", "or_", "xor", "shl")
ORDERS = ("==", "!=", "<", "<=", ">", ">=")


def triple():
    return llvm.get_default_triple()


def ours():
    """A function of the builder: its text, its arguments, and what makes types, integers and numbers."""
    module = Module(triple(), IRBuilder)
    function = Function(module, FunctionType(VOID, [POINTER, DOUBLE, DOUBLE, INT]), "f")
    b = IRBuilder(function.append_basic_block("entry"))
    return module, b, function.args, str, integer, number


def theirs():
    """The same of llvmlite."""
    ir = llvmlite.ir
    module = ir.Module()
    module.triple = triple()
    function = ir.Function(
        module, ir.FunctionType(ir.VoidType(), [TYPES[one] for one in (POINTER, DOUBLE, DOUBLE, INT)]), "f"
    )
    b = ir.IRBuilder(function.append_basic_block("entry"))
    return (
        module,
        b,
        function.args,
        TYPES.get,
        lambda n: ir.Constant(TYPES[INT], n),
        lambda x: ir.Constant(TYPES[DOUBLE], x),
    )


def machine_code(emit, made):
    module, b, arguments, *constants = made
    emit(b, *arguments, *constants)
    b.ret_void()
    return object_code(str(module), "", "", 1)


def same(emit):
    assert machine_code(emit, ours()) == machine_code(emit, theirs())


@pytest.mark.parametrize("name", FLOATS)
def test_operations_of_numbers(name):
    same(lambda b, array, x, y, n, type_, integer, number: b.store(getattr(b, name)(x, y), array))


@pytest.mark.parametrize("name", INTEGERS)
def test_operations_of_integers(name):
    same(lambda b, array, x, y, n, type_, integer, number: b.store(getattr(b, name)(n, integer(5)), array))


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("kind", ["fcmp_ordered", "fcmp_unordered", "icmp_signed", "icmp_unsigned"])
def test_comparisons(kind, order):
    def emit(b, array, x, y, n, type_, integer, number):
        operands = (x, y) if kind.startswith("f") else (n, integer(-7))
        b.store(b.select(b.not_(getattr(b, kind)(order, *operands)), x, number(-0.1)), array)

    same(emit)


def test_numbers_that_are_not_numbers():
    same(lambda b, array, x, y, n, type_, *_: b.store(b.zext(b.fcmp_unordered("uno", x, y), type_(INT)), array))


def test_conversions():
    def emit(b, array, x, y, n, type_, integer, number):
        b.store(b.sitofp(b.fptosi(x, type_(INT)), type_(DOUBLE)), array)
        b.store(b.bitcast(b.add(b.bitcast(y, type_(INT)), n), type_(DOUBLE)), array)
        b.store(b.fma(b.fneg(x), y, number(1e-310)), array)

    same(emit)


def test_branches():
    def emit(b, array, x, y, n, type_, integer, number):
        with b.if_then(b.icmp_signed(">", n, integer(3)), likely=False):
            b.store(x, array)
        with b.if_else(b.fcmp_ordered("<", x, y)) as (less, otherwise):
            with less:
                first, one = b.fadd(x, number(1.0)), b.block
            with otherwise:
                second, other = b.fsub(y, number(2.0)), b.block
        found = b.phi(type_(DOUBLE))
        found.add_incoming(first, one)
        found.add_incoming(second, other)
        b.store(found, array)
        with b.if_then(b.fcmp_ordered("==", found, x)):
            b.ret_void()

    same(emit)


def test_a_function_has_a_name_of_its_own():
    module = Module(triple(), IRBuilder)
    Function(module, FunctionType(VOID, []), "f")
    with pytest.raises(ValueError, match="the function 'f' is defined twice"):
        Function(module, FunctionType(DOUBLE, []), "f")
    assert module.declared("f", DOUBLE, []) is module.functions["f"]


def test_wrong_types_are_refused_when_the_text_is_read():
    module, b, (array, x, _, n), *_ = ours()
    b.store(b.fadd(x, n), array)
    b.ret_void()
    with pytest.raises(RuntimeError, match="defined with type"):
        object_code(str(module), "", "", 1)


def test_lanes_widen_what_is_the_same_for_all_members():
    function = Function(Module(triple(), IRBuilder), FunctionType(VOID, [POINTER, DOUBLE]), "f")
    b = LaneBuilder(function.append_basic_block("entry"), 4)
    array, x = function.args
    y = b.load(array, typ=DOUBLE)
    assert y.type == "<4 x double>"
    assert b.fmul(x, x).type == DOUBLE
    assert b.fmul(x, y).type == b.fmul(number(2.0), y).type == y.type
    assert b.fcmp_ordered("<", y, x).type == "<4 x i1>"
    assert b.any_lane(b.fcmp_ordered("<", y, x)).type == "i1"
    assert b.lane(y, 2).type == DOUBLE
    b.store(number(3.0), array)
    b.ret_void()
    assert "store <4 x double> <double 0x4008000000000000" in str(function)
    assert object_code(str(function.module), "", "", 1)
