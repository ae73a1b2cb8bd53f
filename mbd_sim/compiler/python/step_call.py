"""A kernel as an ordinary Python callable: the machine code itself has CPython's calling signature.

A call through ctypes costs nearly 1 µs, more than the step itself; this call costs some 0.05 µs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mbd_sim.compiler.code.machine_code import NONE
from mbd_sim.compiler.ir.builder import DOUBLE, INT, IRBuilder, element, integer
from mbd_sim.compiler.ir.module import POINTER, VOID, BasicBlock, Function, FunctionType, Module, Value
from mbd_sim.compiler.python.bound_kernel import LARGEST, MOVING

RELEASING = 16  # steps from which the interpreter's lock is released; that costs as much as a call

_SIGNATURES = {
    "PyTuple_GetItem": FunctionType(POINTER, [POINTER, INT]),
    "PyBytes_AsString": FunctionType(POINTER, [POINTER]),
    "PyLong_AsLongLong": FunctionType(INT, [POINTER]),
    "PyErr_Occurred": FunctionType(POINTER, []),
    "PyErr_Clear": FunctionType(VOID, []),
    "PyObject_Vectorcall": FunctionType(POINTER, [POINTER, POINTER, INT, POINTER]),
    "PyEval_SaveThread": FunctionType(POINTER, []),
    "PyEval_RestoreThread": FunctionType(VOID, [POINTER]),
    "Py_IncRef": FunctionType(VOID, [POINTER]),
}


def linked(module: Module) -> dict[str, Function]:
    """The interpreter's functions that machine code uses, declared in a module."""
    return {name: Function(module, signature, name) for name, signature in _SIGNATURES.items()}


def emit_call(module: Module, advance: Function, roles: Sequence[str]) -> Function:
    """Emit `PyObject* call(PyObject* self, PyObject** arguments, Py_ssize_t count, PyObject* names)`.

    It is `step(n=1)` for the usual case: it advances and adds n to the step counter. In any other case it calls the
    second entry of `self` with the same arguments, which raises the error; also where n is beyond a limit, or the
    reserved cell (int64) is not 0. While the interpreter's lock is released, this cell is `MOVING`, so that no other
    thread moves the state.

    :param roles: of each argument of `advance`: "first", "h", "steps", or anything else for a pointer. The first entry
        of `self` is a bytes object with the limit and the addresses of the counter, of the reserved cell, of h, and
        of these pointers in order.
    """
    python = linked(module)
    none = module.external(NONE, "i8")
    call = Function(module, FunctionType(POINTER, [POINTER, POINTER, INT, POINTER]), "call")
    own, arguments, count, names = call.args
    blocks = {name: call.append_basic_block(name) for name in ("entry", "given", "known", "doubtful", "run", "other")}
    b = IRBuilder(blocks["entry"])
    steps = _emit_step_count(b, python, call, blocks)
    b.branch(blocks["run"])

    b.position_at_end(blocks["run"])
    table = b.call(python["PyBytes_AsString"], [b.call(python["PyTuple_GetItem"], [own, integer(0)])])

    def address(index: int) -> Value:
        return b.load(element(b, table, index), typ=POINTER)

    counter, reserved = address(1), address(2)
    is_reserved = b.icmp_unsigned("!=", b.load(reserved, typ=INT), integer(0))
    with b.if_then(b.or_(is_reserved, b.icmp_unsigned(">", steps, b.load(table, typ=INT))), likely=False):
        b.branch(blocks["other"])
    first = b.load(counter, typ=INT)
    values = {"first": first, "h": b.load(address(3), typ=DOUBLE), "steps": steps}
    pointers = iter(range(4, 4 + len(roles)))
    passed = [values[role] if role in values else address(next(pointers)) for role in roles]
    finite = _emit_advance(b, python, advance, passed, steps, reserved)
    with b.if_then(b.icmp_unsigned("!=", finite, integer(0)), likely=True):
        b.store(b.add(first, steps), counter)
        b.call(python["Py_IncRef"], [none])
        b.ret(none)
    b.branch(blocks["other"])

    b.position_at_end(blocks["other"])
    fallback = b.call(python["PyTuple_GetItem"], [own, integer(1)])
    b.ret(b.call(python["PyObject_Vectorcall"], [fallback, arguments, count, names]))
    return call


def _emit_step_count(
    b: IRBuilder, python: Mapping[str, Function], call: Function, blocks: Mapping[str, BasicBlock]
) -> Value:
    """Emit the reading of n, which is 1 without an argument; anything that is not a count goes to block `other`."""
    _, arguments, count, names = call.args
    null = Value(POINTER, "null")
    positional = b.and_(b.icmp_unsigned("==", names, null), b.icmp_unsigned("<=", count, integer(1)))
    with b.if_then(b.not_(positional), likely=False):
        b.branch(blocks["other"])
    b.cbranch(b.icmp_unsigned("==", count, integer(0)), blocks["known"], blocks["given"])
    without_argument = b.block

    b.position_at_end(blocks["given"])
    number = b.call(python["PyLong_AsLongLong"], [b.load(arguments, typ=POINTER)])
    in_range = b.icmp_unsigned("<=", number, integer(LARGEST))  # false for negative numbers, read as unsigned
    b.cbranch(in_range, blocks["known"], blocks["doubtful"])

    b.position_at_end(blocks["doubtful"])
    with b.if_then(b.icmp_unsigned("!=", b.call(python["PyErr_Occurred"], []), null)):
        b.call(python["PyErr_Clear"], [])
    b.branch(blocks["other"])

    b.position_at_end(blocks["known"])
    steps = b.phi(INT)
    steps.add_incoming(integer(1), without_argument)
    steps.add_incoming(number, blocks["given"])
    return steps


def _emit_advance(
    b: IRBuilder,
    python: Mapping[str, Function],
    advance: Function,
    passed: Sequence[Value],
    steps: Value,
    reserved: Value,
) -> Value:
    """Emit the call of `advance`, without the interpreter's lock if there are many steps. Returns its result."""
    with b.if_else(b.icmp_unsigned(">=", steps, integer(RELEASING))) as (many, few):
        with many:
            b.store(integer(MOVING), reserved)
            thread = b.call(python["PyEval_SaveThread"], [])
            result_unlocked = b.call(advance, passed)
            b.call(python["PyEval_RestoreThread"], [thread])
            b.store(integer(0), reserved)
            end_unlocked = b.block
        with few:
            result_locked = b.call(advance, passed)
            end_locked = b.block
    result = b.phi(INT)
    result.add_incoming(result_unlocked, end_unlocked)
    result.add_incoming(result_locked, end_locked)
    return result
