"""Derivatives of trajectories are those of differences, of closed forms, and of CasADi."""

import functools
import math

import casadi as ca
import numpy as np
import pytest

from mbd_sim import Simulation, load_mechanism, parse_mechanism
from mbd_sim.base.errors import DivergedError, InputError, MechanismError
from mbd_sim.studies.optimization import SensitivityModel, sensitivities, trajectory

STEP, STEPS = 0.01, 24
MECHANISMS = {
    "double_rod": ("m", "l"),
    "four_bar": ("crank", "coupler"),
    "knife_edge": (),
    "spherical_top": (),
    "spun_tube_particle": (),
}


@functools.cache
def model_of(name, method="tsitouras8", step=STEP):
    return SensitivityModel(load_mechanism(name), MECHANISMS[name], method=method, step=step)


def differences(values, at, size):
    """The derivatives of values(at), by central differences extrapolated to the order 6 (Richardson)."""
    columns = []
    for index in range(at.size):

        def moved(h, index=index):
            change = np.zeros(at.size)
            change[index] = h
            return (values(at + change.reshape(at.shape)) - values(at - change.reshape(at.shape))) / (2.0 * h)

        one, half, quarter = moved(size), moved(size / 2.0), moved(size / 4.0)
        better, best = (4.0 * half - one) / 3.0, (4.0 * quarter - half) / 3.0
        columns.append((16.0 * best - better) / 15.0)
    return np.stack(columns, axis=-1)


def assert_close(exact, expected, tolerance=1e-10):
    assert np.max(np.abs(exact - expected)) < tolerance * max(1.0, np.max(np.abs(expected)))


@pytest.mark.parametrize("name", MECHANISMS)
def test_derivatives_are_those_of_differences(name):
    """By parameters, the start state and the efforts of three intervals; the trajectory is that of the simulation."""
    model, random = model_of(name), np.random.default_rng(0)
    own = model.functions
    sim = Simulation.from_file(name, method="tsitouras8", step=STEP)
    sim.step(7)  # a state that satisfies the constraints
    x0, t0 = np.concatenate([sim.q, sim.u]), sim.time
    efforts = random.normal(size=(3, len(own.efforts)))
    found = model.run(STEPS, t0=t0, x0=x0, efforts=efforts, every=4)
    for effort in efforts:
        sim.set_efforts(effort)
        sim.step(STEPS // 3)
    assert_close(found.x[-1], np.concatenate([sim.q, sim.u]), 1e-13)

    def run(**changed):
        return model.run(STEPS, **{"t0": t0, "x0": x0, "efforts": efforts, **changed}, every=4).x

    by_start = differences(lambda x: run(x0=x), x0, 2e-3)
    assert_close(found.dx.by_start, by_start)
    if efforts.size:
        by_efforts = differences(lambda e: run(efforts=e), efforts, 0.01)
        assert_close(found.dx.by_efforts, by_efforts.reshape(found.dx.by_efforts.shape))
    if own.parameters:
        assert_close(found.dx.by_parameters, differences(lambda p: run(parameters=p), own.values, 2e-3))
    nq = len(sim.q)
    assert found.q.shape == (7, nq) and np.shares_memory(found.dq.by_start, found.dx.by_start)
    assert found.du.by_efforts.shape == (7, len(sim.u), 3, len(own.efforts))


@pytest.mark.parametrize("name", ["four_bar", "spherical_top"])
def test_the_start_and_its_derivatives_are_those_of_a_reset(name):
    """From a state that violates the constraints, so that the derivatives of Newton's steps count too."""
    model, random = model_of(name), np.random.default_rng(2)
    own, nq = model.functions, model.functions.equations.layout.nq
    x0 = own.start + 0.03 * random.normal(size=own.start.size)

    def reset(x, **changes):
        sim = Simulation.from_file(name, method="rk4", **changes) if changes else at_rest
        sim.reset(q=x[:nq], u=x[nq:], nearest_speeds=True)
        return np.concatenate([sim.q, sim.u])

    def run(p):
        return model.run(1, x0=x0, parameters=p).x[0]

    at_rest = Simulation.from_file(name, method="rk4")
    found = model.run(1, x0=x0)
    assert_close(found.x[0], reset(x0), 1e-14)
    assert np.max(np.abs(found.x[0] - x0)) > 1e-3
    assert_close(found.dx.by_start[0], differences(reset, x0, 2e-3))
    if own.parameters:
        p = 1.02 * own.values
        assert_close(run(p), reset(x0, parameters=dict(zip(own.parameters, p.tolist(), strict=True))), 1e-13)
        assert_close(found.dx.by_parameters[0], differences(run, own.values, 2e-3))


@pytest.mark.parametrize("method", ["rk4", "adams11", "gauss6", "rosenbrock"])
def test_each_method_has_the_derivatives_of_its_own_steps(method):
    """Of long steps, whose error is larger than the tolerance, and with `adams11` of some that use earlier ones."""
    step, steps = (1e-3, 40) if method == "adams11" else (0.1, 8)
    model = SensitivityModel(load_mechanism("rod_pendulum"), method=method, step=step, by_efforts=False)
    x0 = np.array([2.1, -1.0])
    found = model.run(steps, x0=x0, every=steps)
    assert_close(found.dx.by_start, differences(lambda x: model.run(steps, x0=x, every=steps).x, x0, 2e-3))
    sim = Simulation.from_file("rod_pendulum", method=method, step=step)
    sim.reset(q=x0[:1], u=x0[1:])
    sim.step(steps)
    assert_close(found.x[-1], np.concatenate([sim.q, sim.u]), 1e-12)


def test_a_damped_oscillator_has_the_derivatives_of_its_closed_form():
    """m x'' + c x' + k x = F, by m, c, k, x₀, v₀ and F: those of the formula, by complex steps."""
    text = """
mechanism: oscillator
gravity: [0, 0, 0]
parameters: {m: 2.0, k: 30.0, c: 0.8}
parts: {block: {mass: m}}
joints: {rail: {type: prismatic, between: [ground, block], axis: [1, 0, 0], stiffness: k, damping: c, position: 0.4}}
"""
    model = SensitivityModel(parse_mechanism(text), ["m", "k", "c"], method="dop853", step=0.02)
    found = model.run(100, x0=[0.4, -0.3], efforts=[5.0])

    def closed_form(t, m, k, c, x0, v0, force):
        decay, rate = c / (2.0 * m), np.sqrt(k / m - (c / (2.0 * m)) ** 2)
        a, b = x0 - force / k, (v0 + decay * (x0 - force / k)) / rate
        turning = np.cos(rate * t), np.sin(rate * t)
        position = force / k + np.exp(-decay * t) * (a * turning[0] + b * turning[1])
        speed = np.exp(-decay * t) * ((b * rate - decay * a) * turning[0] - (a * rate + decay * b) * turning[1])
        return np.stack([position, speed], axis=-1)

    values, tiny = np.array([2.0, 30.0, 0.8, 0.4, -0.3, 5.0]), 1e-30
    assert_close(found.x, closed_form(found.t, *values), 1e-13)
    exact = np.concatenate([found.dx.by_parameters, found.dx.by_start, found.dx.by_efforts[:, :, 0]], axis=2)
    for index in range(6):
        changed = values.astype(complex)
        changed[index] += 1j * tiny
        assert_close(exact[:, :, index], closed_form(found.t, *changed).imag / tiny, 1e-13)


def test_derivatives_are_those_of_casadi():
    """`trajectory` is differentiated by CasADi, step by step; its start state is not moved as lengths change."""
    own, steps = model_of("four_bar").functions, 4
    function = trajectory(own, steps, STEP)
    t0, x0, e, p = function.mx_in()
    given = ca.vertcat(p, ca.vec(e), x0)
    by_all = ca.Function("d", [t0, x0, e, p], [ca.jacobian(function(t0, x0, e, p), given)])
    efforts = np.random.default_rng(1).normal(size=(steps, 3))
    found = model_of("four_bar").run(steps, efforts=efforts)
    exact = np.array(by_all(0.0, own.start, efforts.T, own.values)).reshape(steps + 1, 6, -1)
    by_p, by_e, by_start = exact[:, :, :2], exact[:, :, 2:-6].reshape(steps + 1, 6, steps, 3), exact[:, :, -6:]
    assert_close(found.dx.by_efforts, by_e, 1e-12)
    assert_close(found.dx.by_start, by_start @ found.dx.by_start[0], 1e-12)
    assert_close(found.dx.by_parameters, by_p + by_start @ found.dx.by_parameters[0], 1e-12)


def test_points_have_derivatives():
    """By the lengths too, on which they depend at once; the crank's tip moves on a circle."""
    model = model_of("four_bar")
    efforts = np.array([[0.3, 0.0, 0.0], [-0.2, 0.1, 0.0]])
    points = list(load_mechanism("four_bar").parts["coupler"].points)
    name = f"coupler.{points[-1]}"
    found = model.run(STEPS, efforts=efforts, every=8, points=[name])
    position, derivatives = found.points[name]
    assert position.shape == (4, 3) and derivatives.by_efforts.shape == (4, 3, 2, 3)
    cases = [
        (derivatives.by_parameters, "parameters", model.functions.values),
        (derivatives.by_start, "x0", model.functions.start),
        (derivatives.by_efforts, "efforts", efforts),
    ]
    for exact, key, at in cases:

        def place(given, key=key):
            return model.run(STEPS, **{"efforts": efforts, key: given}, every=8, points=[name]).points[name][0]

        assert_close(exact, differences(place, at, 2e-3).reshape(exact.shape))


def test_the_state_of_a_motor_is_among_the_states_and_its_voltage_among_the_efforts():
    """An arm on a motor with a current of its own: i' L = V − R i − k ω."""
    text = """
mechanism: motor
parameters: {R: 0.9}
parts: {arm: {mass: 1.0, inertia: [0.1, 0.1, 0.1], center: [0, 0, -0.2]}}
joints: {shaft: {type: revolute, between: [ground, arm], axis: [0, -1, 0], damping: 0.02, position: 0.3}}
actuators: {drive: {type: dc_motor, joint: shaft, torque_constant: 0.5, resistance: R, inductance: 0.05}}
"""
    mechanism = parse_mechanism(text)
    model = SensitivityModel(mechanism, ["R"], method="tsitouras8", step=0.005)
    assert model.functions.commands == ("drive.voltage",) and model.functions.actuator_states == ("drive.current",)
    volts = np.array([[0.0, 6.0], [0.2, -3.0]])
    found = model.run(40, efforts=volts, every=20)
    sim = Simulation(mechanism, method="tsitouras8", step=0.005)
    for effort, voltage in volts:
        sim.set_efforts([effort])
        sim.set_commands({"drive": voltage})
        sim.step(20)
    assert_close(found.x[-1], sim.y[:3], 1e-12)
    assert_close(
        found.dx.by_efforts,
        differences(lambda e: model.run(40, efforts=e, every=20).x, volts, 0.05).reshape(3, 3, 2, 2),
    )
    by_resistance = differences(lambda p: model.run(40, efforts=volts, parameters=p, every=20).x, np.array([0.9]), 1e-3)
    assert_close(found.dx.by_parameters, by_resistance)


def test_drives_follow_commands_that_are_among_the_efforts():
    """A load below a trolley: the position, velocity and acceleration of the drive are the last ones of q."""
    text = """
mechanism: crane
parts:
  trolley: {mass: 20}
  load: {mass: 5, shape: {type: rod, to: [0, 0, -1.2]}}
joints:
  rail:
    {type: prismatic, between: [ground, trolley], axis: [1, 0, 0], drive: {command: position, bandwidth: 8 rad/s}}
  rope: {type: revolute, between: [trolley, load], axis: [0, -1, 0], damping: 0.2}
"""
    mechanism = parse_mechanism(text)
    model = SensitivityModel(mechanism, ["joints.rope.damping"], method="verner7", step=0.01)
    own, efforts = model.functions, np.array([[0.0, 0.6, 0.1], [0.4, -0.3, 0.0]])
    assert own.commands == ("rail.position", "rail.velocity")
    found = model.run(40, efforts=efforts, every=20)
    sim = Simulation(mechanism, method="verner7", step=0.01)
    for effort, position, velocity in efforts:
        sim.set_efforts([effort])
        sim.set_commands({"rail": {"position": position, "velocity": velocity}})
        sim.step(20)
    assert_close(found.x[-1], sim.y[:5], 1e-13)
    by_efforts = differences(lambda e: model.run(40, efforts=e, every=20).x, efforts, 0.01)
    assert_close(found.dx.by_efforts, by_efforts.reshape(3, 5, 2, 3))
    p = own.values
    assert_close(
        found.dx.by_parameters, differences(lambda p: model.run(40, efforts=efforts, parameters=p, every=20).x, p, 5e-3)
    )
    rates = np.array(own.f(0, found.x[-1], efforts[1], p)).ravel()
    balance = float(own.M(0, found.x[-1], p)) * rates[4] + float(own.bias(0, found.x[-1], p)) - efforts[1, 0]
    assert abs(balance) < 1e-13


def test_a_simulation_gives_its_present_state_efforts_and_live_values():
    sim = Simulation.from_file("rod_pendulum", method="adams11", step=1e-3, live=["m"])
    sim.set_live({"m": 1.7})
    sim.set_efforts([0.5])
    sim.step(30)
    before, time = sim.y.copy(), sim.time
    found = sensitivities(sim, 50, ["m"], every=50)
    assert np.array_equal(sim.y, before) and found.t[0] == time and found.parameters == ("m",)
    sim.step(50)
    assert_close(found.x[-1], sim.y[:2], 1e-12)
    by_formula = -0.5 * 3.0 / 1.7**2 * (50e-3) ** 2 / 2.0  # of u' = 3 e / (m l²) + …, for short times
    assert found.dq.by_parameters[-1, 0, 0] == pytest.approx(by_formula, rel=1e-2)


def test_only_what_is_asked_for_is_computed():
    mechanism, efforts = load_mechanism("rod_pendulum"), [[0.1], [0.3]]
    all_of_them = SensitivityModel(mechanism, ["l"], method="rk4", step=STEP).run(10, efforts=efforts)
    alone = SensitivityModel(mechanism, ["l"], method="rk4", step=STEP, by_start=False, by_efforts=False)
    found = alone.run(10, efforts=efforts)
    assert found.dx.by_start is None and found.dx.by_efforts is None and found.dq.by_start is None
    assert_close(found.dx.by_parameters, all_of_them.dx.by_parameters, 1e-12)
    only_efforts = SensitivityModel(mechanism, method="rk4", step=STEP, by_start=False).run(10, efforts=efforts)
    assert only_efforts.dx.by_start is None and only_efforts.dx.by_parameters.shape == (11, 2, 0)
    assert_close(only_efforts.dx.by_efforts, all_of_them.dx.by_efforts, 1e-12)


def test_what_has_no_derivatives_is_refused():
    with pytest.raises(MechanismError, match=r"one-sided elements: constraints\.floor.*with a 'stiffness'"):
        SensitivityModel(load_mechanism("bounce"))
    with pytest.raises(MechanismError, match=r"only between steps: drive.*sample_rate"):
        SensitivityModel(load_mechanism("motor_drive"))
    with pytest.raises(InputError, match="rosenbrock_w has no derivatives"):
        SensitivityModel(load_mechanism("double_rod"), method="rosenbrock_w")
    with pytest.raises(InputError, match="taylor has no derivatives"):
        SensitivityModel(load_mechanism("double_rod"), method="taylor")
    model = model_of("double_rod")
    for given, message in (
        ({"x0": [0.0]}, r"x0 has the shape \(1,\)"),
        ({"efforts": [0.0]}, "efforts has the shape"),
        ({"parameters": [1.0, math.nan]}, "not finite"),
        ({"efforts": np.zeros((7, 2))}, "7 equal intervals"),
        ({"every": 0}, "not a trajectory"),
        ({"points": ["upper.tp"]}, "no point"),
    ):
        with pytest.raises(InputError, match=message):
            model.run(STEPS, **given)
    x0, p = model.functions.start, model.functions.values
    for results, steps in (([1, 2], [0]), ([0, 2, 2], [0]), ([0, 2], [1])):
        with pytest.raises(InputError, match="do not increase from 0"):
            model.at_steps(results, [(step, np.zeros(2)) for step in steps], t0=0.0, x0=x0, parameters=p)
    with pytest.raises(InputError, match="closes the loops"):
        model_of("four_bar").run(1, parameters=[9.0, 0.1])
    with pytest.raises(DivergedError, match="between t = "):
        model.run(20, x0=[0.0, 0.0, 1e200, 0.0])
    pushed = Simulation.from_file("double_rod", wrenches=["upper"])
    pushed.set_wrench("upper", force=[1.0, 0.0, 0.0])
    with pytest.raises(InputError, match="wrenches"):
        sensitivities(pushed, 10)


def test_a_start_far_from_its_circle_has_the_derivatives_of_the_projection():
    """The nearest point at the distance l is l n, n = q/|q|, with the derivative l (1 - n nᵀ)/|q|."""
    text = """
mechanism: circle
gravity: [0, 0, 0]
parts: {carriage: {mass: 0}, bob: {mass: 1}}
joints:
  x: {type: prismatic, between: [ground, carriage], axis: [1, 0, 0], position: 300}
  y: {type: prismatic, between: [carriage, bob], axis: [0, 1, 0], position: 400}
constraints: {bar: {type: distance, between: [ground, bob], length: 500}}
"""
    q = np.array([3.0, 4.0])
    found = SensitivityModel(parse_mechanism(text), by_efforts=False).run(1, x0=[*q, 0.0, 0.0])
    n, size = q / np.linalg.norm(q), np.linalg.norm(q)
    assert_close(found.q[0], 500.0 * n, 1e-14)
    assert_close(found.dq.by_start[0][:, :2], 500.0 / size * (np.eye(2) - np.outer(n, n)), 1e-12)
