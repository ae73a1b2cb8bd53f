"""Formulas of numbers are found from samples, exactly or not at all."""

from fractions import Fraction

import numpy as np
import pytest

from mbd_sim.studies.algebra.formulas import Factor, Formula, ParameterSamples, formulas
from mbd_sim.studies.algebra.polynomial import Exact

START = np.array([1.3, 0.7, 0.4])


def found(function):
    """The formula of a function of three parameters a, b, c."""
    random = np.random.default_rng(1)

    def draw(count, free):
        parameters = np.where(free, START * 2.0 ** random.uniform(-1, 1, (count, 3)), START)
        return parameters, function(*parameters.T)[:, None] * np.ones((count, 1))

    slices = [draw(12, np.arange(3) == index) for index in range(3)]
    (formula,) = formulas(ParameterSamples(slices, draw(80, np.full(3, True))), np.ones(1))
    return formula


def power(parameter, exponent=1, kind="power"):
    return Factor(kind, parameter, Fraction(exponent))


def test_a_product_of_powers():
    assert found(lambda a, b, c: a * b**2 / 12) == Formula(((Exact(Fraction(1, 12)), (power(0), power(1, 2))),))


def test_a_sum_with_a_quotient_and_a_half_power():
    formula = found(lambda a, b, c: 2 * a / b - np.sqrt(c) / 7)
    assert {term: c.ratio for c, term in formula.terms} == {
        (power(0), power(1, -1)): 2,
        (power(2, Fraction(1, 2)),): Fraction(-1, 7),
    }


def test_angles_and_roots_of_numbers():
    formula = found(lambda a, b, c: np.sqrt(3) * a * np.sin(c) + np.pi * b)
    assert {term: c for c, term in formula.terms} == {
        (power(0), power(2, kind="sin")): Exact(Fraction(1), 3),
        (power(1),): Exact(Fraction(1), 1, 1),
    }


def test_the_root_of_a_sum():
    formula = found(lambda a, b, c: -np.hypot(a, b))
    assert formula.root == -1 and {term for _, term in formula.terms} == {(power(0, 2),), (power(1, 2),)}


def test_a_constant_and_zero():
    assert found(lambda a, b, c: 0.25 + 0 * a) == Formula(((Exact(Fraction(1, 4)), ()),))
    assert found(lambda a, b, c: 1e-17 * a) == Formula(())


@pytest.mark.parametrize("function", [lambda a, b, c: np.exp(a), lambda a, b, c: 1 / (a + b), lambda a, b, c: a**b])
def test_what_has_no_short_formula_has_none(function):
    assert isinstance(found(function), int)


def test_equal_numbers_without_a_formula_share_an_index():
    random = np.random.default_rng(1)
    parameters = random.uniform(1, 2, (80, 1))
    numbers = np.exp(parameters) * [1.0, 1.0, 2.0]
    samples = ParameterSamples([(parameters[:12], numbers[:12])], (parameters, numbers))
    first, second, third = formulas(samples, np.ones(3))
    assert first == second != third
