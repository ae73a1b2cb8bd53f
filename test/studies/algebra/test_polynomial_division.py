"""Quotients in the ring of reduced polynomials, where squares of some generators are replaced."""

from fractions import Fraction

import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from mbd_sim.studies.algebra.evaluation import expression
from mbd_sim.studies.algebra.polynomial import Algebra, quotient, without_denominators

ONE = {(): Fraction(1)}


def quaternion():
    """An algebra with a unit quaternion, and its four components."""
    algebra = Algebra()
    symbols = sp.symbols("w x y z", real=True)
    w, *vector = (algebra.generator(symbol) for symbol in symbols)
    algebra.squares[w] = ONE | {((number, 2),): Fraction(-1) for number in vector}
    return algebra, [algebra.symbol(symbol) for symbol in symbols]


def combined(algebra, components, factors):
    """Σ factor · product of two components."""
    total = {}
    pairs = [(a, b) for place, a in enumerate(components) for b in components[place:]]
    for factor, (a, b) in zip(factors, pairs, strict=True):
        total = algebra.add(total, algebra.scaled(algebra.multiply(a, b), factor))
    return total


factors = st.lists(st.integers(-3, 3), min_size=10, max_size=10)


@settings(max_examples=25)
@given(factors, factors)
def test_a_product_is_divided_by_its_factors(first, second):
    algebra, components = quaternion()
    p, q = combined(algebra, components, first), combined(algebra, components, second)
    if p and q:
        assert quotient(algebra, algebra.multiply(p, q), q) == p


def test_what_has_no_quotient_gives_none():
    algebra, (w, x, y, _) = quaternion()
    assert quotient(algebra, algebra.add(w, x), algebra.add(w, y)) is None
    assert quotient(algebra, x, algebra.multiply(x, y)) is None
    assert quotient(algebra, algebra.inverse(y, lambda _: None), y) is None


def test_roots_leave_denominators_that_divide():
    algebra, (w, x, y, z) = quaternion()
    lean = algebra.scaled(algebra.add(algebra.multiply(w, x), algebra.multiply(y, z)), 2)
    square = algebra.add(ONE, algebra.multiply(lean, lean), -1)
    root = algebra.root(sp.sqrt(expression(algebra, square)), square)
    ((monomial, _),) = root.items()
    ((number, _),) = monomial
    below = {((number, -1),): Fraction(1)}
    assert without_denominators(algebra, algebra.multiply(square, below)) == root
    cubed = algebra.multiply(algebra.multiply(square, x), {((number, -3),): Fraction(1)})
    assert without_denominators(algebra, cubed) == algebra.multiply(x, below)
    assert without_denominators(algebra, algebra.multiply(x, below)) == algebra.multiply(x, below)
