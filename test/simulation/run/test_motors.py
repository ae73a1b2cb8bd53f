"""Motors on joints and between points: closed forms, reflected inertia, limits, and the account of their energies."""

import math

import numpy as np
import pytest
from scipy.linalg import expm

from mbd_sim import Simulation
from mbd_sim.base.errors import CommandError

INERTIA, ROTOR, GEAR = 0.01, 2e-5, 10.0
CONSTANT, RESISTANCE, INDUCTANCE = 0.05, 1.2, 2e-3
SHAFT = f"""
mechanism: shaft
gravity: [0, 0, 0]
parts:
  wheel: {{mass: 1, inertia: [{INERTIA}, {INERTIA}, {INERTIA}]}}
joints:
  shaft: {{type: revolute, between: [ground, wheel], axis: [0, 0, 1]}}
actuators:
"""
MOTOR = f"""  drive:
    type: dc_motor
    joint: shaft
    torque_constant: {CONSTANT} N*m/A
    resistance: {RESISTANCE} ohm
    gear_ratio: {GEAR}
    rotor_inertia: {ROTOR} kg*m^2
"""
INDUCTIVE = f"    inductance: {INDUCTANCE} H\n"
DOUBLE = """
mechanism: two_links
parts:
  upper: {mass: 1, center: [0, 0, -0.3], inertia: [0.02, 0.03, 0.01], points: {end: [0, 0, -0.6]}}
  lower: {mass: 0.7, center: [0.1, 0, -0.2], inertia: [0.01, 0.02, 0.01]}
joints:
  hip: {type: revolute, between: [ground, upper], axis: [0, -1, 0], position: 0.4}
  knee: {type: revolute, between: [upper.end, lower], axis: [0.2, -1, 0], position: 0.7}
"""


def shaft(*lines, **options):
    return Simulation.from_text(SHAFT + MOTOR + "".join(f"    {line}\n" for line in lines), **options)


def step_response(time, voltage, inductance):
    """Speed of the shaft and current a time after a voltage was applied at rest."""
    total, k = INERTIA + GEAR**2 * ROTOR, GEAR * CONSTANT
    if not inductance:
        speed = voltage / k * -math.expm1(-(k**2) / (RESISTANCE * total) * time)
        return speed, (voltage - k * speed) / RESISTANCE
    matrix = np.array([[0.0, k / total], [-k / inductance, -RESISTANCE / inductance]])
    return np.linalg.solve(matrix, (expm(matrix * time) - np.eye(2)) @ [0.0, voltage / inductance])


@pytest.mark.parametrize(
    ("method", "inductance"),
    [
        ("rk4", 0.0),
        ("tsitouras8", INDUCTANCE),
        ("gauss6", 0.0),
        ("rosenbrock", INDUCTANCE),
        ("rosenbrock_w", INDUCTANCE),
    ],
)
def test_the_step_response_is_the_closed_form(method, inductance):
    lines = [INDUCTIVE.strip()] if inductance else []
    simulation = shaft(
        *lines, "command: {voltage: 24}", method=method, step={"rk4": 2e-5, "rosenbrock_w": 4e-6}.get(method, 1e-4)
    )
    for time in (0.002, 0.02):
        simulation.run(until=time)
        state = simulation.actuators()["drive"]
        expected = step_response(simulation.time, 24.0, inductance)
        assert (simulation.u[0], state.current) == pytest.approx(expected, rel=1e-9, abs=1e-9)
        assert state.voltage == 24.0 and state.effort == pytest.approx(GEAR * CONSTANT * expected[1], rel=1e-9)
    assert abs(simulation.energies.residual) <= 1e-9 * simulation.energies.total


@pytest.mark.parametrize("lines", [[], [INDUCTIVE.strip()], [INDUCTIVE.strip(), "efficiency: 0.8", "damping: 1e-5"]])
def test_electrical_work_is_mechanical_work_losses_and_stored_energy(lines):
    simulation = shaft(*lines, "command: {voltage: 24}", step=1e-4)
    simulation.run(until=0.05)
    simulation.set_commands({"drive": -10.0})  # brakes: the efficiency acts the other way
    simulation.run(until=0.3)
    account = simulation.actuators()["drive"].energies
    assert abs(account.residual) < 1e-9 * abs(account.electrical_work)
    assert account.mechanical_work == pytest.approx(simulation.energies.work_applied, rel=1e-12)
    assert account.copper_loss > 0.0 and (account.friction_loss > 0.0) == (len(lines) == 3)
    assert abs(simulation.energies.residual) < 1e-9 * simulation.energies.work_applied


def test_the_inertia_of_a_rotor_is_that_of_a_body_that_turns_with_the_joint():
    with_rotor = shaft(step=1e-3)
    heavier = SHAFT.replace(
        f"[{INERTIA}, {INERTIA}, {INERTIA}]", f"[{INERTIA + GEAR**2 * ROTOR}, 0.01, {INERTIA + GEAR**2 * ROTOR}]"
    )
    as_body = Simulation.from_text(
        heavier.replace("inertia: [", "inertia_check: false, inertia: [")
        + MOTOR.replace(f"    rotor_inertia: {ROTOR} kg*m^2\n", ""),
        step=1e-3,
    )
    for simulation in (with_rotor, as_body):
        simulation.set_commands({"drive": 12.0})
        simulation.run(until=0.2)
    assert with_rotor.u == pytest.approx(as_body.u, rel=1e-13)
    assert with_rotor.energies.kinetic == pytest.approx(as_body.energies.kinetic, rel=1e-13)


def test_the_drive_limits_the_current_and_then_the_voltage():
    simulation = shaft(INDUCTIVE.strip(), "voltage_limit: 24 V", "current_limit: 5 A", step=1e-4)
    simulation.set_commands({"drive": 100.0})
    currents, voltages = [], []
    for _ in range(6000):
        simulation.step()
        state = simulation.actuators()["drive"]
        currents.append(state.current)
        voltages.append(state.voltage)
    assert 4.99 < max(currents) <= 5.0 * (1.0 + 1e-12)
    assert max(voltages) == 24.0 and simulation.u[0] == pytest.approx(24.0 / (GEAR * CONSTANT), rel=1e-3)


@pytest.mark.parametrize("control, command", [("current", 3.0), ("effort", 3.0 * GEAR * CONSTANT)])
def test_a_commanded_current_or_effort_is_exact_without_limits(control, command):
    simulation = shaft(f"control: {control}", step=1e-3)
    simulation.set_commands({"drive": command})
    simulation.run(until=0.1)
    state = simulation.actuators()["drive"]
    assert state.current == pytest.approx(3.0, rel=1e-14) and state.commands == {control: command}
    assert simulation.u[0] == pytest.approx(0.1 * 3.0 * GEAR * CONSTANT / (INERTIA + GEAR**2 * ROTOR), rel=1e-12)


def test_a_current_loop_follows_at_its_bandwidth():
    simulation = shaft(INDUCTIVE.strip(), "control: current", "current_bandwidth: 2000 rad/s", step=1e-4)
    simulation.set_commands({"drive": 2.0})
    simulation.run(until=1e-3)
    assert simulation.actuators()["drive"].current == pytest.approx(2.0 * -math.expm1(-2.0), rel=1e-9)


def test_a_curve_limits_the_effort_while_the_motor_drives():
    text = SHAFT + "  drive: {type: effort, joint: shaft, torque_speed: [[0, 2 N*m], [10 rad/s, 2], [30 rad/s, 0]]}\n"
    simulation = Simulation.from_text(text)
    simulation.set_commands({"drive": 100.0})
    for speed, effort in ((0.0, 2.0), (5.0, 2.0), (20.0, 1.0), (40.0, 0.0), (-20.0, 2.0)):
        simulation.reset(u=[speed])
        simulation.set_commands({"drive": 100.0})
        assert simulation.actuators()["drive"].effort == pytest.approx(effort, abs=1e-14)
    simulation.reset(u=[-20.0])
    simulation.set_commands({"drive": -100.0})
    assert simulation.actuators()["drive"].effort == pytest.approx(-1.0, abs=1e-14)


def test_a_motor_with_a_lead_drives_a_slider():
    text = SHAFT.replace("revolute", "prismatic") + MOTOR + "    lead: 5 mm\n"
    text = text.replace(f"gear_ratio: {GEAR}", "gear_ratio: 2")
    simulation = Simulation.from_text(text, step=1e-4)
    simulation.set_commands({"drive": 12.0})
    simulation.run(until=0.4)
    ratio = 2.0 * 2.0 * math.pi / 5e-3
    assert simulation.mechanism.actuators[0].motor.gear == pytest.approx(ratio, rel=1e-15)
    rate = (ratio * CONSTANT) ** 2 / RESISTANCE / (1.0 + ratio**2 * ROTOR)
    assert simulation.u[0] == pytest.approx(12.0 / (ratio * CONSTANT) * -math.expm1(-rate * 0.4), rel=1e-9)


def test_an_actuator_between_two_points_is_a_pair_of_forces():
    cylinder = "actuators:\n  push: {type: effort, between: [ground.base, lower.tip]}\n"
    forces = "forces:\n  spring: {type: spring, between: [ground.base, lower.tip], force: '-5'}\n"
    linked = DOUBLE.replace("lower: {mass: 0.7,", "lower: {mass: 0.7, points: {tip: [0.1, 0.05, -0.4]},")
    linked += "ground: {points: {base: [0.5, 0.2, -0.2]}}\n"
    actuated, sprung = (Simulation.from_text(linked + tail) for tail in (cylinder, forces))
    actuated.set_commands({"push": 5.0})
    for simulation in (actuated, sprung):
        simulation.run(until=1.0)
    assert actuated.q == pytest.approx(sprung.q, abs=1e-11) and actuated.u == pytest.approx(sprung.u, abs=1e-10)
    assert abs(actuated.energies.residual) < 1e-9
    state = actuated.actuators()["push"]
    tip = actuated.poses()["lower"]
    length = np.linalg.norm(tip.position + tip.rotation @ [0.1, 0.05, -0.4] - [0.5, 0.2, -0.2])
    assert state.position == pytest.approx(length, rel=1e-14)


def test_motor_data_can_be_live_values_and_differ_among_members():
    simulation = shaft("command: {voltage: 12}", live=["actuators.drive.resistance"], step=1e-4)
    simulation.set_live({"actuators.drive.resistance": 2.4})
    simulation.run(until=0.1)
    other = Simulation.from_text(
        (SHAFT + MOTOR).replace("1.2 ohm", "2.4 ohm") + "    command: {voltage: 12}\n", step=1e-4
    )
    other.run(until=0.1)
    assert simulation.u == pytest.approx(other.u, rel=1e-12)


@pytest.mark.parametrize(
    "commands, message",
    [
        ({"drve": 1.0}, "there is no actuator 'drve'.*'drive'"),
        ({"drive": {"effort": 1.0}}, "takes no effort.*voltage"),
        ({"drive": math.nan}, "drive.*finite"),
        ({"drive": "fast"}, "not a number"),
        ({"drive": "3"}, r"drive\.voltage is not a number \('3' is a text\)"),
    ],
)
def test_a_command_that_does_not_fit_is_refused_whole(commands, message):
    simulation = shaft()
    with pytest.raises(CommandError, match=message):
        simulation.set_commands({"drive": 5.0, **commands} if "drive" not in commands else commands)
    assert simulation.actuators()["drive"].commands == {"voltage": 0.0}
