"""The builder of C against that of LLVM's language: the same program gives the same numbers."""

import ctypes
import shutil
import subprocess

import numpy as np
import pytest

from mbd_sim.compiler.code.host_module import compile_module, new_module
from mbd_sim.compiler.ir.builder import DOUBLE, INT, integer, local_array, number
from mbd_sim.compiler.ir.module import POINTER, VOID, Function, FunctionType
from mbd_sim.compiler.ir.vectors import load, loop, store
from mbd_sim.exports.c_code.builder import CModule
from mbd_sim.exports.c_code.module import FLAGS

SIZE = 40
VALUES = [0.0, -0.0, 1.0, -2.5, np.nan, np.inf, 3.0, 1e-300, 7.0, 0.3]
ORDERS = ("==", "!=", "<", "<=", ">", ">=")


def comparisons(b, x, out):
    """All orders, with operands that may be NaN."""
    first, second = load(b, x, 0), load(b, x, 1)
    for place, order in enumerate(ORDERS):
        for offset, compare in ((0, b.fcmp_ordered), (6, b.fcmp_unordered)):
            store(b, b.select(compare(order, first, second), number(1.0), number(0.0)), out, place + offset)
    one, other = b.fcmp_ordered("<", first, number(1.0)), b.fcmp_ordered(">", second, number(0.0))
    mixed = b.or_(b.and_(one, b.not_(other)), b.fcmp_unordered("uno", first, first))
    store(b, b.select(mixed, b.fneg(b.fneg(first)), b.fsub(second, b.fsub(first, number(-3.0)))), out, 12)


def memory(b, x, out):
    """Values that are read before what they are read from changes, and are used after it, also within branches."""
    cell = local_array(b, 1)
    old, later = load(b, x, 2), b.fmul(load(b, x, 3), number(2.0))
    b.store(old, cell)
    store(b, number(5.0), x, 2)
    store(b, b.fadd(old, load(b, x, 2)), out, 0)
    before = b.load(cell, typ=DOUBLE)
    b.store(number(9.0), cell)
    with b.if_else(b.fcmp_ordered(">", before, number(0.0))) as (then, otherwise):
        with then:
            store(b, number(-1.0), x, 3)
            store(b, b.fma(later, later, before), out, 1)
        with otherwise:
            store(b, b.fdiv(later, before), out, 1)
    store(b, b.load(cell, typ=DOUBLE), out, 2)
    once, within = load(b, x, 4), b.fadd(load(b, x, 5), number(1.0))
    store(b, number(2.0), x, 4)
    store(b, number(4.0), x, 5)
    store(b, b.fmul(once, number(3.0)), out, 3)
    loop(b, 4, 6, lambda i: store(b, within, out, i))


def loops(b, x, out):
    """Bounds that the body changes, numbers of executions, and operations on integers."""
    bound = b.alloca(INT)
    b.store(integer(4), bound)

    def body(i):
        b.store(integer(2), bound)
        loop(b, 0, i, lambda j: store(b, b.sitofp(b.add(b.mul(i, integer(7)), b.urem(j, integer(2))), DOUBLE), out, j))

    loop(b, 1, b.load(bound, typ=INT), body)

    def again(count):
        shifted = b.sub(b.shl(integer(1), count), b.lshr(integer(8), count))
        store(b, b.sitofp(b.or_(shifted, b.and_(count, integer(1))), DOUBLE), out, b.add(count, integer(10)))
        return b.icmp_signed("<", count, b.fptosi(load(b, x, 6), INT))

    b.repeat(integer(1), again)


def emitted(module, program):
    function = Function(module, FunctionType(VOID, [POINTER, POINTER]), "run", ("x", "out"))
    b = module.new_builder(function.append_basic_block("entry"))
    program(b, *function.args)
    b.ret_void()


@pytest.mark.skipif(not shutil.which("gcc"), reason="gcc is not installed")
@pytest.mark.parametrize("program", [comparisons, memory, loops])
def test_programs_give_the_same_numbers(program, tmp_path):
    ours, theirs = CModule(SIZE), new_module()
    for module in (ours, theirs):
        emitted(module, program)
    source, library = tmp_path / "run.c", tmp_path / "run.so"
    text = "\n".join(ours.texts).replace("static void run", "void run")
    source.write_text(f"#include <math.h>\n#include <stdint.h>\n{text}\n", encoding="utf-8")
    flags = [*FLAGS.split(), "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC"]
    subprocess.run(["gcc", *flags, "-o", library, source, "-lm"], check=True)
    code = compile_module(theirs)
    calls = [ctypes.CDLL(str(library)).run, ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 2)(code.address("run"))]
    random = np.random.default_rng(3)
    for _ in range(60):
        x = np.array([*random.choice(VALUES, 6), 3.0])
        found = []
        for call in calls:
            own, out = x.copy(), np.zeros(SIZE)
            call(*(ctypes.c_void_p(array.ctypes.data) for array in (own, out)))
            found.append(np.concatenate([own, out]))
        assert np.array_equal(*found, equal_nan=True)
        assert np.any(found[0][len(x) :] != 0.0)
