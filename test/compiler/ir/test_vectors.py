"""Operations on vectors of several components at once."""

from __future__ import annotations

import ctypes
import resource

import numpy as np
import pytest

from mbd_sim.compiler.code.host_module import compile_module, new_module
from mbd_sim.compiler.ir.builder import DOUBLE, INT, IRBuilder, local_array
from mbd_sim.compiler.ir.lanes import ComponentBuilder
from mbd_sim.compiler.ir.module import POINTER, VOID, Function, FunctionType
from mbd_sim.compiler.ir.vectors import cells, copy, folded, for_components, load, store, total
from mbd_sim.compiler.steps.loop import emit_is_finite

SIZES = (1, 2, 3, 4, 5, 7, 8, 11, 41, 63)  # the last ones are longer than what is unrolled
WEIGHTS = (0.1, -1.7)


def emit_sums(module, size, name, *, short):
    """Emit `name(x, y, target, largest)`: the weighted sums of x and y, and the largest of them and of the old number."""
    function = Function(module, FunctionType(VOID, [POINTER] * 4), name)
    x, y, target, largest = function.args
    b = IRBuilder(function.append_basic_block("entry"))

    def component(w, i):
        value = total(w, list(zip(WEIGHTS, (x, y), strict=True)), i)
        store(w, w.fadd(value, load(w, target, i)), target, i)
        most, before = w.largest(value) if isinstance(w, ComponentBuilder) else value, b.load(largest, typ=DOUBLE)
        b.store(b.select(b.fcmp_ordered(">", most, before), most, before), largest)

    for_components(b, size, component, short=short)
    b.ret_void()


@pytest.mark.parametrize("fast", [True, False])
def test_each_component_is_treated_once_with_the_same_bits(fast):
    module = new_module()
    module.fast = fast
    for size in SIZES:
        for short in (False, True):
            emit_sums(module, size, f"sums_{size}_{short}", short=short)
    code = compile_module(module)
    rng = np.random.default_rng(5)
    for size in SIZES:
        found = []
        x, y, start = rng.normal(size=(3, size))
        for short in (False, True):
            target, largest = np.append(start, 7.0), np.array([-9.0])  # one more number, which is not touched
            call = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 4)(code.address(f"sums_{size}_{short}"))
            call(x.ctypes.data, y.ctypes.data, target.ctypes.data, largest.ctypes.data)
            found.append((target.tobytes(), largest.tobytes()))
            assert target[:size] - start == pytest.approx(WEIGHTS[0] * x + WEIGHTS[1] * y, abs=1e-14)
            assert target[size] == 7.0
            assert largest[0] == pytest.approx(np.max(WEIGHTS[0] * x + WEIGHTS[1] * y), abs=1e-15)
        assert found[0] == found[1]


def emit_reading(module, size, name):
    """Emit `i64 name(x, target, sum)`: whether x is finite, its copy, and the sum of its components."""
    function = Function(module, FunctionType(INT, [POINTER] * 3), name)
    x, target, address = function.args
    b = IRBuilder(function.append_basic_block("entry"))
    memory = local_array(b, cells(b, size))
    copy(b, size, x, target)
    b.store(folded(b, size, memory, lambda w, number, i: w.fadd(number, load(w, x, i))), address)
    b.ret(b.zext(emit_is_finite(b, size, x, memory), INT))


@pytest.mark.parametrize("fast", [True, False])
def test_every_component_is_copied_and_counts_in_what_is_folded(fast):
    module = new_module()
    module.fast = fast
    for size in SIZES:
        emit_reading(module, size, f"reading_{size}")
    code = compile_module(module)
    for size in SIZES:
        call = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_void_p] * 3)(code.address(f"reading_{size}"))
        x, target, found = np.arange(1.0, size + 1.0), np.full(size + 1, 7.0), np.zeros(1)
        assert call(x.ctypes.data, target.ctypes.data, found.ctypes.data) == 1
        assert found[0] == size * (size + 1) / 2 and target.tolist() == [*x, 7.0]
        for place in range(size):
            for value in (np.nan, np.inf, -np.inf):
                x[place] = value
                assert call(x.ctypes.data, target.ctypes.data, found.ctypes.data) == 0
            x[place] = 1.0


def test_an_array_may_be_larger_than_the_stack_of_a_thread():
    """As the matrices of eight hundred contacts were, which ended the process."""
    size, module = 4_000_000, new_module()
    function = Function(module, FunctionType(VOID, [POINTER]), "far")
    b = IRBuilder(function.append_basic_block("entry"))
    first, second = local_array(b, size), local_array(b, size)
    for place in (0, size - 1):
        store(b, load(b, function.args[0], 0), first, place)
        store(b, load(b, first, place), second, place)
    store(b, load(b, second, size - 1), function.args[0], 1)
    b.ret_void()
    code = compile_module(module)
    call = ctypes.CFUNCTYPE(None, ctypes.c_void_p)(code.address("far"))
    numbers = np.array([3.5, 0.0])
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for _ in range(300):  # 20 GB if it were not freed, of which each call touches four pages
        call(numbers.ctypes.data)
    assert numbers[1] == 3.5
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 4000  # kB; 4,800 if it were not freed
