"""Compiled functions as callables: new arrays and records with the numbers of CasADi's own evaluation."""

import gc
import weakref
from typing import NamedTuple

import casadi as ca
import numpy as np
import pytest

from mbd_sim.base.geometry.pose import Pose
from mbd_sim.compiler.python.bound_call import CompiledFunction

NAMES = ("first", "second")


class Pair(NamedTuple):
    """Two arrays."""

    one: np.ndarray
    other: np.ndarray


@pytest.fixture(scope="module")
def function():
    """(t, y (2,), inputs (3,)) -> 24 numbers."""
    t, y, inputs = ca.SX.sym("t"), ca.SX.sym("y", 2), ca.SX.sym("inputs", 3)
    numbers = [(k + 1) * t + y[k % 2] * inputs[k % 3] for k in range(24)]
    return ca.Function("f", [t, y, inputs], [ca.vertcat(*numbers)])


@pytest.fixture(scope="module")
def compiled(function):
    return CompiledFunction.of(lambda: function)


class Memory:
    """What a simulation keeps in its place."""

    def __init__(self):
        self.clock = np.array([3], dtype=np.int64), np.array([0.25])
        self.y, self.inputs = np.array([2.0, -1.0]), np.array([0.5, 4.0, 8.0])
        self.arrays = self.y, self.inputs

    def expected(self, function):
        """By CasADi; all numbers are small multiples of 1/8, so that nothing is rounded."""
        return np.array(function(self.clock[0][0] * self.clock[1][0], self.y, self.inputs)).ravel()

    def move(self):
        """Another moment and state."""
        self.clock[0][0] += 2
        self.y += 0.25
        self.inputs[1] -= 1.0


@pytest.mark.parametrize(
    ("shape", "rows"),
    [
        ((24,), slice(None)), ((24,), slice(3)), ((24,), slice(3, 6)), ((24,), slice(24, None)), ((-1,), slice(20, 24)),
        ((4, 6), slice(None)), ((8, 3), slice(1, 4)), ((-1, 3), slice(7, None)), ((2, 4, 3), slice(None)), ((2, 4, 3), slice(1, 2)),
    ],
)  # fmt: skip
def test_arrays_are_new_ones_with_casadis_numbers(function, compiled, shape, rows):
    memory = Memory()
    read = compiled.bound(memory.clock, memory.arrays, shape, rows)
    kept = []
    for _ in range(3):
        expected = memory.expected(function).reshape(shape)[rows]
        found = read()
        assert found.tobytes() == expected.tobytes() and found.shape == expected.shape
        assert type(found) is np.ndarray and found.dtype == float
        assert found.flags.c_contiguous and found.flags.writeable and found.flags.owndata and found.flags.aligned
        kept.append((found, expected))
        memory.move()
    assert all(found.tobytes() == expected.tobytes() for found, expected in kept)


@pytest.mark.parametrize(
    ("record", "fields"),
    [(Pose, ((3,), (3, 3))), (Pair, ((6,), (2, 3))), (Pair, ((5,), (7,))), (Pair, ((1, 12), (0,)))],
)
def test_records_have_new_arrays_column_by_column(function, compiled, record, fields):
    memory = Memory()
    read = compiled.bound_records(memory.clock, memory.arrays, NAMES, record, fields)
    kept = []
    for _ in range(3):
        found, numbers = read(), list(memory.expected(function))
        assert type(found) is dict and tuple(found) == NAMES
        for one in found.values():
            assert type(one) is record
            for array, shape in zip(one if record is Pair else (one.position, one.rotation), fields, strict=True):
                size = int(np.prod(shape))
                expected = np.array(numbers[:size]).reshape(shape, order="F")
                del numbers[:size]
                assert array.shape == shape and array.tolist() == expected.tolist()
                assert array.flags.f_contiguous and array.flags.writeable
                kept.append((array, expected))
        memory.move()
    assert all(array.tolist() == expected.tolist() for array, expected in kept)


def test_no_records():
    empty = CompiledFunction.of(lambda: ca.Function("f", [ca.SX.sym("t"), ca.SX.sym("y", 2)], [ca.SX(0, 1)]))
    memory = Memory()
    assert empty.bound_records(memory.clock, (memory.y,), (), Pose, ((3,), (3, 3)))() == {}
    assert empty.bound(memory.clock, (memory.y,), (0,))().shape == (0,)
    assert empty.bound(memory.clock, (memory.y,), (0, 6))().shape == (0, 6)


def test_results_are_referred_to_by_their_caller_alone(compiled):
    memory = Memory()
    read = compiled.bound_records(memory.clock, memory.arrays, NAMES, Pair, ((6,), (2, 3)))
    found = read(), compiled.bound(memory.clock, memory.arrays, (4, 6))()
    gone = [weakref.ref(array) for pair in found[0].values() for array in pair] + [weakref.ref(found[1])]
    assert len(gone) == 5 and not any(array() is None for array in gone)
    del found
    assert all(array() is None for array in gone)  # at once, without the garbage collector


def test_a_record_may_read_and_move_what_it_is_made_of(compiled, function):
    memory, inner = Memory(), []

    def record(one, other):
        if len(inner) < 2:
            memory.move()
            inner.append(None)
            inner[-1] = read()
        return Pair(one, other)

    read = compiled.bound_records(memory.clock, memory.arrays, NAMES, record, ((6,), (6,)))
    expected = memory.expected(function)
    found = read()
    numbers = np.concatenate([array for name in NAMES for array in found[name]])
    assert numbers.tolist() == expected.tolist()
    assert inner[1]["first"].one.tolist() != found["first"].one.tolist()


def test_a_callable_keeps_what_it_reads(function):
    gc.freeze()  # what other tests keep is not searched
    memory = Memory()
    gone, expected = weakref.ref(memory.y), memory.expected(function)
    read = CompiledFunction.of(lambda: function).bound(memory.clock, memory.arrays, (24,))
    del memory
    gc.collect()
    assert gone() is not None and read().tolist() == expected.tolist()
    del read
    gc.collect()
    assert gone() is None
