"""Drives that follow commands: closed forms of their filter, their limits, and the motion that they force on the rest.

A drive at the position r with the velocity v and the acceleration a moves the rest as the drive r + v t + a t²/2 does.
"""

import math
import re

import numpy as np
import pytest

from mbd_sim import Simulation, parse_mechanism
from mbd_sim.analysis.mechanics.inverse_dynamics import inertia_split
from mbd_sim.base.errors import CommandError, MechanismError
from mbd_sim.dynamics.equations import derive
from mbd_sim.studies.report.mechanism_report import report
from mbd_sim.studies.report.text import report_text

ARM = """
mechanism: arm
parts:
  arm: {{mass: 1, center: [0.3, 0, 0], inertia: [0.1, 0.1, 0.1], points: {{end: [0.6, 0, 0]}}}}
  rod: {{shape: {{type: rod, to: [0, 0, -0.5], mass: 1}}}}
joints:
  base: {{type: revolute, between: [ground, arm], axis: [0, -1, 0], drive: {drive}}}
  tip: {{type: revolute, between: [arm.end, rod], axis: [0, -1, 0], position: 0.4}}
integrator: {{step: 1e-3}}
"""
LOOP = """
mechanism: loop
parts:
  slide: {{mass: 0.3, inertia: [0.01, 0.01, 0.01]}}
  crank: {{shape: {{type: rod, to: [0.2, 0, 0.1], mass: 0.4}}, points: {{end: [0.2, 0, 0.1]}}}}
  coupler: {{shape: {{type: rod, to: [0.5, 0, 0], mass: 0.6}}, points: {{end: [0.5, 0, 0]}}}}
  rocker: {{shape: {{type: rod, to: [0, 0, 0.4], mass: 0.5}}, points: {{end: [0, 0, 0.4]}}}}
  nut: {{mass: 0.2, inertia: [0.02, 0.02, 0.02]}}
joints:
  shake: {{type: prismatic, between: [ground, slide], axis: [0, 0.6, 0.8], drive: {shake}}}
  pin_1: {{type: revolute, between: [slide, crank], axis: [0, 1, 0], drive: {crank}}}
  pin_2: {{type: revolute, between: [crank.end, coupler], axis: [0, 1, 0], guess: true}}
  pin_3: {{type: revolute, between: [coupler.end, rocker.end], axis: [0, 1, 0], guess: true}}
  pin_4: {{type: revolute, between: [slide, rocker], axis: [0, 1, 0], position: 0.9, guess: true}}
  thread: {{type: screw, between: [crank, nut], axis: [0, 0, 1], lead: 0.02, drive: {thread}}}
forces:
  pull: {{type: spring, between: [nut, ground], stiffness: 30, length: 0.1}}
sensors:
  feel: {{type: imu, at: rocker, rate: 100 Hz}}
"""
STATES = {"shake": (0.02, 0.4, -3.0), "crank": (0.3, 2.5, 7.0), "thread": (0.2, -4.0, 11.0)}
BANDWIDTH = 20.0


def arm(drive, **options):
    return Simulation.from_text(ARM.format(drive=drive), **options)


def step_response(t):
    """The distance from the new position that remains of 1, for poles at -ω, -ω and -4 ω, from rest."""
    s = BANDWIDTH * t
    return (8.0 / 9.0 + 4.0 / 3.0 * s) * math.exp(-s) + math.exp(-4.0 * s) / 9.0


@pytest.mark.parametrize(
    ("method", "error"),
    [
        ("tsitouras8", 1e-13),
        ("gauss4", 3e-9),
        ("rosenbrock", 1e-7),
    ],
)
def test_a_step_of_the_position_is_followed_as_by_the_closed_form(method, error):
    simulation = arm("{command: position, bandwidth: 20 rad/s, position: 0.1}", method=method)
    simulation.run(until=0.05)
    assert simulation.drives()["base"].position == 0.1  # held
    simulation.set_commands({"base": -0.9})
    for step in range(1, 500):
        simulation.step()
        assert simulation.drives()["base"].position == pytest.approx(-0.9 + step_response(1e-3 * step), abs=error)


def test_a_ramp_with_its_velocity_is_followed_without_a_lasting_error():
    simulation = arm("{command: position, bandwidth: 20 rad/s}")
    for step in range(2000):
        simulation.set_commands({"base": {"position": 1e-3 * step, "velocity": 1.0}})
        simulation.step()
    state = simulation.drives()["base"]
    assert state.velocity == pytest.approx(1.0, abs=1e-8)  # the command is a staircase
    # The command is held for a step, and so is late by half of one on average; v* - v vanishes on average.
    assert state.position == pytest.approx(2.0 - 0.5e-3, abs=1e-5)


def test_a_commanded_velocity_is_followed_as_by_the_closed_form():
    simulation = arm("{command: velocity, bandwidth: 20 rad/s}")
    simulation.set_commands({"base": 3.0})
    for step in range(1, 400):
        simulation.step()
        state, s = simulation.drives()["base"], 60.0 * 1e-3 * step
        assert state.velocity == pytest.approx(3.0 * (1.0 - (1.0 + s) * math.exp(-s)), abs=1e-12)
        integral = 3.0 * (s - 2.0 + (2.0 + s) * math.exp(-s)) / 60.0
        assert state.position == pytest.approx(integral, abs=1e-12)


LIMITED = "velocity_limit: 1.5, acceleration_limit: 12, lower: -0.4, upper: 0.7"


@pytest.mark.parametrize(("controls", "bandwidth"), [("position", 40), ("velocity", 5)])
def test_no_command_moves_a_drive_beyond_its_limits(controls, bandwidth):
    simulation = arm(f"{{command: {controls}, bandwidth: {bandwidth}, {LIMITED}}}")
    chance, reached = np.random.default_rng(5), np.zeros((0, 3))
    first = simulation.model.layout.drives["base"]
    for _ in range(60):
        simulation.set_commands(
            {"base": {name: chance.uniform(-3.0, 3.0) for name in simulation.mechanism.commanded[0].channels}}
        )
        for _ in range(8):
            simulation.step(25)
            reached = np.vstack([reached, simulation.q[first]])
    assert reached[:, 0].min() >= -0.4 - 1e-12 and reached[:, 0].max() <= 0.7 + 1e-12
    assert np.abs(reached[:, 1]).max() <= 1.5 * (1.0 + 1e-12) and np.abs(reached[:, 2]).max() <= 12.0 * (1.0 + 1e-12)
    assert reached[:, 0].max() > 0.5 and np.abs(reached[:, 2]).max() > 11.0  # they act


@pytest.mark.parametrize("distance", [0.05, 0.3, 3.0])
def test_a_limited_drive_arrives_without_overshoot(distance):
    simulation = arm("{command: position, bandwidth: 10, velocity_limit: 1, acceleration_limit: 2}")
    simulation.set_commands({"base": distance})
    furthest = 0.0
    for _ in range(1500):
        simulation.step(5)
        furthest = max(furthest, simulation.drives()["base"].position)
    assert furthest <= distance * (1.0 + 1e-12)
    assert simulation.drives()["base"].position == pytest.approx(distance, abs=1e-9)


def equations_of(as_commands):
    """The loop, with drives that follow commands or with the same motions as functions of time."""
    drives = {
        name: f"{{command: position, bandwidth: 20, position: {r}}}" if as_commands else f"{r} + {v}*t + {a / 2.0}*t**2"
        for name, (r, v, a) in STATES.items()
    }
    return derive(parse_mechanism(LOOP.format(**drives)))


def test_the_equations_are_those_of_the_same_motion_as_a_function_of_time():
    commanded, timed = equations_of(True), equations_of(False)
    layout, nv = commanded.layout, commanded.layout.nv
    chance = np.random.default_rng(3)
    q, u = timed.start.q + chance.uniform(-0.1, 0.1, nv), chance.uniform(-2.0, 2.0, nv)
    own = np.concatenate([q, *STATES.values()])
    assert layout.nq == nv + 9 and list(layout.drives) == ["shake", "pin_1", "thread"]
    y = np.concatenate([own, u, np.zeros(3)])
    at = np.concatenate([q, u, np.zeros(3)])
    inputs = commanded.inputs_without_commands
    found = np.array(commanded.rates.call([0.0, y, inputs])[0]).ravel()
    expected = np.array(timed.rates.call([0.0, at, timed.inputs_without_commands])[0]).ravel()
    assert np.delete(found, slice(nv, nv + 9)) == pytest.approx(expected, rel=1e-11, abs=1e-11)
    for name in ("drives", "multipliers", "violation", "reactions", "poses"):
        one, other = getattr(commanded, name), getattr(timed, name)
        given, alike = ([0.0, y, inputs], [0.0, at, timed.inputs_without_commands])
        found = np.array(one.call(given[: one.n_in()])[0])
        expected = np.array(other.call(alike[: other.n_in()])[0])
        assert found == pytest.approx(expected, rel=1e-11, abs=1e-11), name
    rates = chance.uniform(-5.0, 5.0, nv)
    split, same = inertia_split(commanded), inertia_split(timed)
    for term, other in zip(split.at(0.0, own, u, rates), same.at(0.0, q, u, rates), strict=True):
        assert term == pytest.approx(other, rel=1e-11, abs=1e-11)


def commanded_loop(**options):
    drives = {name: f"{{command: position, bandwidth: 20, position: {r}}}" for name, (r, _, _) in STATES.items()}
    return Simulation.from_text(LOOP.format(**drives), **options)


COMMANDS = {"shake": 0.1, "pin_1": {"position": 1.2, "velocity": 0.5}, "thread": -1.0}


def test_a_loop_under_commanded_drives_stays_closed_and_its_energies_balance():
    simulation = commanded_loop()
    simulation.set_commands(COMMANDS)
    worst = 0.0
    for _ in range(60):
        simulation.step(10)
        worst = max(worst, abs(simulation.energies.residual))
    assert simulation.violation.position < 1e-12 and simulation.violation.velocity < 1e-11
    assert abs(simulation.energies.work_drives) > 0.1 and worst < 1e-12


def test_the_specific_force_is_that_of_the_acceleration_of_the_drive():
    text = """
mechanism: sled
parts: {sled: {mass: 1}}
joints: {rail: {type: prismatic, between: [ground, sled], axis: [1, 0, 0], drive: {command: position, bandwidth: 20}}}
sensors: {feel: {type: imu, at: sled, rate: 1000 Hz}}
"""
    simulation = Simulation.from_text(text)
    simulation.set_commands({"rail": 1.0})
    simulation.step(100)
    acceleration = simulation.q[2]
    feel = simulation.sensors()["feel"]["specific_force"]
    assert abs(acceleration) > 1.0 and feel == pytest.approx([acceleration, 0.0, 9.81], abs=1e-12)
    assert simulation.drives()["rail"].force == pytest.approx(acceleration, abs=1e-12)


def test_snapshots_and_states_continue_bit_for_bit_and_resets_begin_anew():
    simulation = commanded_loop()
    start = simulation.state
    simulation.set_commands(COMMANDS)
    simulation.step(50)
    middle, state, inputs, steps = simulation.snapshot(), simulation.state, simulation.inputs.copy(), simulation.steps
    simulation.step(200)
    end = simulation.state
    simulation.restore(middle)
    simulation.step(200)
    assert simulation.state.tobytes() == end.tobytes()
    simulation.restore(state, steps, inputs, history=middle.history)
    for _ in range(200):
        simulation.step()
    assert simulation.state.tobytes() == end.tobytes()
    simulation.reset()
    assert simulation.state.tobytes() == start.tobytes()
    simulation.step(100)  # without a command it is held
    assert [drive.position for drive in simulation.drives().values()] == [r for r, _, _ in STATES.values()]


def test_commands_that_a_drive_does_not_take_are_refused():
    simulation = arm("{command: velocity, bandwidth: 20}")
    with pytest.raises(CommandError, match=r"'base' takes no position. Command its velocity."):
        simulation.set_commands({"base": {"position": 1.0}})
    with pytest.raises(CommandError, match="not finite"):
        simulation.set_commands({"base": math.nan})
    with pytest.raises(CommandError, match=r"there is no actuator 'bass'. Did you mean 'base'"):
        simulation.set_commands({"bass": 1.0})


@pytest.mark.parametrize(
    ("drive", "problem"),
    [
        ("{command: position}", r"<text>:7: joints.base.drive: 'bandwidth' is missing"),
        (
            "{command: effort, bandwidth: 20}",
            r"<text>:7: joints.base.drive.command: unknown word .*position or velocity",
        ),
        ("{command: position, bandwidth: 0}", "bandwidth: must be greater than 0"),
        ("{command: position, bandwidth: 20, velocity_limit: 3 m/s}", "velocity_limit.*rad/s"),
        ("{command: position, bandwidth: 20, lower: 1, upper: 0.5, position: 1}", "lower 1 is not below upper 0.5"),
        ("{command: position, bandwidth: 20, upper: 0.5, position: 1}", "the position 1 is beyond its own limits"),
        ("{command: position, bandwidth: 20, speed_limit: 1}", "speed_limit.*unknown key"),
        ("{command: position, bandwidth: 200}", "too high for steps of 0.001 s.*at most 125 rad/s, or use steps of"),
    ],
)
def test_mistakes_in_a_drive_are_reported_with_a_remedy(drive, problem):
    with pytest.raises(MechanismError, match=f"(?s){problem}"):
        derive(parse_mechanism(ARM.format(drive=drive)))


IN_A_ROW = """
mechanism: table
parts: {slide: {mass: 0}, turned: {mass: 1, inertia: [1, 1, 1]}}
joints:
  along: {type: prismatic, between: [ground, slide], axis: [0, 0, 1], drive: {command: position, bandwidth: 20}}
  about: {type: revolute, between: [slide, turned], axis: [0, 0, 1], drive: {command: velocity, bandwidth: 20}}
"""


@pytest.mark.parametrize("drive", ["{command: position, bandwidth: 5}", "[2*t, {command: velocity, bandwidth: 5}]"])
def test_joints_of_several_coordinates_name_the_joints_to_use_instead(drive):
    joints = f"joints: {{j: {{type: cylindrical, between: [ground, turned], axis: [0, 0, 1], drive: {drive}}}}}\n"
    with pytest.raises(
        MechanismError, match=r"joints\.j\.drive: only drives of joints with one coordinate .* in a row"
    ):
        parse_mechanism("mechanism: m\nparts: {turned: {mass: 1, inertia: [1, 1, 1]}}\n" + joints)
    simulation = Simulation.from_text(IN_A_ROW)
    simulation.set_commands({"along": 0.5, "about": 2.0})
    simulation.run(until=2.0)
    assert simulation.drives()["along"].position == pytest.approx(0.5, abs=1e-9)


def test_drives_that_contradict_each_other_are_refused():
    text = LOOP.format(**dict.fromkeys(STATES, "{command: position, bandwidth: 20}"))
    text = text.replace(
        "axis: [0, 1, 0], position: 0.9, guess: true",
        "axis: [0, 1, 0], drive: {command: position, bandwidth: 20, position: 0.9}",
    )
    with pytest.raises(MechanismError, match="drive"):
        derive(parse_mechanism(text))


def test_a_linearization_is_that_with_a_drive_that_stands_still():
    servo = "actuators: {motor: {type: effort, joint: tip}}\n"
    found, still = (
        Simulation.from_text(ARM.format(drive=drive) + servo).linearize()
        for drive in ("{command: position, bandwidth: 20, position: 0.1}", "0.1")
    )
    assert (found.commands, found.states) == (("motor.effort",), ())
    for name in ("a", "b", "by_commands"):
        assert getattr(found, name) == pytest.approx(getattr(still, name), rel=1e-14, abs=1e-14)


def test_an_actuator_must_not_have_the_name_of_a_drive():
    text = ARM.format(drive="{command: position, bandwidth: 20}") + "actuators: {base: {type: effort, joint: tip}}\n"
    with pytest.raises(MechanismError, match=r"the drive of the joint 'base' takes commands by this name too. Rename"):
        parse_mechanism(text)


def test_the_report_says_what_a_drive_follows():
    text = report_text(report(arm(f"{{command: position, bandwidth: 20, {LIMITED}}}")))
    expected = (
        "Driven              base = commanded position, with a bandwidth of 20/s, speed up to 1.5 rad/s, acceleration up to "
        "12 rad/s², between -0.4 and 0.7 rad"
    )
    assert re.search(re.escape(expected), text), text
