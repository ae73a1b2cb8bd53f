"""The coefficients of Adams methods, and their order where no step falls back to the other method."""

from __future__ import annotations

import math
from fractions import Fraction

import casadi as ca
import numpy as np
import pytest

from mbd_sim.compiler.kernel import compile_kernel
from mbd_sim.compiler.steps.adams_history import COUNT, VECTORS
from mbd_sim.integrators.explicit import ADAMS, EXPLICIT, LOWER, adams

METHOD = ADAMS["adams11"]


def test_coefficients_are_those_of_the_textbook():
    """Of Adams–Bashforth with four steps and Adams–Moulton of order 5 (Hairer, Nørsett & Wanner I, sec. III.1)."""
    method = adams("four", 4, 1.0, EXPLICIT["rk4"])
    assert method.predictor == tuple(float(Fraction(n, 24)) for n in (55, -59, 37, -9))
    assert method.corrector == tuple(float(Fraction(n, 720)) for n in (646, -264, 106, -19))
    assert method.newest == 251 / 720


@pytest.mark.parametrize("degree", range(METHOD.length + 1))
def test_polynomials_are_integrated_exactly(degree):
    """∫₀¹ xⁿ dx from the slopes at 0, −1, −2 …, up to the round-off of a sum of such terms."""
    slopes = [float((-back) ** degree) for back in range(METHOD.length)]
    exact = 1.0 / (degree + 1)
    for weights, newest in ((METHOD.predictor, 0.0), (METHOD.corrector, METHOD.newest)):
        terms = [weight * slope for weight, slope in zip(weights, slopes, strict=True)]
        error = math.fsum([*terms, newest, -exact])
        is_exact = abs(error) <= 1e-15 * math.fsum(map(abs, terms)) + 1e-15
        assert is_exact == (degree < METHOD.length or newest > 0.0)


def test_differences_of_lower_order_vanish_for_polynomials():
    for order, weights in zip(LOWER, METHOD.differences, strict=True):
        for degree in range(order + 1):
            extrapolated = math.fsum(w * (-back) ** degree for back, w in enumerate(weights))
            assert (extrapolated == 1.0**degree) == (degree < order)


def test_slopes_between_others_are_those_of_a_polynomial():
    """Of degree 10, through eleven slopes; of degree 11, at places where it does not vanish, they are not."""
    for back, weights in enumerate(METHOD.midpoints):
        at = -0.5 - back
        for degree in range(METHOD.length + 2):
            values = [float((1 - index) ** degree) for index in range(METHOD.length + 1)]
            terms = [weight * value for weight, value in zip(weights, values, strict=True)]
            error = abs(math.fsum([*terms, -(at**degree)]))
            is_exact = error <= 1e-15 * math.fsum(map(abs, terms))
            assert is_exact == (degree <= METHOD.length)
    assert len(METHOD.midpoints) == METHOD.length // 2


@pytest.mark.parametrize("length", [3, 5, 7])
def test_the_order_of_steps_that_do_not_fall_back(length):
    """Of an oscillator y'' = −y whose history begins with slopes of the exact motion."""
    method = adams("free", length, math.inf, EXPLICIT["tsitouras8"])
    t, y, inputs = ca.SX.sym("t"), ca.SX.sym("y", 2), ca.SX.sym("e", 1)
    kernel = compile_kernel(ca.Function("rates", [t, y, inputs], [ca.vertcat(y[1], -y[0])]), None, {}, method)
    errors = []
    for h in (0.1, 0.05):
        state, memory = np.array([1.0, 0.0]), np.zeros(1 + method.history_size(2, 1))
        kept_state, steps = memory[1 + VECTORS : 1 + VECTORS + 2], round(4.0 / h)
        for step in range(length):
            kept_state[:] = state[:] = math.cos(step * h), -math.sin(step * h)
            assert kernel.advance(state.ctypes.data, memory.ctypes.data, step, h, 1)
        kept_state[:] = state[:] = math.cos(length * h), -math.sin(length * h)
        assert memory[1 + COUNT] == length
        assert kernel.advance(state.ctypes.data, memory.ctypes.data, length, h, steps)
        errors.append(abs(state[0] - math.cos((length + steps) * h)))
    assert 2.0 ** (method.order - 0.4) < errors[0] / errors[1] < 2.0 ** (method.order + 0.4)
