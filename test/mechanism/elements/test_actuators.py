"""Bases on wheels: speeds and angles against the rolling of each wheel, limits, and what is refused."""

import math

import numpy as np
import pytest

from mbd_sim import Simulation, parse_mechanism
from mbd_sim.base.errors import CommandError, MechanismError
from mbd_sim.mechanism.elements.actuators import Velocity
from mbd_sim.studies.report.mechanism_report import report
from mbd_sim.studies.report.text import report_text

WHEELS = {"fl": (0.3, 0.2), "fr": (0.3, -0.2), "rl": (-0.3, 0.2), "rr": (-0.3, -0.2)}
RADIUS = 0.1
JOINTS = "".join(
    f"  {name}: {{type: revolute, between: [chassis, wheel_{name}], axis: [0, 1, 0], "
    "drive: {command: velocity, bandwidth: 40, velocity_limit: 30}}\n"
    for name in WHEELS
)
STEERING = """
  steer_l: {type: revolute, between: [chassis, hub_l], axis: [0, 0, 1], drive: {command: position, bandwidth: 30, lower: -0.6, upper: 0.5}}
  steer_r: {type: revolute, between: [chassis, hub_r], axis: [0, 0, -1], drive: {command: position, bandwidth: 30, lower: -0.7, upper: 0.6}}
"""
TEXT = (
    "mechanism: vehicle\nparts:\n  chassis: {mass: 5, inertia: [1, 1, 1]}\n"
    + "".join(f"  wheel_{name}: {{mass: 1, inertia: [0.01, 0.01, 0.01]}}\n" for name in WHEELS)
    + "".join(f"  hub_{side}: {{mass: 1, inertia: [0.01, 0.01, 0.01]}}\n" for side in "lr")
    + "joints:\n  ride: {type: planar, between: [ground, chassis], axis: [0, 0, 1], x_axis: [1, 0, 0]}\n"
    + JOINTS + STEERING
)  # fmt: skip
DIFFERENTIAL = "differential, left: [fl, rl], right: [fr, rr], reversed: [rr], track: 0.4, radius: 0.1"
MECANUM = (
    "mecanum, front_left: fl, front_right: fr, rear_left: rl, rear_right: rr, track: 0.4, wheelbase: 0.6, radius: 0.1"
)
CAR = "car, left: rl, right: rr, steering: [steer_l, steer_r], reversed: [steer_r], track: 0.4, wheelbase: 0.6, radius: 0.1"


def base(keys):
    return parse_mechanism(f"{TEXT}bases:\n  robot: {{type: {keys}}}\n").bases[0]


def contact_velocity(velocity, at):
    """The velocity of a point of the base over a contact, in the frame of the base."""
    return velocity.x - velocity.yaw * at[1], velocity.y + velocity.yaw * at[0]


@pytest.mark.parametrize("velocity", [Velocity(0.5, 0.0, 0.0), Velocity(0.3, 0.0, -0.9), Velocity(0.0, 0.0, 1.1)])
def test_the_wheels_of_a_differential_base_roll_at_the_mean_speed_of_their_side(velocity):
    found = base(DIFFERENTIAL).commands(velocity)
    commands = found.takers
    assert not found.limited
    for name, at in WHEELS.items():
        sign = -1.0 if name == "rr" else 1.0
        assert sign * RADIUS * commands[name]["velocity"] == pytest.approx(contact_velocity(velocity, at)[0], abs=1e-15)


@pytest.mark.parametrize("velocity", [Velocity(0.5, -0.2, 0.7), Velocity(0.0, 0.4, 0.0), Velocity(-0.1, 0.3, -1.0)])
def test_mecanum_wheels_slip_only_in_the_direction_in_which_their_rollers_turn(velocity):
    found = base(MECANUM).commands(velocity)
    commands = found.takers
    for name, at in WHEELS.items():
        roller = np.array([1.0, -math.copysign(1.0, at[0] * at[1])])  # the axis of the roller on the ground
        slip = np.array(contact_velocity(velocity, at)) - [RADIUS * commands[name]["velocity"], 0.0]
        assert slip @ roller == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize("velocity", [Velocity(1.0, 0.0, 0.5), Velocity(-0.8, 0.0, 0.3), Velocity(0.6, 0.0, 0.0)])
def test_the_wheels_of_a_car_do_not_slip_sideways(velocity):
    found = base(CAR).commands(velocity)
    commands = found.takers
    assert not found.limited
    for name, at, sign in (("steer_l", (0.6, 0.2), 1.0), ("steer_r", (0.6, -0.2), -1.0)):
        angle = sign * commands[name]["position"]
        x, y = contact_velocity(velocity, at)
        assert y * math.cos(angle) - x * math.sin(angle) == pytest.approx(0.0, abs=1e-15)
    for name, y in (("rl", 0.2), ("rr", -0.2)):
        assert RADIUS * commands[name]["velocity"] == pytest.approx(velocity.x - velocity.yaw * y, abs=1e-15)


@pytest.mark.parametrize("yaw", [5.0, -5.0])
def test_a_car_turns_as_tightly_as_each_of_its_wheels_can_be_steered(yaw):
    found = base(CAR).commands(Velocity(1.0, 0.0, yaw))
    commands = found.takers
    assert found.limited
    left, right = commands["steer_l"]["position"], -commands["steer_r"]["position"]
    assert -0.6 - 1e-12 <= left <= 0.5 + 1e-12 and -0.6 - 1e-12 <= right <= 0.7 + 1e-12
    assert min(abs(left - 0.5), abs(right + 0.6)) < 1e-12  # that of the inner wheel
    curvature = RADIUS * (commands["rr"]["velocity"] - commands["rl"]["velocity"]) / 0.4
    for angle, y in ((left, 0.2), (right, -0.2)):
        assert math.tan(angle) == pytest.approx(curvature * 0.6 / (1.0 - curvature * y), rel=1e-12)


def test_wheels_that_would_be_too_fast_are_slowed_down_alike():
    found = base(DIFFERENTIAL).commands(Velocity(4.0, 0.0, 2.0))
    full = found.takers
    assert found.limited and full["fr"]["velocity"] == pytest.approx(30.0)
    assert full["fl"]["velocity"] / full["fr"]["velocity"] == pytest.approx(3.6 / 4.4)
    assert base(DIFFERENTIAL).commands(Velocity(0.0, 0.0, 0.0)).takers["fl"] == {"velocity": 0.0}


def test_velocities_that_a_base_cannot_have_are_refused():
    for keys in (DIFFERENTIAL, CAR):
        with pytest.raises(CommandError, match="cannot move sideways"):
            base(keys).commands(Velocity(0.1, 0.1, 0.0))
    with pytest.raises(CommandError, match="cannot turn on the spot"):
        base(CAR).commands(Velocity(0.0, 0.0, 0.1))
    with pytest.raises(CommandError, match="not finite"):
        Velocity.of((math.nan, 0.0, 0.0), (0.0, 0.0, 0.0))
    with pytest.raises(CommandError, match=r"linear\.z, angular\.x would lead out of the plane"):
        Velocity.of((0.0, 0.0, 0.1), (0.2, 0.0, 0.0))


def test_a_base_on_driven_wheels_moves_along_an_arc():
    """Both wheels follow with the same filter, so that the path is the arc, at every time."""
    rolling = "".join(
        f"  {side}: {{type: rolling, wheel: {side}, axis: [0, 1, 0], radius: 0.1}}\n" for side in ("left", "right")
    )
    wheels = "".join(
        f"  {side}: {{type: revolute, between: [chassis.{side}, {side}], axis: [0, 1, 0], "
        "drive: {command: velocity, bandwidth: 30}}\n"
        for side in ("left", "right")
    )
    text = (
        "mechanism: robot\nground: {points: {axle: [0, 0, 0.1]}}\nparts:\n"
        "  chassis: {mass: 5, inertia: [1, 1, 1], points: {left: [0, 0.2, 0], right: [0, -0.2, 0]}}\n"
        "  left: {mass: 1, inertia: [0.01, 0.01, 0.01]}\n  right: {mass: 1, inertia: [0.01, 0.01, 0.01]}\n"
        "joints:\n  ride: {type: planar, between: [ground.axle, chassis], axis: [0, 0, 1], x_axis: [1, 0, 0]}\n"
        f"{wheels}constraints:\n{rolling}"
        "bases: {robot: {type: differential, left: left, right: right, track: 0.4, radius: 0.1}}\n"
    )
    simulation = Simulation.from_text(text)
    simulation.set_commands(simulation.mechanism.bases[0].commands(Velocity(0.5, 0.0, 0.8)).takers)
    for _ in range(10):
        simulation.step(200)
        s = 90.0 * simulation.time
        elapsed = (s - 2.0 + (2.0 + s) * math.exp(-s)) / 90.0  # the integral of 1 - (1 + s) exp(-s)
        angle = 0.8 * elapsed
        expected = [0.625 * math.sin(angle), 0.625 * (1.0 - math.cos(angle)), angle]
        assert simulation.q[:3] == pytest.approx(expected, abs=1e-11)


@pytest.mark.parametrize(
    ("keys", "problem"),
    [
        (DIFFERENTIAL.replace("[fl, rl]", "fll"), "bases.robot.left.*there is no joint 'fll'. Did you mean 'fl'"),
        (DIFFERENTIAL.replace("[fl, rl]", "steer_l"), "nothing controls the velocity of 'steer_l'. Give the joint an"),
        (CAR.replace("[steer_l, steer_r]", "fl"), "nothing controls the position of 'fl'. Give the joint an actuator"),
        (CAR.replace("[steer_l, steer_r]", "[steer_l, steer_r, steer_l]"), "names 3 joints. Name one in the middle"),
        (DIFFERENTIAL.replace("[rr]", "[steer_l]"), "reversed.*'steer_l' is not one of its wheels"),
        (DIFFERENTIAL.replace("[fr, rr]", "[fr, rl]"), "a wheel is named twice"),
        (DIFFERENTIAL.replace("track: 0.4", "track: 0"), "track.*greater than 0"),
        (MECANUM.replace("wheelbase: 0.6, ", ""), "'wheelbase' is missing"),
    ],
)
def test_mistakes_in_a_base_are_reported_with_a_remedy(keys, problem):
    with pytest.raises(MechanismError, match=problem):
        base(keys)


def test_a_wheel_belongs_to_one_base():
    with pytest.raises(MechanismError, match="'fl' belongs to the base 'one' as well"):
        parse_mechanism(f"{TEXT}bases:\n  one: {{type: {DIFFERENTIAL}}}\n  two: {{type: {MECANUM}}}\n")


def test_the_report_names_the_wheels():
    text = report_text(report(Simulation.from_file("rover")))
    assert "Base                rover: differential, on the wheels left_motor, right_motor" in text
