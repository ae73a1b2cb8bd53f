"""Sines, cosines and quadrature, beside those of 40 digits."""

import math
from decimal import Decimal, localcontext
from fractions import Fraction

import numpy as np
import pytest

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


@pytest.mark.parametrize("count", [1, 2, 5, 16])
def test_quadrature_is_exact_for_polynomials(count):
    nodes, weights = gauss_legendre(count)
    assert list(nodes) == sorted(nodes)
    for power in range(2 * count):
        integral = sum(Fraction(w) * Fraction(x) ** power for x, w in zip(nodes, weights, strict=True))
        assert float(integral) == pytest.approx(2.0 / (power + 1) if power % 2 == 0 else 0.0, abs=1e-15)
