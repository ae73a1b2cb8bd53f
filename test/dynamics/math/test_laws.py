"""Laws of springs, dampers, friction and stops, as expressions: values, potentials, derivatives, signs."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from mbd_sim.dynamics.forces.joints import stop_forces
from mbd_sim.dynamics.math.laws import elastic, friction, power_law
from mbd_sim.mechanism.elements.parts import Limits
from mbd_sim.mechanism.values.expression import TimeExpression
from mbd_sim.mechanism.values.laws import Expressed, Friction, Linear, PowerLaw
from mbd_sim.mechanism.values.tables import tabulated

X = ca.SX.sym("x")
# Forces, their potentials in a form without cancellation, and the range in which they are evaluated.
HARDENING = ("10*x + 400*x**3", lambda x: 5 * x**2 + 100 * x**4, (-20, 20))
STEEP = ("3*x/(1e-4 + x**2)", lambda x: 1.5 * np.log1p(x**2 / 1e-4), (-20, 20))
GROWING = ("exp(x/0.01)", lambda x: 0.01 * np.expm1(x / 0.01), (-1, 4))  # overflows within the range
MORSE = ("(1 - exp(-2*x))*exp(-2*x)", lambda x: np.expm1(-2 * x) ** 2 / 4, (-1, 20))
WAVES = ("2 + sin(50*x)", lambda x: 2 * x + np.sin(25 * x) ** 2 / 25, (-20, 20))
GAP = ("max(0, 50*(x - 0.1)) + min(0, 50*(x + 0.1))", lambda x: 25 * max(abs(x) - 0.1, 0) ** 2, (-20, 20))
SQUARE = ("7*x*abs(x)", lambda x: 7 / 3 * abs(x) ** 3, (-20, 20))


def function(values):
    return ca.Function("law", [X], [ca.vertcat(*values)])


@pytest.mark.parametrize(
    "case",
    [HARDENING, STEEP, GROWING, MORSE, WAVES, GAP, SQUARE],
    ids=lambda case: case[0],
)
def test_the_potential_of_an_expression_is_its_integral_to_rounding(case):
    text, potential, (lower, upper) = case
    force, energy = elastic(Expressed(TimeExpression(text, {}), lower, upper), X)
    at, rng = function([force, energy, ca.gradient(energy, X)]), np.random.default_rng(70)
    for x in [*np.geomspace(1e-2, upper, 20), *-np.geomspace(1e-2, -lower, 20), *rng.uniform(lower, upper, 20)]:
        found_force, found, slope = np.array(at(x)).ravel()
        assert found == pytest.approx(potential(x), rel=1e-13, abs=1e-300)
        assert slope == pytest.approx(found_force, rel=1e-12, abs=1e-12)
    assert at(0.0)[1] == 0.0


def test_an_expression_uses_the_values_of_its_parameters():
    force, _ = elastic(Expressed(TimeExpression("k*x + c", {"k": 3.0, "c": 1.0}), -20, 20), X)
    assert function([force])(2.0) == 7.0


def test_a_linear_spring():
    assert np.array(function(elastic(Linear(3.0), X))(2.0)).ravel().tolist() == [6.0, 6.0]


TABLES = {
    "two points": ([-0.5, 1.0], [-3.0, 2.0]),
    "from zero on": ([0.0, 0.1, 0.3, 1.0], [0.0, 5.0, 6.0, 20.0]),
    "without zero": ([0.2, 0.3, 0.7], [1.0, -2.0, -2.5]),
    "up and down": ([-1.0, -0.4, 0.0, 0.3, 0.35, 2.0], [-4.0, -5.0, 0.5, 0.5, 9.0, 1.0]),
}


@pytest.mark.parametrize("name", TABLES)
def test_a_table_is_the_monotone_cubic_of_scipy_and_straight_beyond_its_ends(name):
    x, f = TABLES[name]
    at = function([*elastic(tabulated(x, f), X), ca.gradient(elastic(tabulated(x, f), X)[1], X)])
    table, size = PchipInterpolator(x, f), max(map(abs, f))
    energy = table.antiderivative()
    first = float(at(x[0])[1])
    for place in np.linspace(x[0], x[-1], 101):
        force, stored, slope = np.array(at(place)).ravel()
        assert force == pytest.approx(table(place), abs=1e-14 * size)
        assert slope == pytest.approx(force, abs=1e-14 * size)
        assert stored - first == pytest.approx(energy(place), abs=1e-14 * size)
    for end, beyond in ((x[0], -0.7), (x[-1], 1.3)):
        value, rise = float(table(end)), float(table.derivative()(end))
        force, stored, _ = np.array(at(end + beyond)).ravel()
        assert force == pytest.approx(value + rise * beyond, abs=1e-13 * size)
        gained = value * beyond + 0.5 * rise * beyond**2
        assert stored - float(at(end)[1]) == pytest.approx(gained, abs=1e-13 * size)
    assert float(at(0.0)[1]) == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize("name", TABLES)
def test_the_force_of_a_table_and_its_slope_are_continuous(name):
    x, f = TABLES[name]
    force, _ = elastic(tabulated(x, f), X)
    at = function([force, ca.gradient(force, X)])
    for knot in x:
        below, on = (np.array(at(place)).ravel() for place in (np.nextafter(knot, -9.0), knot))
        assert on == pytest.approx(below, abs=1e-11)


@pytest.mark.parametrize("exponent", [0.0, 0.5, 1.0, 1.5, 2.0, 3.0])
def test_the_power_of_a_damper_is_p_plus_one_times_its_dissipation_function(exponent):
    """Géradin & Rixen, p. 30; at speeds far above that of the regularization."""
    v = ca.SX.sym("v")
    factor, loss = power_law(PowerLaw(2.5, exponent, 1e-9), v**2)
    at = ca.Function("at", [v], [factor * v, loss])
    for speed in (-3.0, -0.2, 0.7, 40.0):
        force, dissipation = map(float, at(speed))
        assert force == pytest.approx(2.5 * abs(speed) ** exponent * np.sign(speed), rel=1e-14)
        assert force * speed == pytest.approx((exponent + 1.0) * dissipation, rel=1e-8 if exponent == 0.0 else 1e-13)


@pytest.mark.parametrize("exponent", [0.0, 0.5, 1.0, 1.5, 2.0, 3.0])
def test_a_damper_is_smooth_at_rest_and_its_force_the_gradient_of_its_dissipation_function(exponent):
    v = ca.SX.sym("v")
    factor, loss = power_law(PowerLaw(2.5, exponent, 1e-2), v**2)
    force = factor * v
    at = ca.Function("at", [v], [force, ca.gradient(loss, v), ca.gradient(force, v), ca.hessian(force, v)[0]])
    assert np.all(np.isfinite([float(value) for value in at(0.0)]))
    assert [float(value) for value in at(0.0)[:2]] == [0.0, 0.0]
    for speed in (-0.5, -1e-3, 1e-2, 2.0):
        found, gradient, slope, _ = map(float, at(speed))
        assert gradient == pytest.approx(found, rel=1e-13)
        assert slope >= 0.0


def test_friction_has_the_values_of_its_law():
    v = ca.SX.sym("v")
    law = Friction(coulomb=2.0, static=3.0, stribeck_velocity=0.1, viscous=0.5, regularization=1e-3)
    force = friction(law, v)
    at = ca.Function("at", [v], [force, ca.gradient(force, v)])
    for speed in (0.05, 0.1, 1.0):
        expected = 2.0 + np.exp(-((speed / 0.1) ** 2)) + 0.5 * speed
        assert [float(at(speed)[0]), float(at(-speed)[0])] == pytest.approx([expected, -expected], rel=1e-14)
    assert [float(value) for value in at(0.0)] == [0.0, 3.0 / 1e-3 + 0.5]


def test_a_stop_never_pulls_and_never_releases_more_than_it_stored():
    q, v = ca.SX.sym("q"), ca.SX.sym("v")
    push, energy, loss = stop_forces(Limits(-1.0, 2.0, stiffness=50.0, damping=0.4), q, v)
    at = ca.Function("at", [q, v], [push + loss, energy, loss * v])
    rng = np.random.default_rng(71)
    for place, speed in zip(rng.uniform(-2, 3, 500), rng.uniform(-6, 6, 500), strict=True):
        force, stored, power = map(float, at(place, speed))
        depth, deeper = (place - 2.0, speed) if place > 2.0 else (-1.0 - place, -speed)
        depth = max(depth, 0.0)
        outward = np.sign(place - 0.5)
        assert force * outward == pytest.approx(50.0 * depth * max(0.0, 1.0 + 0.4 * deeper), abs=1e-12)
        assert force * outward >= 0.0 and power >= 0.0
        assert stored == pytest.approx(25.0 * depth**2, rel=1e-14)
    touch = [float(at(2.0 + 1e-12, speed)[0]) for speed in (-5.0, 5.0)]
    assert np.max(np.abs(touch)) < 1e-9  # continuous at the contact at any speed
