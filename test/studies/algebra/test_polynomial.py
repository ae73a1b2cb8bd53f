"""Products of polynomials: reduced by the squares known at the time, and counted."""

from fractions import Fraction
from math import prod

import pytest
import sympy as sp

from mbd_sim.studies.algebra import polynomial
from mbd_sim.studies.algebra.evaluation import expression
from mbd_sim.studies.algebra.polynomial import Algebra, TooLargeError

HALF = Fraction(1, 2)


def circle():
    """sin q/2 + cos q/3 and its algebra."""
    algebra, q = Algebra(), sp.Symbol("q", real=True)
    sine, cosine = algebra.sine_cosine(q, sp.sin(q), sp.cos(q))
    return algebra, algebra.add(algebra.scaled(sine, HALF), algebra.scaled(cosine, Fraction(1, 3)))


def test_a_power_has_the_exact_values_and_no_square_of_a_sine():
    algebra, p = circle()
    (sine,) = (number for number, (kind, _) in algebra.angles.items() if kind == "sin")
    power = algebra.power(p, 7)
    assert all(dict(monomial).get(sine, 0) < 2 for monomial in power)
    for s, c in (
        (Fraction(3, 5), Fraction(4, 5)),
        (Fraction(-5, 13), Fraction(12, 13)),
        (Fraction(8, 17), Fraction(-15, 17)),
    ):
        found = sum(value * prod((s if n == sine else c) ** k for n, k in key) for key, value in power.items())
        assert found == (HALF * s + c / 3) ** 7


def test_a_square_that_is_defined_later_applies_from_then_on():
    algebra = Algebra()
    root, x = sp.Symbol("r"), algebra.symbol(sp.Symbol("x"))
    r = algebra.symbol(root)
    assert expression(algebra, algebra.power(r, 2)) == root**2
    algebra.root(root, x)
    assert algebra.power(r, 4) == algebra.power(x, 2)
    algebra.define_square(algebra.generator(root), algebra.scaled(x, 2))
    assert algebra.power(r, 4) == algebra.scaled(algebra.power(x, 2), 4)


def test_products_count_each_time_so_that_a_limit_does_not_depend_on_what_was_computed_before(monkeypatch):
    algebra, p = circle()
    cube = algebra.power(p, 3)
    before = algebra.products
    algebra.multiply(cube, cube)
    once = algebra.products - before
    algebra.multiply(cube, cube)
    assert algebra.products == before + 2 * once
    monkeypatch.setattr(polynomial, "MAX_PRODUCTS", before + 3 * once - 1)
    with pytest.raises(TooLargeError):
        algebra.multiply(cube, cube)
