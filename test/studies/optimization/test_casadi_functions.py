"""CasADi functions have the numbers of the compiled equations, also for other parameters, and exact derivatives."""

import functools

import casadi as ca
import numpy as np
import pytest

from mbd_sim.analysis.linear.linearization import linearize
from mbd_sim.base.errors import InputError, MechanismError
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.checks.override import with_values
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.studies.optimization import casadi_functions
from mbd_sim.studies.optimization.parameter_inputs import parameter_inputs
from test.generators.mechanisms import random_state

OPEN = ("double_rod", "cart_pendulum_spring", "duffing", "spherical_top", "cart_massive_spring")


@functools.cache
def functions_of(name):
    mechanism = load_mechanism(name)
    found = derive(mechanism)
    keys = [key for key in mechanism.parameters if depends_on(mechanism, key, found)]
    return casadi_functions(mechanism, keys)


def depends_on(mechanism, key, engine):
    """Whether the equations depend on a parameter, which may only set the start."""
    other = derive(with_values(mechanism, {key: 1.05 * mechanism.parameters[key]}))
    random = np.random.default_rng(0)
    q, u, efforts = random_state(mechanism, random)
    y = np.concatenate([q, u, np.zeros(engine.start_state.size - len(q) - len(u))])
    pair = [np.array(each.rates.call([0.3, y, efforts])[0]) for each in (engine, other)]
    return not np.allclose(*pair, rtol=1e-14, atol=0.0)


@pytest.mark.parametrize("name", OPEN)
def test_rates_and_inertia_for_other_parameters(name):
    found, mechanism, random = functions_of(name), load_mechanism(name), np.random.default_rng(3)
    values = found.values * random.uniform(0.8, 1.2, len(found.values))
    engine = derive(with_values(mechanism, dict(zip(found.parameters, values.tolist(), strict=True))))
    for t in (0.0, 0.4):
        q, u, efforts = random_state(mechanism, random)
        x, nq = np.concatenate([q, u]), len(q)
        y = np.concatenate([x, np.zeros(engine.start_state.size - len(x))])
        expected = np.array(engine.rates.call([t, y, efforts])[0]).ravel()[: len(x)]
        own = np.array(found.f(t, x, efforts, values)).ravel()
        assert np.allclose(own, expected, rtol=1e-11, atol=1e-11 * np.max(np.abs(expected)))
        mass, bias = np.array(found.M(t, x, values)), np.array(found.bias(t, x, values)).ravel()
        assert np.allclose(mass, engine.constraints.mass_matrix(t, q), rtol=1e-11, atol=1e-12)
        energies = np.array(engine.energies(t, y)).ravel()
        if name != "duffing":  # whose spring is given by an expression
            assert np.allclose(np.array(found.energies.call([t, x, values])).ravel(), energies, rtol=1e-11, atol=1e-12)
        assert np.allclose(mass @ expected[nq:] + bias, efforts, rtol=1e-9, atol=1e-9 * np.max(np.abs(bias)))


def test_constraints_and_multipliers_balance_the_equations():
    found = casadi_functions(load_mechanism("four_bar"), ["crank", "coupler"])
    x, efforts, p = found.start, np.array([2.0, -1.0, 0.5]), found.values
    rates = np.array(found.f(0, x, efforts, p)).ravel()[3:]
    gradient = np.array(found.G(0, x, p))
    forces = gradient.T @ np.array(found.multipliers(0, x, efforts, p)).ravel()
    balance = np.array(found.M(0, x, p)) @ rates + np.array(found.bias(0, x, p)).ravel() - efforts - forces
    assert np.max(np.abs(balance)) < 1e-11
    position, rate = found.constraints(0, x, p)
    assert float(ca.norm_inf(position)) < 1e-12 and float(ca.norm_inf(rate)) < 1e-12
    assert np.allclose(gradient @ x[3:], np.array(rate).ravel(), atol=1e-12)


def test_points_move_with_the_lengths():
    found = casadi_functions(load_mechanism("double_rod"), ["l"])
    x = np.array([0.3, 0.5, 1.1, -0.4])
    position, velocity = found.point("lower.tip")(0, x, [0.7])
    a, b = 0.3, 0.8
    assert np.allclose(np.array(position).ravel(), 0.7 * np.array([np.sin(a) + np.sin(b), 0, -np.cos(a) - np.cos(b)]))
    assert float(velocity[0]) == pytest.approx(0.7 * (np.cos(a) * 1.1 + np.cos(b) * 0.7))
    with pytest.raises(InputError, match=r"no point 'lower.tp'"):
        found.point("lower.tp")


def test_derivatives_are_exact():
    """By the state like `linearize`, by parameters like central differences."""
    found, mechanism = functions_of("cart_pendulum_spring"), load_mechanism("cart_pendulum_spring")
    x, e = np.array([0.2, 0.7, -0.3, 1.2]), np.array([1.0, 0.3])
    by = {
        name: np.array(found.f.factory("d", found.f.name_in(), [f"jac:x_dot:{name}"])(0, x, e, found.values))
        for name in "xp"
    }
    a = linearize(derive(mechanism), x[:2], x[2:], e).a
    assert np.allclose(by["x"], a, rtol=1e-11, atol=1e-12)
    for index in range(len(found.values)):
        change = np.zeros(len(found.values))
        change[index] = 1e-5 * found.values[index]
        ends = [np.array(found.f(0, x, e, found.values + sign * change)).ravel() for sign in (1, -1)]
        difference = (ends[0] - ends[1]) / (2 * change[index])
        assert np.allclose(by["p"][:, index], difference, rtol=1e-8, atol=1e-8)


def test_functions_take_mx_symbols_and_have_names():
    found = functions_of("double_rod")
    x, p = ca.MX.sym("x", 4), ca.MX.sym("p", len(found.values))
    rates = found.f(t=0, x=x, e=[1, 2], p=p)["x_dot"]
    assert ca.Function("g", [x, p], [ca.jacobian(rates, p)])(found.start, found.values).shape == (4, 2)
    assert found.f.name_in() == ["t", "x", "e", "p"] and found.energies.name_out() == ["T", "V"]
    assert found.coordinates == ("shoulder", "elbow")


def test_without_parameters_p_is_empty():
    found = casadi_functions(load_mechanism("double_rod"))
    assert found.values.shape == (0,)
    energies = found.energies(0, found.start, [])
    assert float(energies[0]) == 0.0


@pytest.mark.parametrize(
    ("name", "keys", "message"),
    [
        ("motor_drive", [], "because actuators change only between steps: drive"),
        ("bounce", [], "one-sided"),
        ("double_rod", ["lenght"], "lenght"),
        ("double_rod", ["l", "m", "parameters.l"], r"parameters\.l: is given twice"),
        ("cart_pendulum_spring", ["joints.pin.position"], "do not depend on it"),
    ],
)
def test_what_cannot_be_is_refused(name, keys, message):
    with pytest.raises(MechanismError, match=message):
        casadi_functions(load_mechanism(name), keys)


def test_a_parameter_that_turns_an_axis_is_refused():
    text = """
mechanism: tilted
parameters: {alpha: 0.3}
parts: {p: {mass: 2}}
joints: {rail: {type: prismatic, between: [ground, p], axis: [cos(alpha), 0, sin(alpha)]}}
"""
    with pytest.raises(MechanismError, match=r"cannot be an input: .*axis"):
        casadi_functions(parse_mechanism(text), ["alpha"])


def test_numbers_that_no_parameter_changes_need_no_short_formula():
    arm = load_mechanism("six_axis_servo_arm")  # with a composite tool, and efforts without limits
    inputs = parameter_inputs(arm, ["parts.upper_arm.mass"])
    assert inputs.values.tolist() == [arm.parts["upper_arm"].mass]
    assert all(formula.parameters == {0} for formula, _ in inputs.formulas)
    end = arm.parts["wrist"].points["end"].position
    assert [formula.value(np.ones((1, 1)))[0] for formula in inputs.points["wrist", "end"]] == end.tolist()
