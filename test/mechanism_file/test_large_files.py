"""Files that are made to be slow: long chains and rings of parameters, and thousands of unknown names."""

import time

import pytest

from mbd_sim.errors import MAX_SHOWN, MechanismError
from mbd_sim.load import parse_mechanism

COUNT = 10_000
LONGEST = 2.0  # s of processor time; all of these took between 3 s and several minutes
BODY = (
    "parts: {a: {mass: 1, inertia: [1, 1, 1]}}\njoints: {j: {type: revolute, between: [ground, a], axis: [0, 0, 1]}}\n"
)


def with_parameters(expression):
    lines = "".join(f"  p{i}: {expression(i)}\n" for i in range(COUNT))
    return f"mechanism: large\nparameters:\n  p{COUNT}: 1\n{lines}{BODY}"


@pytest.mark.parametrize(
    "expression",
    [lambda i: f"p{i + 1} + 1", lambda i: f"p{(i + 1) % COUNT}", lambda i: f"q{i}", lambda i: f"1 u{i}"],
    ids=["chain", "ring", "unknown names", "unknown units"],
)
def test_thousands_of_parameters_are_read_in_two_seconds(expression):
    text = with_parameters(expression)
    start = time.process_time()
    try:
        parse_mechanism(text)
    except MechanismError as error:
        assert len(error.problems) == COUNT and len(str(error).splitlines()) == MAX_SHOWN + 1
    assert time.process_time() - start < LONGEST


def test_thousands_of_unknown_parts_are_reported_in_two_seconds():
    joints = "".join(f"  j{i}: {{type: fixed, between: [b{i}, c{i}]}}\n" for i in range(4000))
    parts = "".join(f"  a{i}: {{mass: 1}}\n" for i in range(4000))
    start = time.process_time()
    with pytest.raises(MechanismError, match="Did you mean 'a1'") as caught:
        parse_mechanism(f"mechanism: large\nparts:\n{parts}joints:\n{joints}")
    assert time.process_time() - start < LONGEST
    assert len(caught.value.problems) == 8000
