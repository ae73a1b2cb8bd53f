"""Files that are made to be slow: long chains and rings of parameters, and thousands of unknown names."""

import time

import pytest

from mbd_sim.base.errors import MAX_SHOWN, MechanismError
from mbd_sim.files.load import parse_mechanism

COUNT = 2500
LESS = 10  # the file that is compared with has as many times fewer entries
MOST = 25.0  # the ratio of the times; in proportion to the square it would be 100
BODY = (
    "parts: {a: {mass: 1, inertia: [1, 1, 1]}}\njoints: {j: {type: revolute, between: [ground, a], axis: [0, 0, 1]}}\n"
)


def with_parameters(expression, count):
    lines = "".join(f"  p{i}: {expression(i, count)}\n" for i in range(count))
    return f"mechanism: large\nparameters:\n  p{count}: 1\n{lines}{BODY}"


def with_unknown_parts(count):
    joints = "".join(f"  j{i}: {{type: fixed, between: [b{i}, c{i}]}}\n" for i in range(count))
    parts = "".join(f"  a{i}: {{mass: 1}}\n" for i in range(count))
    return f"mechanism: large\nparts:\n{parts}joints:\n{joints}"


def read(text):
    """The error of a file, None without one, and the processor time until it is there, in s."""
    start, found = time.process_time(), None
    try:
        parse_mechanism(text)
    except MechanismError as error:
        found = error
    return found, time.process_time() - start


@pytest.mark.parametrize(
    "expression",
    [lambda i, n: f"p{i + 1} + 1", lambda i, n: f"p{(i + 1) % n}", lambda i, n: f"q{i}", lambda i, n: f"1 u{i}"],
    ids=["chain", "ring", "unknown names", "unknown units"],
)
def test_thousands_of_parameters_are_read_in_proportion_to_their_number(expression):
    few, many = (read(with_parameters(expression, count)) for count in (COUNT // LESS, COUNT))
    for (error, _), count in ((few, COUNT // LESS), (many, COUNT)):
        if error is not None:
            assert len(error.problems) == count and len(str(error).splitlines()) == MAX_SHOWN + 1
    assert many[1] < MOST * few[1]


def test_thousands_of_unknown_parts_are_reported_in_proportion_to_their_number():
    few, many = (read(with_unknown_parts(count)) for count in (2000 // LESS, 2000))
    assert len(many[0].problems) == 4000 and "Did you mean 'a1'" in str(many[0])
    assert many[1] < MOST * few[1]
