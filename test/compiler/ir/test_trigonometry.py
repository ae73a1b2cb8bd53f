"""Sine and cosine of the kernels against sixty-digit arithmetic."""

from __future__ import annotations

import math
from decimal import Decimal, localcontext

import casadi as ca
import numpy as np
import pytest

from mbd_sim.compiler.kernel import compile_kernel
from mbd_sim.compiler.lists import lowering
from mbd_sim.integrators.methods import METHODS

LARGEST = 2.0**20 * math.pi / 2.0


@pytest.fixture(scope="module", params=[lowering.INLINE_SINES, 0], ids=["inlined", "called"])
def sine_cosine(request):
    """The compiled pair as a function of a float, inlined as in short functions, or called as in long ones."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lowering, "INLINE_SINES", request.param)
        return compiled_pair()


def compiled_pair():
    t, y, inputs, x = (ca.SX.sym(name) for name in ("t", "y", "e", "x"))
    rates = ca.Function("rates", [t, y, inputs], [y])
    pair = ca.Function("pair", [x], [ca.vertcat(ca.sin(x), ca.cos(x))])
    kernel = compile_kernel(rates, None, {"pair": pair}, METHODS["euler"])

    def call(angle):
        angle, out = np.array([angle]), np.empty(2)
        kernel.readers["pair"](angle.ctypes.data, out.ctypes.data)
        return out.tolist()

    return call


def arctan_of_inverse(n, scale):
    term = total = scale // n
    k, sign = 3, -1
    while term:
        term //= n * n
        total += sign * (term // k)
        k, sign = k + 2, -sign
    return total


DIGITS = 70
_SCALE = 10 ** (DIGITS + 10)
with localcontext(prec=DIGITS):  # Machin's formula
    PI = Decimal(4 * (4 * arctan_of_inverse(5, _SCALE) - arctan_of_inverse(239, _SCALE))) / _SCALE


def exact(angle):
    """Sine and cosine with 60 digits, for |angle| < 1e7."""
    with localcontext(prec=DIGITS):
        quarters = (Decimal(angle) / (PI / 2)).to_integral_value()
        r = Decimal(angle) - quarters * PI / 2
        square = r * r

        def series(term, k):
            total = term
            while term and abs(term) > abs(total).scaleb(-40):
                term = -term * square / (k * (k + 1))
                total, k = total + term, k + 2
            return total

        s, c = series(r, 2), series(Decimal(1), 1)
        return ((s, c), (c, -s), (-s, -c), (-c, s))[int(quarters) % 4]


def errors(found, angle):
    """In units of the last place of the exact values."""
    return [
        float(abs(Decimal(value) - true) / Decimal(math.ulp(float(true))))
        for value, true in zip(found, exact(angle), strict=True)
    ]


# k for which the double nearest to k pi/2 comes closest to it, found by trying all up to 2^20
WORST_QUARTERS = (29, 58, 116, 232, 464, 928, 1856, 204551, 409102, 818204, 263205, 526410, 145897)


def near_quarters():
    """The doubles closest to multiples of pi/2, where one of the two is smallest; among them the worst below 2^20."""
    rng = np.random.default_rng(30)
    for k in sorted({*range(1, 60), *WORST_QUARTERS, *rng.integers(60, 2**20, 300).tolist()}):
        with localcontext(prec=DIGITS):
            angle = float(k * PI / 2)
        yield from (angle, math.nextafter(angle, 0.0), -angle)


def test_known_values():
    assert str(PI) == "3.141592653589793238462643383279502884197169399375105820974944592307816"
    with localcontext(prec=30):
        half = exact(math.pi / 6)[0]
    assert float(half) == 0.49999999999999994  # pi/6 as a double is a little less than pi/6


@pytest.mark.parametrize(
    "angles",
    [
        np.random.default_rng(31).uniform(-1.0, 1.0, 400),
        np.random.default_rng(32).uniform(-100.0, 100.0, 600),
        np.random.default_rng(33).uniform(-LARGEST, LARGEST, 600),
        np.random.default_rng(34).uniform(0.9 * LARGEST, LARGEST, 400),
        10.0 ** np.random.default_rng(35).uniform(-320.0, 0.0, 200),
        math.pi / 4 * np.arange(1, 200, 2),
    ],
    ids=["unit", "turns", "large", "largest", "small", "octants"],
)
def test_error_in_units_of_the_last_place(sine_cosine, angles):
    assert max(max(errors(sine_cosine(float(angle)), float(angle))) for angle in angles) < 0.8


def test_error_next_to_multiples_of_a_quarter_turn(sine_cosine):
    found = [max(errors(sine_cosine(angle), angle)) for angle in near_quarters()]
    assert max(found) < 0.8


def test_symmetry(sine_cosine):
    for angle in np.random.default_rng(36).uniform(0.0, 1e6, 500):
        s, c = sine_cosine(float(angle))
        assert sine_cosine(-float(angle)) == [-s, c]


def test_zeros_keep_their_sign(sine_cosine):
    assert [math.copysign(1.0, value) for value in sine_cosine(0.0)] == [1.0, 1.0]
    assert [math.copysign(1.0, value) for value in sine_cosine(-0.0)] == [-1.0, 1.0]
    assert sine_cosine(-0.0) == [0.0, 1.0]


def test_the_smallest_numbers_are_their_own_sine(sine_cosine):
    for angle in (5e-324, -5e-324, 2.2250738585072014e-308, 1e-200, 1e-9):
        assert sine_cosine(angle) == [angle, 1.0]


def test_what_is_not_finite_gives_nan(sine_cosine):
    for angle in (math.inf, -math.inf, math.nan):
        assert all(math.isnan(value) for value in sine_cosine(angle))


def test_huge_angles_are_those_of_the_c_library(sine_cosine):
    rng = np.random.default_rng(37)
    for angle in [
        LARGEST,
        math.nextafter(LARGEST, 0.0),
        1e22,
        1.7976931348623157e308,
        *10.0 ** rng.uniform(6.3, 308, 200),
    ]:
        s, c = sine_cosine(float(angle))
        assert [s, c] == pytest.approx([math.sin(angle), math.cos(angle)], rel=3e-16)
        if abs(angle) >= LARGEST:
            assert [s, c] == [math.sin(angle), math.cos(angle)]


def test_squares_add_up_to_one(sine_cosine):
    for angle in np.random.default_rng(38).uniform(-1e6, 1e6, 2000):
        s, c = sine_cosine(float(angle))
        assert abs(s * s + c * c - 1.0) < 4e-16
