"""Servos in the kernel beside independent discrete simulations, and what carries their states."""

import math
import pickle
import re

import numpy as np
import pytest
from scipy.linalg import expm

from mbd_sim import Simulation
from mbd_sim.base.errors import MechanismError

STEP, INERTIA = 1e-3, 0.02
SHAFT = f"""
mechanism: shaft
gravity: [0, 0, 0]
parts:
  wheel: {{mass: 1, inertia: [{INERTIA}, {INERTIA}, {INERTIA}]}}
joints:
  shaft: {{type: revolute, between: [ground, wheel], axis: [0, 0, 1], position: 0.3}}
integrator: {{method: rk4, step: {STEP}}}
actuators:
"""
POSITION = (
    "  drive: {type: effort, joint: shaft, effort_limit: 2, delay: 3 ms, servo: {controls: position, kp: 6, ki: 20, "
    "kd: 0.4, velocity_feedforward: 0.05, rate_limit: 4 rad/s, tracking_time: 0.08, sample_rate: 250 Hz}}\n"
)
VELOCITY = (
    "  drive: {type: effort, joint: shaft, effort_limit: 1.5, servo: {controls: velocity, kp: 0.3, ki: 2, kd: 1e-3, "
    "sample_rate: 200 Hz, rate_limit: 50}}\n"
)
DC = (
    "  drive: {type: dc_motor, joint: shaft, torque_constant: 0.05, resistance: 1, inductance: 1 mH, gear_ratio: 10, "
    "voltage_limit: 24, current_limit: 8, current_bandwidth: 1500, rotor_inertia: 1e-5, delay: 2 ms, "
    "servo: {controls: position, kp: 40, ki: 30, kd: 1, rate_limit: 6, sample_rate: 500 Hz}}\n"
)


def clip(value, limit):
    return max(-limit, min(limit, value))


def wanted(step):
    """The commands of the experiment at a step: position, velocity, effort."""
    return (0.3, 0.0, 0.0) if step < 20 else (1.5, 0.2, 0.1) if step < 400 else (-0.5, 0.0, -0.05)


def independent_position_run(steps):
    """Position and speed of a wheel under a sampled PID, from the difference equations alone."""
    q, v, output, integral, reference, period, waiting = 0.3, 0.0, 0.0, 0.0, 0.3, 4e-3, [(0.3, 0.0, 0.0)] * 3
    for step in range(steps):
        waiting.append(wanted(step))
        position, velocity, effort = waiting.pop(0)
        if step % 4 == 0:
            reference += clip(position - reference, 4.0 * period)
            error = reference - q
            total = 6.0 * error + integral + 0.4 * (velocity - v) + 0.05 * velocity + effort
            output = clip(total, 2.0)
            integral += period * (20.0 * error + (output - total) / 0.08)
        q += STEP * v + 0.5 * STEP**2 * output / INERTIA
        v += STEP * output / INERTIA
    return q, v


def independent_velocity_run(steps):
    q, v, output, integral, reference, last, period = 0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 5e-3
    for step in range(steps):
        _, velocity, effort = wanted(step)
        if step % 5 == 0:
            reference += clip(20.0 * velocity - reference, 50.0 * period)
            error = reference - v
            total = 0.3 * error + integral + 1e-3 * (error - last) / period + effort
            last, output = error, clip(total, 1.5)
            integral += period * (2.0 * error + (output - total) / 0.15)
        q += STEP * v + 0.5 * STEP**2 * output / INERTIA
        v += STEP * output / INERTIA
    return q, v


@pytest.mark.parametrize("steps", [1, 19, 100, 1000])
def test_a_sampled_position_servo_is_the_discrete_controller(steps):
    simulation = Simulation.from_text(SHAFT + POSITION)
    for step in range(steps):
        position, velocity, effort = wanted(step)
        simulation.set_commands({"drive": {"position": position, "velocity": velocity, "effort": effort}})
        simulation.step()
    expected = independent_position_run(steps)
    assert (simulation.q[0], simulation.u[0]) == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_a_sampled_velocity_servo_is_the_discrete_controller():
    simulation = Simulation.from_text(SHAFT + VELOCITY)
    for step in range(700):
        _, velocity, effort = wanted(step)
        simulation.set_commands({"drive": {"velocity": 20.0 * velocity, "effort": effort}})
        simulation.step()
    expected = independent_velocity_run(700)
    assert (simulation.q[0], simulation.u[0]) == pytest.approx(expected, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("method", ["rk4", "tsitouras8", "gauss6", "rosenbrock", "rosenbrock_w"])
def test_a_continuous_servo_is_a_linear_system(method):
    servo = "  drive: {type: effort, joint: shaft, servo: {controls: position, kp: 6, ki: 20, kd: 0.4}}\n"
    step = 1e-4 if method == "rosenbrock_w" else 1e-3
    simulation = Simulation.from_text(SHAFT + servo, method=method, step=step)
    simulation.set_commands({"drive": 1.3})
    simulation.run(until=0.2)
    # x = (q - 1.3, v, I)
    matrix = np.array([[0.0, 1.0, 0.0], [-6.0 / INERTIA, -0.4 / INERTIA, 1.0 / INERTIA], [-20.0, 0.0, 0.0]])
    expected = expm(0.2 * matrix) @ [-1.0, 0.0, 0.0]
    assert (simulation.q[0] - 1.3, simulation.u[0]) == pytest.approx(
        expected[:2], abs=1e-7 if method == "rk4" else 1e-8
    )


def test_the_start_position_is_held_before_the_first_command_and_after_a_reset():
    simulation = Simulation.from_text(SHAFT + POSITION)
    simulation.run(until=0.5)
    assert simulation.q[0] == 0.3 and simulation.actuators()["drive"].commands["position"] == 0.3
    simulation.reset(q=[0.8])
    simulation.run(until=0.5)
    assert simulation.q[0] == 0.8


def trajectory(simulation, parts):
    simulation.set_commands({"drive": 1.0})
    for steps in parts:
        simulation.step(steps)
    return simulation.state


def test_steps_in_any_division_and_runs_from_a_snapshot_have_the_same_bits():
    whole = trajectory(Simulation.from_text(SHAFT + DC), [1000])
    assert np.array_equal(trajectory(Simulation.from_text(SHAFT + DC), [1] * 7 + [493, 500]), whole)
    first, second = Simulation.from_text(SHAFT + DC), Simulation.from_text(SHAFT + DC)
    trajectory(first, [333])
    second.restore(pickle.loads(pickle.dumps(first.snapshot())))
    second.step(667)
    assert np.array_equal(second.state, whole)
    third = Simulation.from_text(SHAFT + DC)
    third.restore(first.state, steps=333, inputs=first.inputs, start_energy=first.start_energy)
    third.step(667)
    assert np.array_equal(third.state, whole)


def test_a_servo_with_a_stop_and_events_is_sampled_once_in_each_step():
    stop = SHAFT.replace("position: 0.3", "position: 0.3, limits: {lower: -1, upper: 1.0, restitution: 0.5}")
    simulation = Simulation.from_text(stop + POSITION)
    simulation.set_commands({"drive": {"position": 1.5}})
    simulation.run(until=1.0)
    assert simulation.contact_event_count > 2 and simulation.q[0] == pytest.approx(1.0, abs=1e-9)
    assert abs(simulation.energies.residual) < 1e-9
    divided = Simulation.from_text(stop + POSITION)
    divided.set_commands({"drive": {"position": 1.5}})
    for _ in range(1000):
        divided.step()
    assert np.array_equal(divided.state, simulation.state)
    free = Simulation.from_text(SHAFT + POSITION)
    far = Simulation.from_text(
        SHAFT.replace("position: 0.3", "position: 0.3, limits: {lower: -9, upper: 9, restitution: 0}") + POSITION
    )
    for run in (free, far):
        run.set_commands({"drive": {"position": 1.5}})
        run.run(until=0.5)
    assert far.q == pytest.approx(free.q, abs=1e-13)


@pytest.mark.parametrize(
    "change, message",
    [
        (("sample_rate: 250 Hz", "sample_rate: 300 Hz"), r"servo.sample_rate: .*0.001 s.*333.333333333 Hz or 250 Hz"),
        (("delay: 3 ms", "delay: 3.5 ms"), r"drive.delay: .*whole number of steps.*0.003 s or 0.004 s"),
        (("delay: 3 ms", "delay: 3 s"), r"drive.delay: .*3000 steps"),
    ],
)
def test_times_that_are_not_whole_steps_are_refused_with_the_nearest(change, message):
    with pytest.raises(MechanismError, match=message):
        Simulation.from_text((SHAFT + POSITION).replace(*change))


def test_the_sample_rates_that_an_error_suggests_are_accepted():
    with pytest.raises(MechanismError) as caught:
        Simulation.from_text((SHAFT + POSITION).replace("sample_rate: 250 Hz", "sample_rate: 300 Hz"))
    rates = re.findall(r"[0-9.]+ Hz", caught.value.problems[0].remedy)
    assert len(rates) == 2
    for rate in rates:
        Simulation.from_text((SHAFT + POSITION).replace("sample_rate: 250 Hz", f"sample_rate: {rate}"))


def test_another_step_changes_the_number_of_steps_between_samples():
    simulation = Simulation.from_text(SHAFT + POSITION, step=5e-4)
    assert [(slots.every, slots.delay) for slots in simulation.model.equations.actuators.layout.slots] == [(8, 6)]


def test_a_mechanism_with_a_sampled_servo_is_not_linearized():
    with pytest.raises(MechanismError, match="actuators change only between steps: drive"):
        Simulation.from_text(SHAFT + POSITION).linearize()
    proportional = "  drive: {type: effort, joint: shaft, servo: {controls: position, kp: 6, kd: 0.4}}\n"
    linear = Simulation.from_text(SHAFT + proportional).linearize()
    assert np.linalg.eigvals(linear.a) == pytest.approx(np.roots([INERTIA, 0.4, 6.0]), rel=1e-9)
    assert math.isclose(linear.b[1, 0], 1.0 / INERTIA, rel_tol=1e-12)


def test_the_accounts_of_a_motor_that_drives_against_a_stop_close():
    stop = SHAFT.replace("position: 0.3", "position: 0.3, limits: {lower: -1, upper: 1.0, restitution: 0.5}")
    simulation = Simulation.from_text(stop + DC, method="tsitouras8", step=1e-4)
    simulation.set_commands({"drive": 1.5})
    simulation.run(until=0.6)
    account = simulation.actuators()["drive"].energies
    assert simulation.losses.impact > 0.1 and abs(simulation.energies.residual) < 1e-12
    assert abs(account.residual) < 1e-9 * account.electrical_work
    assert account.mechanical_work == pytest.approx(simulation.losses.impact, rel=1e-9)  # at rest, without gravity
