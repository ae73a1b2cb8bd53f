"""Taylor series of instruction lists beside repeated differentiation by CasADi, with and without loops over the order."""

from __future__ import annotations

import ctypes

import casadi as ca
import numpy as np
import pytest

from mbd_sim.compiler.code.host_module import compile_module, new_module
from mbd_sim.compiler.lists.lowering import export, lower
from mbd_sim.compiler.taylor import expansion, recursion
from mbd_sim.compiler.taylor.rules import NotAnalyticError, series_of

ORDER = 7
t, inputs = ca.SX.sym("t"), ca.SX.sym("inputs", 2)
RULES = {
    "sums": lambda x, v: 2.0 * x + (v - x) - (-v) + x + x,
    "products": lambda x, v: x * v + inputs[0] * x + x * t,
    "squares": lambda x, v: x**2 + (x * v) ** 2,
    "quotients": lambda x, v: x / v + v / (1.5 + x * x) + 1.0 / v + v / inputs[1],
    "roots": lambda x, v: ca.sqrt(x + v) + ca.sqrt(t + 1.0),
    "sines": lambda x, v: ca.sin(x * v) + ca.cos(x * v) * ca.cos(v) + ca.sin(3.0 * t),
    "exponentials": lambda x, v: ca.exp(-x) * ca.log(v + x) + ca.exp(t * t),
    "tangents": lambda x, v: ca.tan(x / 2.0) + ca.tanh(v * x),
    "arcs": lambda x, v: ca.asin(x / 3.0) + ca.acos(x / v / 2.0) + ca.atan(v),
    "angles": lambda x, v: ca.atan2(x, v) + ca.atan2(x * v, -v),
    "powers": lambda x, v: v**2.5 + x**3 + v**-2 + v**x,
    "abs": lambda x, v: v * ca.fabs(x - v),
    "constants": lambda x, v: v * ca.fmax(inputs[0], inputs[1]) + x * ca.fabs(inputs[0]) + ca.if_else(inputs[1] > 0, x, v),
}  # fmt: skip
Y, T, INPUTS = np.array([0.7, 1.3, 0.4, -0.2]), 0.25, np.array([-0.8, 1.7])


def system(rule):
    """Four components: the second depends on the time, the third on the rule, the last one stays as it is."""
    y = ca.SX.sym("y", 4)
    x, v = y[0], y[1]
    slopes = ca.vertcat(v + 0.1 * y[2], -ca.sin(x) + 0.3 * t + y[3], rule(x, v), 0.0)
    return ca.Function("rates", [t, y, inputs], [slopes])


def differentiated(rates):
    """(order + 1, n): c_{k+1} is the rate of c_k along the solution, divided by k + 1."""
    time, y, given = rates.sx_in()
    slopes, coefficient, found = rates(time, y, given), y, [Y]
    for k in range(ORDER):
        rate = ca.jtimes(coefficient, y, slopes) + ca.jacobian(coefficient, time)
        coefficient = rate / (k + 1)
        found.append(np.array(ca.Function("c", [time, y, given], [coefficient])(T, Y, INPUTS)).ravel())
    return np.array(found)


def unrolled(module, rates):
    return lower(module, expansion.expansion(series_of(rates), 4, ORDER), inline=False)


def with_loops(module, rates):
    return recursion.emit_recursion(module, series_of(rates), 4, ORDER)


@pytest.mark.parametrize("rule", RULES)
def test_coefficients_are_those_of_repeated_differentiation(rule):
    rates = system(RULES[rule])
    expected = differentiated(rates)
    for emit in (unrolled, with_loops):
        module = new_module()
        export(module, "read", emit(module, rates))
        code, found, time = compile_module(module), np.empty((ORDER + 1, 4)), np.array([T])
        arrays = [time, Y, INPUTS, found]
        ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 4)(code.address("read"))(*(array.ctypes.data for array in arrays))
        np.testing.assert_allclose(found, expected, rtol=2e-13, atol=1e-14)


@pytest.mark.parametrize(
    ("name", "rule"),
    [
        ("max", lambda x, v: ca.fmax(x, 0.0)),
        ("sign", lambda x, v: ca.sign(x * v)),
        ("floor", lambda x, v: ca.if_else(inputs[0] > 0.0, x, ca.floor(v))),
        ("where", lambda x, v: ca.if_else(x, v, 1.0)),
        ("comparison", lambda x, v: (x > t) * v),
    ],
)  # fmt: skip
def test_what_has_no_series_is_refused(name, rule):
    with pytest.raises(NotAnalyticError) as refused:
        series_of(system(rule))
    assert (refused.value.operation, refused.value.result) == (name, 2)


def test_the_inverse_of_a_guarded_pivot_has_a_series():
    """As in `GuardedFactors`."""
    plain = series_of(system(lambda x, v: 1.0 / v))

    def guarded(x, v, floor):
        return (v > floor) / ca.fmax(v, floor)

    for floor in (lambda x: 1e-3, lambda x: 1e-3 * ca.fmax(1.0, x)):
        series = series_of(system(lambda x, v, floor=floor: guarded(x, v, floor(x))))
        assert np.array_equal(series.products(5), plain.products(5))
    with pytest.raises(NotAnalyticError):
        series_of(system(lambda x, v: (v > 1e-3) / ca.fmax(x, 1e-3)))
    with pytest.raises(NotAnalyticError):
        series_of(system(lambda x, v: guarded(x, v, x)))
