"""Floats as the exact numbers that they stand for."""

import math
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbd_sim.studies.algebra.polynomial import Exact, exact


@pytest.mark.parametrize(
    ("value", "number"),
    [
        (1 / 3, Exact(Fraction(1, 3))),
        (0.1 + 0.2, Exact(Fraction(3, 10))),
        (-9.81, Exact(Fraction(-981, 100))),
        (0.33333, Exact(Fraction(33333, 100000))),
        (math.cos(math.pi / 6), Exact(Fraction(1, 2), 3)),
        (-math.sqrt(0.5), Exact(Fraction(-1, 2), 2)),
        (2 * math.pi * 5, Exact(Fraction(10), 1, 1)),
        (0.02 / (2 * math.pi), Exact(Fraction(1, 100), 1, -1)),
        (0.12345678901, Exact(Fraction("0.12345678901"))),
    ],
)
def test_what_people_write_is_recognized(value, number):
    assert exact(value) == number


@given(st.floats(allow_nan=False, allow_infinity=False, min_value=-1e6, max_value=1e6).filter(lambda x: abs(x) > 1e-9))
def test_no_number_is_changed_by_more_than_its_rounding(value):
    number = exact(value)
    again = float(number.ratio) * math.sqrt(number.radicand) * math.pi**number.pi
    assert abs(again - value) <= 2e-12 * abs(value)
