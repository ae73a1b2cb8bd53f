"""Functions in a subset of Python: compiled, they have the results that they have as Python."""

from __future__ import annotations

import ctypes
import math
from dataclasses import dataclass
from typing import cast

import numpy as np
import pytest

from mbd_sim.compiler.code.host_module import compile_module, new_module
from mbd_sim.compiler.ir.python_functions import emit_function
from mbd_sim.compiler.ir.python_kinds import (
    Array,
    External,
    Integers,
    integers,
    name_of,
    packed,
    prototype,
    signature_of,
    zeros,
)

LIMIT = 3
HALF = External("float", ("float",))


@dataclass(frozen=True)
class Record:
    """Numbers of all kinds."""

    count: int
    factor: float
    flag: bool
    values: Array
    order: Integers
    half: int


def compiled(function):
    module = new_module()
    emit_function(module, function, exported=True)
    code = compile_module(module)
    bound = prototype(*signature_of(function))(code.address(name_of(function)))

    def call(*arguments):
        """With the code, which must outlive the call."""
        assert code is not None
        return bound(*(one.ctypes.data if isinstance(one, np.ndarray) else one for one in arguments))

    return call


def numbers_of(x: float, y: float) -> float:
    """All operations on numbers, whose order and rounding matter."""
    total = x * y + 0.1 - y / 3.0
    total += abs(-x) - math.sqrt(abs(y)) * LIMIT
    total *= -1.0 if x < y <= 2.0 * y else 2.0
    if not math.isfinite(1.0 / x) or x == y:
        return -math.inf
    return max(total, min(x, y)) + (1.0 if x in (0.5, y) else 0.0)


@pytest.mark.parametrize("pair", [(0.3, 0.7), (0.5, -2.5), (0.1, 0.1), (-0.0, 1.0), (1e300, 1e-300), (math.nan, 2.0)])
def test_operations_have_the_bits_of_python(pair):
    with np.errstate(divide="ignore"):
        expected = numbers_of(*map(np.float64, pair))
    assert np.float64(compiled(numbers_of)(*pair)).tobytes() == np.float64(expected).tobytes()


def counts(n: int, found: Integers) -> int:
    """Loops with all ways out of them, and variables that they change."""
    total, position = 0, 0
    for i in range(n - 1, -1, -1):
        if i % 3 == 1:
            continue
        for j in range(i):
            if j > LIMIT or (i > 5 and not j < i):
                break
            total += i * j
            found[position] = total
            position += 1
    while position < n and total != 0:
        found[position] = -total
        position += 1
    for i in range(0, n, 2):
        if found[i] == 7 and any(found[k] == i for k in range(i)):
            return -1
    return total


@pytest.mark.parametrize("n", [0, 1, 4, 9])
def test_loops_end_where_they_do_in_python(n):
    expected, found = np.zeros(100, dtype=np.int64), np.zeros(100, dtype=np.int64)
    assert compiled(counts)(n, found) == counts(n, expected)
    assert found.tolist() == expected.tolist()


def sum_of(r: Record, first: int) -> float:
    """The values of a record in an order."""
    total, values = 0.0, r.values[first:]
    for i in range(r.count):
        total += r.factor * values[r.order[i]]
    return total if r.flag else -total


def with_records(slots: Integers, values: Array, n: int) -> float:
    """Records that are made, or whose slots are given; new arrays; and code elsewhere."""
    given = cast("Record", slots)
    order, doubled = integers(n), zeros(n)
    for i in range(n):
        order[i] = n - 1 - i
        doubled[i] = 2.0 * values[i]
    made = Record(n, given.factor, not given.flag, doubled, order, given.half)
    values[0], values[1] = values[1], values[0]
    return sum_of(made, 0) + HALF(given.half, sum_of(given, 1))


def test_records_and_arrays_are_passed_on():
    half = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double)(lambda x: 0.5 * x)
    address = ctypes.cast(half, ctypes.c_void_p).value
    values, order = np.array([1.0, 2.0, 4.0, 8.0]), np.array([2, 0], dtype=np.int64)
    record = Record(2, 0.25, True, values, order, address)
    found = compiled(with_records)(packed(record), values, 3)
    assert values.tolist() == [2.0, 1.0, 4.0, 8.0]
    assert found == -0.25 * (8.0 + 4.0 + 2.0) + 0.5 * 0.25 * (8.0 + 1.0)


def ends_of(n: int) -> float:
    """What is at both ends of new arrays, on several ways out."""
    values, order = zeros(n), integers(n)
    values[0], values[n - 1], order[n - 1] = 1.5, 2.5, n
    if n > 5:
        return values[0] + values[n - 1] + order[n - 1]
    return values[n // 2]


def test_arrays_of_any_size_are_new_and_need_no_stack():
    """8 MB each, as much as the stack of a thread."""
    call = compiled(ends_of)
    assert [call(n) for n in (5, 6, 1_000_000)] == [0.0, 10.0, 1_000_004.0]


def new_array_in_loop(n: int) -> int:
    """It would use up the stack."""
    for i in range(n):
        zeros(i)
    return n


def of_two_kinds(n: int) -> int:
    """A variable that becomes a number."""
    total = n
    total = 0.5
    return int(total)


def without_result(n: int) -> int:  # noqa: RET503
    """A way without a result."""
    if n > 1:
        return n


def with_list(n: int) -> int:
    """Not in the subset."""
    return len([n])


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (new_array_in_loop, "a new array within a loop"),
        (of_two_kinds, "float as int"),
        (without_result, "a path without a result"),
        (with_list, r"\[n\]"),
    ],
)
def test_what_cannot_be_compiled_is_refused_with_its_line(function, message):
    with pytest.raises(NotImplementedError, match=rf"line \d+ of {__name__}: .*{message}"):
        compiled(function)
