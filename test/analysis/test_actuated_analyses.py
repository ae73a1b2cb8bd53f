"""Linearization and inverse dynamics of mechanisms with actuators."""

import numpy as np
import pytest
from scipy.linalg import expm

from mbd_sim import InverseDynamics, MechanismError, Simulation

LINKS = """
mechanism: two_links
integrator: {step: 0.0005}
parts:
  upper: {mass: 1, center: [0, 0, -0.3], inertia: [0.02, 0.03, 0.01], points: {end: [0, 0, -0.6]}}
  lower: {mass: 0.7, center: [0.1, 0, -0.2], inertia: [0.01, 0.02, 0.01], points: {tip: [0.2, 0, -0.4]}}
joints:
  hip: {type: revolute, between: [ground, upper], axis: [0, -1, 0], position: 0.4, velocity: 0.3, damping: 0.1}
  knee: {type: revolute, between: [upper.end, lower], axis: [0, -1, 0], position: 0.7, damping: 0.1}
"""
LOOP = """constraints:
  rod: {type: distance, between: [ground.base, lower.tip], length: 0.5}
ground: {points: {base: [0.5, 0, -1.2]}}
"""
ACTUATORS = """actuators:
  first:
    type: dc_motor
    joint: hip
    torque_constant: 0.1
    resistance: 2
    inductance: 0.004
    gear_ratio: 20
    rotor_inertia: 2e-5
    servo: {controls: velocity, kp: 1.5, ki: 20}
  second:
    type: effort
    joint: knee
    servo: {controls: position, kp: 40, ki: 30, kd: 3}
"""
CONTACT = """
mechanism: pushed_block
gravity: [0, 0, 0]
parts: {cart: {mass: 2}, block: {mass: 3}}
joints:
  rail: {type: prismatic, between: [ground, cart], axis: [1, 0, 0], limits: {lower: -1, upper: 0, restitution: 0}}
  slide: {type: prismatic, between: [ground, block], axis: [1, 0, 0], position: 0.5}
forces:
  link: {type: spring, between: [cart, block], stiffness: 50, length: 0.3}
actuators:
  motor: {type: dc_motor, joint: slide, torque_constant: 4, resistance: 2, inductance: 0.1, lead: '${2*pi} m'}
"""


def states_of(sim):
    """The free directions' part of the state: x of a `Linearization` without constraints."""
    return sim.y[: sim.model.equations.core.stop].copy()


def test_the_linearization_is_the_derivative_of_the_rates_about_a_moving_state():
    sim = Simulation.from_text(LINKS + ACTUATORS)
    sim.set_commands({"first": 0.8, "second": {"position": 0.2, "velocity": 0.1, "effort": 2.0}})
    sim.run(until=0.1)
    linear, equations, nv = sim.linearize(), sim.model.equations, len(sim.u)
    assert linear.states == ("first.current", "first.integral", "second.integral")
    assert linear.commands == ("first.velocity", "second.position", "second.velocity", "second.effort")

    def rates(changes, inputs):
        y, given = sim.y.copy(), sim.inputs.copy()
        y[: equations.core.stop] += changes
        given[equations.inputs.acting] += inputs
        return np.array(equations.rates.call([sim.time, y, given])[0]).ravel()[: equations.core.stop]

    n, m, h = len(linear.a), nv + len(linear.commands), 1e-6
    for matrix, size, place in ((linear.a, n, 0), (np.hstack([linear.b, linear.by_commands]), m, 1)):
        for column, step in enumerate(h * np.eye(size)):
            pairs = (
                [(step, np.zeros(m)), (-step, np.zeros(m))]
                if place == 0
                else [(np.zeros(n), s * step) for s in (1, -1)]
            )
            ahead, behind = (rates(*pair) for pair in pairs)
            expected = (ahead - behind) / (2 * h)
            assert matrix[:, column] == pytest.approx(expected, rel=1e-7, abs=1e-7 * (1.0 + np.abs(expected).max()))


def test_the_kernel_moves_small_changes_on_as_the_exponential_of_a():
    """About a state of rest, with differences of two runs of the compiled kernel on either side."""
    sim = Simulation.from_text(LINKS + ACTUATORS, method="tsitouras8")
    sim.set_commands({"first": 0.0, "second": 0.3})
    sim.run(until=30.0)
    assert np.abs(sim.u_rates).max() < 1e-10 and np.abs(sim.u).max() < 1e-10
    linear, start, steps, h = sim.linearize(), sim.snapshot(), 40, 1e-5
    moved = np.empty_like(linear.a)
    for column in range(len(linear.a)):
        ends = []
        for sign in (1.0, -1.0):
            y = start.state.copy()
            y[column] += sign * h
            sim.restore(y, start.steps, start.inputs)
            sim.step(steps)
            ends.append(states_of(sim))
        moved[:, column] = (ends[0] - ends[1]) / (2 * h)
    exact = expm(linear.a * steps * sim.step_size)
    assert moved == pytest.approx(exact, abs=2e-8 * np.abs(exact).max())


def test_in_a_loop_states_of_actuators_follow_the_free_directions():
    """The second half of A against the motion of states that are moved back to the loop."""
    sim = Simulation.from_text(LINKS.replace("position: 0.7", "position: 0.7, guess: true") + ACTUATORS + LOOP)
    sim.run(until=0.05)
    linear, equations = sim.linearize(), sim.model.equations
    nq, nv, core = len(sim.q), len(sim.u), equations.core
    assert linear.a.shape == (1 + 1 + 3, 5) and linear.by_commands.shape == (5, 4)
    constraints = equations.constraints

    def rates(x, h):
        q = constraints.displaced(sim.q, h * linear.displacements @ x[:1])
        gradient, drift = constraints.gradient(0.0, q), constraints.drift(0.0, q)
        u = sim.u + h * linear.speeds @ x[1:2]
        u = u - np.linalg.pinv(gradient) @ (gradient @ u + drift)
        y = np.concatenate([q, u, sim.y[nq + nv : core.stop] + h * x[2:], sim.y[core.stop :]])
        found = np.array(equations.rates.call([sim.time, y, sim.inputs])[0]).ravel()
        return np.concatenate([linear.speeds.T @ found[nq : nq + nv], found[nq + nv : core.stop]])

    for column, x in enumerate(np.eye(5)):
        expected = (rates(x, 1e-6) - rates(x, -1e-6)) / 2e-6
        assert linear.a[1:, column] == pytest.approx(expected, rel=1e-6, abs=1e-6 * (1.0 + np.abs(expected).max()))


def test_a_motor_whose_load_rests_against_a_stop():
    """The cart stays at its stop; the block between a spring and a motor has p' = w, 3 w' = -50 p + 4 s, 0.1 s' = …"""
    sim = Simulation.from_text(CONTACT)
    sim.set_commands({"motor": -1.5})
    sim.step(3)
    assert sim.contacts()["rail.upper_limit"].normal > 5
    linear = sim.linearize()
    assert np.abs(linear.speeds).ravel() == pytest.approx([0.0, 1.0])
    sign = np.sign(linear.speeds[1, 0])
    expected = [[0, 1, 0], [-50 / 3, 0, sign * 4 / 3], [0, -sign * 4 / 0.1, -2 / 0.1]]
    assert linear.a == pytest.approx(np.array(expected), rel=1e-12, abs=1e-12)
    assert linear.by_commands == pytest.approx(np.array([[0], [0], [1 / 0.1]]), abs=1e-12)


@pytest.mark.parametrize("line", ["delay: 0.001", "servo: {controls: velocity, kp: 1, sample_rate: 1000}"])
def test_what_changes_only_between_steps_is_refused(line):
    text = ACTUATORS.split("  second")[0].split("    servo")[0] + f"    {line}\n"
    with pytest.raises(MechanismError, match=r"change only between steps: first.*\n?.*Leave out 'sample_rate'"):
        Simulation.from_text(LINKS + text).linearize()


def test_actuators_without_states_are_linearized_with_their_commands():
    """A motor without inductance is a damper k²/R, and its voltage an effort k/R."""
    text = CONTACT.replace(", inductance: 0.1", "").replace(", limits: {lower: -1, upper: 0, restitution: 0}", "")
    linear = Simulation.from_text(text).linearize()
    assert linear.states == () and linear.commands == ("motor.voltage",)
    assert linear.a[3, 3] == pytest.approx(-16 / 2 / 3, rel=1e-12)
    assert linear.by_commands[3, 0] == pytest.approx(4 / 2 / 3, rel=1e-12)


CYLINDER = "  cylinder: {type: effort, between: [ground.base, upper.end], command: {effort: 30}}\n"


@pytest.mark.parametrize("more", ["", CYLINDER, LOOP, CYLINDER + LOOP])
def test_inverse_dynamics_gives_what_actuators_and_commands_exert_together(more):
    guess = LINKS.replace("position: 0.7", "position: 0.7, guess: true")
    ground = "" if LOOP in more else "ground: {points: {base: [0.5, 0, -1.2]}}\n"
    sim = Simulation.from_text(guess + ground + ACTUATORS + more)
    sim.set_efforts([0.4, -0.3])
    sim.run(until=0.05)
    state = sim.actuators()
    exerted = sim.efforts + np.array([state["first"].effort, state["second"].effort])
    if "cylinder" in state:  # its lever arm about each joint: the derivative of its length
        q, lengths = sim.q.copy(), sim.model.equations.actuators.readings
        for index, h in enumerate(1e-6 * np.eye(2)):
            ahead, behind = (
                float(lengths(0.0, np.concatenate([q + sign * h, sim.y[2:]]), sim.inputs)[0, 2]) for sign in (1, -1)
            )
            exerted[index] += state["cylinder"].effort * (ahead - behind) / 2e-6
    free = sim.linearize().speeds
    assert free.T @ sim.inverse_dynamics(sim.u_rates) == pytest.approx(free.T @ exerted, rel=1e-8)


def test_some_motors_of_a_loop_with_actuators_do_the_work_of_all():
    sim = Simulation.from_text(LINKS.replace("position: 0.7", "position: 0.7, guess: true") + ACTUATORS + LOOP)
    sim.run(until=0.05)
    equations, free = sim.model.equations, sim.linearize().speeds
    efforts = InverseDynamics(sim.mechanism, ["knee"], equations)(sim.q, sim.u, sim.u_rates, sim.time, sim.inputs)
    assert efforts[0] == 0.0
    assert free.T @ efforts == pytest.approx(free.T @ sim.inverse_dynamics(sim.u_rates), rel=1e-10)
    with pytest.raises(ValueError, match="no efforts at knee give these accelerations"):
        InverseDynamics(sim.mechanism, ["knee"], equations)(
            sim.q, sim.u, sim.u_rates + np.array([1.0, 0.0]), sim.time, sim.inputs
        )


def test_inverse_dynamics_in_contact_does_not_depend_on_what_a_motor_exerts():
    """3 a = F - 50 (d - 0.3), with the distance d of the block."""
    sim = Simulation.from_text(CONTACT)
    sim.set_commands({"motor": -1.5})
    sim.step(30)
    efforts = sim.inverse_dynamics([0.0, 2.0])
    assert efforts[1] == pytest.approx(3 * 2.0 + 50 * (sim.q[1] - sim.q[0] - 0.3), rel=1e-9)
