"""Actuators in a mechanism file: what is refused, with line, value and remedy, and units that depend on the joint."""

import math

import numpy as np
import pytest

from mbd_sim.base.errors import MechanismError
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.checks.override import value_of
from mbd_sim.files.load import parse_mechanism
from mbd_sim.mechanism.elements.actuators import CoordinatePort, LinePort
from test.generators.changed_sections import changed_files, loaded_or_refused

TEXT = """
mechanism: text
parts:
  arm: {mass: 1, center: [0, 0, -0.3], inertia: [0.02, 0.03, 0.01]}
  box: {mass: 1}
  ball: {mass: 1, inertia: [1, 1, 1]}
  tube: {mass: 1, inertia: [1, 1, 1]}
  crank: {mass: 1, inertia: [1, 1, 1]}
joints:
  shoulder: {type: revolute, between: [ground, arm], axis: [0, -1, 0]}
  rail: {type: prismatic, between: [ground, box], axis: [1, 0, 0]}
  socket: {type: spherical, between: [arm, ball]}
  sleeve: {type: cylindrical, between: [ground, tube], axis: [0, 0, 1]}
  turned: {type: revolute, between: [ground, crank], axis: [0, 0, 1], drive: 2*t}
actuators:
  it: ENTRY
"""
DC = "type: dc_motor, torque_constant: 0.1, resistance: 1"
CYLINDER = "areas: [12 cm^2, 8 cm^2], stroke: 0.5, dead_volumes: [1e-4, 1e-4]"
OIL = f"type: hydraulic_cylinder, {CYLINDER}, rated_flow: 20 L/min, supply: 150 bar"
AIR = f"type: pneumatic_cylinder, {CYLINDER}, conductance: 2e-8, supply: 7 bar"
REFUSED = {
    "{type: effort, joint: sholder}": r"it.joint: there is no joint coordinate 'sholder'. Did you mean 'shoulder'",
    "{type: effort, joint: socket}": r"it.joint: 'socket' has 3 coordinates. Name one of them: socket.rx",
    "{type: effort, joint: socket.rx, servo: {controls: velocity, kp: 1}}": r"it.joint: 'socket' is spherical",
    "{type: effort, terms: {rail: 1, nowhere: 2}}": r"it.terms.nowhere: there is no joint coordinate 'nowhere'",
    "{type: effort, at: arm}": r"it: 'at' and 'wrench' belong together",
    "{type: effort, at: ground, wrench: [1, 0, 0, 0, 0, 0]}": r"it.at: is a point of ground",
    "{type: effort, joint: rail, command_range: [2, 1]}": r"it: command_range goes from 2 down to 1",
    "{type: effort, joint: rail, effort_range: [1 N*m, 2 N*m]}": r"it.effort_range\[0\]: ",
    "{type: effort, joint: rail, bias: [1, 0, 0], servo: {controls: velocity, kp: 1}}": r"it: has a servo, and gain or bias",
    "{type: effort, joint: turned}": r"it.joint: 'turned' is driven.*Remove 'drive'",
    "{type: effort}": r"it: has none of joint, between, terms, at",
    "{type: effort, joint: rail, between: [arm, box]}": r"it: has joint and between",
    "{type: effort, between: [arm, arm]}": r"it.between: connects 'arm' with itself",
    "{type: effort, between: [arm, box], rotor_inertia: 1}": r"it: has between and rotor_inertia.*prismatic joint",
    "{type: effort, joint: shoulder, effort_limit: 5 N}": r"it.effort_limit: the unit 'N' does not fit.*N\*m.*'5 N'",
    "{type: effort, joint: rail, effort_limit: 5 N*m}": r"it.effort_limit: the unit 'N\*m' does not fit",
    "{type: effort, joint: rail, effort_limit: -5}": r"it.effort_limit: must be greater than 0",
    "{type: effort, joint: shoulder, torque_speed: [[1, 2], [3, 4]]}": r"it.torque_speed: begins at 1",
    "{type: effort, joint: shoulder, torque_speed: [[0, 2], [0, 4]]}": r"it.torque_speed: 0 comes after 0",
    "{type: effort, joint: shoulder, torque_speed: [[0, 2], [1 m/s, 4]]}": r"it.torque_speed\[1\]\[0\]: the unit 'm/s'",
    "{type: effort, joint: shoulder, command: {voltage: 5 V}}": r"it.command.voltage: the actuator takes no voltage. Give effort",
    "{type: effort, joint: shoulder, command: {effort: 5 V}}": r"it.command.effort: the unit 'V' does not fit",
    "{type: motor, joint: shoulder}": r"it.type: unknown type 'motor'. Did you mean 'dc_motor'",
    "{" + DC + ", joint: rail}": r"it: turns to move along a line, but has no lead. Add .*'lead: 5 mm'",
    "{" + DC + ", joint: shoulder, lead: 5 mm}": r"it.lead: has no effect on an angle",
    "{" + DC + ", joint: shoulder, current_bandwidth: 100}": r"it: current_bandwidth has no effect without inductance",
    "{" + DC + ", joint: shoulder, efficiency: 1.5}": r"it.efficiency: must be at most 1",
    "{type: dc_motor, joint: shoulder, torque_constant: 0.1 N, resistance: 1}": r"it.torque_constant: .*N\*m/A",
    "{type: dc_motor, joint: shoulder, torque_constant: 1}": r"it: 'resistance' is missing",
    "{type: effort, joint: rail, servo: {controls: position, kp: 5 N*m/rad}}": r"it.servo.kp: the unit .* N/m is exp",
    "{type: effort, joint: rail, servo: {controls: position}}": r"it.servo: has neither kp nor ki",
    "{type: effort, joint: rail, servo: {controls: speed, kp: 1}}": r"it.servo.controls: unknown word",
    "{type: effort, joint: rail, servo: {controls: velocity, kp: 1, kd: 1}}": r"it.servo: a continuous velocity servo",
    "{type: effort, joint: rail, servo: {controls: position, kp: 1, tracking_time: 1}}": r"it.servo: tracking_time has no effect",
    "{type: effort, joint: rail, servo: {controls: position, ki: 1, tracking_time: 1 ms, sample_rate: 10 Hz}}":
        r"it.servo: the tracking_time of 0.001 s is shorter than the sample period of 0.1 s",
    "{type: effort, joint: rail, effort_limit: 5, servo: {controls: position, ki: 1}}": r"it.servo: has ki and a limit",
    "{" + OIL + ", joint: shoulder}": r"it: a cylinder moves along a line, but acts on an angle. Give 'between'",
    "{" + OIL + ", between: [arm, box]}": r"it: has between and no 'retracted'. Give the distance",
    "{" + OIL + ", between: [arm, box], retracted: 0}": r"it: has between and 'retracted' 0",
    "{" + OIL + ", joint: rail, gear_ratio: 2}": r"it.gear_ratio: unknown key",
    "{" + OIL + ", joint: rail, tank: 200 bar}": r"it: the supply of 1.5e\+07 Pa is not above the tank of 2e\+07 Pa",
    "{" + OIL + ", joint: rail, conductance: 1e-8}": r"it.conductance: unknown key",
    "{" + OIL + ", joint: rail, command: {opening: 5 V}}": r"it.command.opening: the unit 'V' does not fit",
    "{" + OIL + ", joint: rail, servo: {controls: position, kp: 5 V/m}}": r"it.servo.kp: the unit 'V/m' does not fit",
    "{" + OIL + ", joint: rail, leakage: 1 L/min}": r"it.leakage: the unit 'L/min' does not fit: .*m\*\*3/\(s\*Pa\)",
    "{" + AIR + ", joint: rail, exhaust: 8 bar}": r"it: the supply of 700000 Pa is not above the exhaust of 800000 Pa",
    "{" + AIR + ", joint: rail, critical_ratio: 1}": r"it.critical_ratio: must be at most 0.9",
    "{" + AIR + ", joint: rail, exponent: 0.9}": r"it.exponent: must be at least 1",
    "{" + AIR + ", joint: rail, pressures: [0, 1 bar]}": r"it.pressures\[0\]: must be greater than 0",
    "{" + AIR + ", joint: rail, areas: 12 cm^2}": r"it.areas: ",
}  # fmt: skip


@pytest.mark.parametrize("entry", REFUSED)
def test_what_does_not_fit_is_refused_with_line_and_remedy(entry):
    with pytest.raises(MechanismError, match=r":16: actuators\." + REFUSED[entry]):
        parse_mechanism(TEXT.replace("ENTRY", entry))


def actuator(entry):
    return parse_mechanism(TEXT.replace("ENTRY", entry)).actuators[0]


def test_units_are_those_of_the_joint():
    turning = actuator("{type: effort, joint: sleeve.angle, effort_limit: 5 lbf*ft}")
    assert turning.port == CoordinatePort("sleeve.angle", True)
    assert turning.motor.effort_limit == pytest.approx(5 * 4.4482216152605 * 0.3048)
    sliding = actuator(
        "{type: effort, joint: sleeve.displacement, servo: {controls: position, kp: 2 N/mm, rate_limit: 3 cm/s}}"
    )
    assert (sliding.servo.kp, sliding.servo.rate_limit) == pytest.approx((2000.0, 0.03))
    electric = actuator(
        "{" + DC + ", joint: rail, lead: 5 mm, gear_ratio: 3, servo: {controls: velocity, kp: 1 V*s/cm}}"
    )
    assert electric.motor.gear == pytest.approx(3 * 2 * math.pi / 5e-3) and electric.servo.kp == pytest.approx(100.0)
    cylinder = actuator("{type: effort, between: [arm, box], effort_limit: 1 kN, delay: 5 ms}")
    assert isinstance(cylinder.port, LinePort) and cylinder.motor.effort_limit == 1000.0 and cylinder.delay == 5e-3


def test_the_limit_and_the_tracking_time_of_a_servo_follow_from_its_motor_and_gains():
    found = actuator("{" + DC + ", joint: shoulder, voltage_limit: 24, servo: {controls: position, kp: 10, ki: 40}}")
    assert (found.servo.limit, found.servo.tracking_time) == (24.0, 0.25)
    curve = "torque_speed: [[0, 3], [10, 1]]"
    assert (
        actuator("{type: effort, joint: shoulder, " + curve + ", servo: {controls: position, kp: 1}}").servo.limit
        == 3.0
    )


def test_actuators_can_be_repeated_and_their_values_have_keys():
    text = TEXT.replace(
        "  it: ENTRY", "  'm_{j}': {for: {j: [shoulder, rail]}, type: effort, joint: '{j}', effort_limit: 7}"
    )
    mechanism = parse_mechanism(text)
    assert [a.name for a in mechanism.actuators] == ["m_shoulder", "m_rail"]
    assert value_of(mechanism, "actuators.m_rail.effort_limit") == 7.0


SECTION = f"""
  lift: {{{OIL}, between: [arm, box], retracted: 0.2, leakage: 1e-12, pressures: [1 bar, 2 bar], command: {{opening: 0.1}}}}
  push: {{{AIR}, joint: rail, exponent: 1.3, delay: 3 ms, servo: {{controls: position, kp: 5 m^-1, sample_rate: 500 Hz}}}}
  turn: {{{DC}, joint: shoulder, gear_ratio: 3, inductance: 1 mH, voltage_limit: 24 V, efficiency: 0.9, friction: 0.1}}
  slide: {{{DC}, joint: sleeve.displacement, lead: 5 mm, control: effort, current_limit: 2 A, rotor_inertia: 1e-5}}
  spin: {{type: effort, joint: sleeve.angle, torque_speed: [[0, 3 N*m], [20 rad/s, 0]], command: {{effort: 0.1}}}}
  draw: {{type: effort, between: [box, ball], effort_limit: 9 N, servo: {{controls: velocity, kp: 3, ki: 2, kd: 1, limit: 5,
    velocity_feedforward: 1, tracking_time: 50 ms, rate_limit: 2, sample_rate: 100 Hz}}}}
"""


def test_random_sections_load_or_say_what_is_wrong_and_where():
    text = TEXT.replace("axis: [1, 0, 0]}", "axis: [1, 0, 0], position: 0.3}").strip()
    lines = text.replace("  it: ENTRY", SECTION.strip("\n")).splitlines()
    section = range(lines.index("actuators:") + 1, len(lines))

    def use(mechanism):
        assert np.isfinite(derive(mechanism).start_state).all()

    assert loaded_or_refused(lines, section, "actuators", use)
    loaded = [loaded_or_refused(one, section, "actuators", use) for one in changed_files(lines, section, 40, seed=15)]
    assert 0 < loaded.count(True) < 20


def test_a_joint_with_an_actuator_is_not_cut():
    loop = """
mechanism: loop
parts: {a: {mass: 1, inertia: [1, 1, 1], points: {e: [1, 0, 0]}}, b: {mass: 1, inertia: [1, 1, 1], points: {e: [0, 1, 0]}}}
ground: {points: {p: [1, 1, 0]}}
joints:
  one: {type: revolute, between: [ground, a], axis: [0, 0, 1], position: 0}
  two: {type: revolute, between: [a.e, b], axis: [0, 0, 1]}
  three: {type: revolute, between: [ground.p, b.e], axis: [0, 0, 1]}
actuators: {drive: {type: effort, joint: three}}
"""
    assert "three" in parse_mechanism(loop).joints
