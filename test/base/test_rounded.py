"""Sines, cosines and quadrature, beside those of 40 digits."""

import math
from decimal import Decimal, localcontext
from fractions import Fraction

import mpmath
import numpy as np
import pytest

from mbd_sim.base import rounded
from mbd_sim.base.rounded import gauss_legendre, sine_cosine, sines_cosines


def exact_sine(angle):
    """The sine with 60 digits, by its series, which is summed exactly."""
    with localcontext() as context:
        context.prec = 120
        x, term, total = Decimal(angle), Decimal(angle), Decimal(angle)
        for n in range(1, 120):
            term *= -x * x / ((2 * n) * (2 * n + 1))
            total += term
        return total


def test_sines_and_cosines_are_rounded_once():
    random = np.random.default_rng(0)
    for angle in [*random.uniform(-20.0, 20.0, 60).tolist(), math.pi, 1e-8, -1e-300, 0.5 * math.pi]:
        sine, cosine = sine_cosine(angle)
        expected = exact_sine(angle)
        assert abs(Decimal(sine) - expected) <= Decimal(math.ulp(sine)) * Decimal("0.5000001")
        assert abs(cosine - math.cos(angle)) <= math.ulp(cosine)
    assert math.copysign(1.0, sine_cosine(-0.0)[0]) == -1.0
    assert sine_cosine(1e6) == pytest.approx((math.sin(1e6), math.cos(1e6)), rel=1e-15)
    assert np.array_equal(np.transpose(sines_cosines(np.array([0.0, 1.0]))), [sine_cosine(0.0), sine_cosine(1.0)])
    assert sine_cosine(1e300) == (math.sin(1e300), math.cos(1e300))
    with pytest.raises(ValueError, match=r"domain|finite"):
        sine_cosine(math.inf)


def arguments(name, random):
    """Arguments of all sizes, and some where the function is hard to compute."""
    small, any_size = (
        random.uniform(-1.0, 1.0, 40).tolist(),
        (random.normal(size=40) * 10.0 ** random.uniform(-9, 2, 40)),
    )
    close = [1.0 - 2.0**-53, 2.0**-53 - 1.0, 1e-9, 1e-300]
    match name:
        case "arc_sine" | "arc_cosine":
            return [(x,) for x in [*small, *close]]
        case "logarithm":
            return [(abs(x),) for x in [*any_size.tolist(), *close]]
        case "power":
            whole = [
                (x, float(n)) for x, n in zip(any_size.tolist(), random.integers(-9, 10, 40).tolist(), strict=True)
            ]
            return [
                *whole,
                *zip(np.abs(any_size).tolist(), any_size[::-1].tolist(), strict=True),
                (-1.1, 71.0),
                (2.0, 0.5),
            ]
        case "arc_tangent" | "hypotenuse":
            return [*zip(any_size.tolist(), any_size[::-1].tolist(), strict=True), (1e-12, 3.0), (1e-9, -3.0)]
        case _:
            return [(x,) for x in [*any_size.tolist(), *close]]


@pytest.mark.parametrize(
    ("name", "exact"),
    {
        "tangent": mpmath.tan,
        "arc_sine": mpmath.asin,
        "arc_cosine": mpmath.acos,
        "arc_tangent": mpmath.atan2,
        "exponential": mpmath.exp,
        "logarithm": mpmath.log,
        "hyperbolic_tangent": mpmath.tanh,
        "power": mpmath.power,
        "hypotenuse": mpmath.hypot,
    }.items(),
)
def test_functions_are_rounded_once(name, exact):
    with mpmath.workdps(80):
        for values in arguments(name, np.random.default_rng(1)):
            assert getattr(rounded, name)(*values) == float(exact(*map(mpmath.mpf, values))), values


@pytest.mark.parametrize(
    ("name", "values", "expected"),
    [
        ("power", (0.0, 0.0), 1.0),
        ("power", (0.0, -1.0), ValueError),
        ("power", (-2.0, 0.5), ValueError),
        ("power", (1e300, 2.0), OverflowError),
        ("power", (1e-300, 2.0), 0.0),
        ("power", (math.inf, -1.0), 0.0),
        ("power", (2, 3), 8.0),
        ("exponential", (1000.0,), OverflowError),
        ("exponential", (-1000.0,), 0.0),
        ("exponential", (-math.inf,), 0.0),
        ("logarithm", (0.0,), ValueError),
        ("arc_sine", (1.1,), ValueError),
        ("arc_cosine", (-1.0,), math.pi),
        ("arc_tangent", (-0.0, -1.0), -math.pi),
        ("arc_tangent", (1.0, math.inf), 0.0),
        ("tangent", (math.inf,), ValueError),
        ("hyperbolic_tangent", (-math.inf,), -1.0),
        ("hypotenuse", (-math.inf, math.nan), math.inf),
    ],
)
def test_limits_and_errors_are_those_of_the_library(name, values, expected):
    function = getattr(rounded, name)
    if isinstance(expected, type):
        with pytest.raises(expected):
            function(*values)
    else:
        assert function(*values) == expected
    assert math.isnan(function(*[math.nan] * len(values)))


@pytest.mark.parametrize("count", [1, 2, 5, 16])
def test_quadrature_is_exact_for_polynomials(count):
    nodes, weights = gauss_legendre(count)
    assert list(nodes) == sorted(nodes)
    for power in range(2 * count):
        integral = sum(Fraction(w) * Fraction(x) ** power for x, w in zip(nodes, weights, strict=True))
        assert float(integral) == pytest.approx(2.0 / (power + 1) if power % 2 == 0 else 0.0, abs=1e-15)


@pytest.mark.parametrize("count", (2, 5))
def test_radau_integrates_polynomials(count):
    """Those of degree below the number of nodes up to each, and below twice that less one up to the end."""
    nodes, rows = rounded.radau(count)
    for power in range(2 * count - 1):
        for node, row in zip(nodes, rows, strict=True):
            found = sum(a * c**power for a, c in zip(row, nodes, strict=True))
            if power < count or node == 1.0:
                assert found == pytest.approx(node ** (power + 1) / (power + 1), abs=2e-16)
