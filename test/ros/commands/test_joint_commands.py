"""Which actuators the commands of a message reach, and what is refused whole."""

import math

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.errors import CommandError
from mbd_sim.files.checks.override import value_of, with_values
from mbd_sim.ros.commands.command_buffer import CommandBuffer
from mbd_sim.ros.commands.joint_commands import CommandRanges
from mbd_sim.ros.commands.trajectory_player import Trajectory, TrajectoryPoint

MIXED = """
mechanism: mixed
parts:
  one: {mass: 1, center: [0, 0, -0.3], inertia: [0.02, 0.03, 0.01], points: {end: [0, 0, -0.6]}}
  two: {mass: 1, center: [0, 0, -0.3], inertia: [0.02, 0.03, 0.01], points: {end: [0, 0, -0.6]}}
  three: {mass: 1, center: [0, 0, -0.3], inertia: [0.02, 0.03, 0.01], points: {end: [0, 0, -0.6]}}
  wheel: {mass: 1, inertia: [0.02, 0.03, 0.01]}
joints:
  hip: {type: revolute, between: [ground, one], axis: [0, -1, 0]}
  knee: {type: revolute, between: [one.end, two], axis: [0, -1, 0]}
  toe: {type: revolute, between: [two.end, three], axis: [0, -1, 0]}
  hub: {type: revolute, between: [three.end, wheel], axis: [0, -1, 0]}
integrator: {method: rk4}
actuators:
  a: {type: effort, joint: hip, servo: {controls: position, kp: 10}}
  b: {type: dc_motor, joint: knee, torque_constant: 0.1, resistance: 1, servo: {controls: velocity, kp: 5}}
  c: {type: dc_motor, joint: hub, torque_constant: 0.1, resistance: 1}
  cylinder: {type: effort, between: [ground, two.end]}
"""
JOINTS = ["hip", "knee", "toe", "hub"]


@pytest.fixture
def simulation():
    return Simulation.from_text(MIXED)


@pytest.fixture
def buffer(simulation):
    return CommandBuffer(simulation.effort_map, 0.5, simulation.command_map)


def due(simulation, buffer):
    return dict(
        zip(
            simulation.command_map.names,
            buffer.due_for_actuators(0.0, simulation.inputs[simulation.command_map.range]),
            strict=True,
        )
    )


def test_arrays_with_an_entry_for_each_joint_that_has_the_interface_are_those_of_ros2_control(simulation, buffer):
    buffer.by_name(JOINTS, [0.25, -2.0], positions=[0.5], velocities=[0.1, 3.0])  # hip and knee take a velocity
    assert due(simulation, buffer) == {
        "a.position": 0.5, "a.velocity": 0.1, "a.effort": 0.25, "b.velocity": 3.0, "c.voltage": 0.0,
        "cylinder.effort": 0.0,
    }  # fmt: skip
    assert buffer.due(0.0)[0].efforts.tolist() == [0.0, 0.0, -2.0, 0.0]  # that of toe acts directly
    assert buffer.accepted == 1


def test_names_with_full_arrays_reach_their_actuators_and_the_others_keep_their_commands(simulation, buffer):
    buffer.by_name(["hip"], [], positions=[0.5])
    buffer.by_name(["knee"], [], velocities=[-1.0])
    buffer.by_name(["cylinder"], [7.0])
    found = due(simulation, buffer)
    assert (found["a.position"], found["b.velocity"], found["cylinder.effort"]) == (0.5, -1.0, 7.0)
    assert buffer.due_for_actuators(0.0, np.zeros(6)) is None and buffer.due(0.0) == []


def test_all_channels_can_be_commanded_in_order(simulation, buffer):
    buffer.actuators_by_order([0.1, 0.2, 0.3, 0.4, 12.0, 5.0])
    assert list(due(simulation, buffer).values()) == [0.1, 0.2, 0.3, 0.4, 12.0, 5.0]
    buffer.clear()
    buffer.actuators_by_order([0.0] * 6)
    assert list(due(simulation, buffer).values()) == [0.0] * 6


@pytest.mark.parametrize(
    ("names", "arrays", "words"),
    [
        (["toe"], {"positions": [1.0]}, "joint 'toe' takes no position, as it has no servo. Command its effort."),
        (["hub"], {"efforts": [1.0]}, "the actuator of 'hub' takes no effort. Command its voltage."),
        (["nee"], {"positions": [1.0]}, "there is no joint 'nee'. Did you mean 'knee'?"),
        (JOINTS, {"positions": [1.0, 2.0]}, "'name' and 'position' differ in length: 4 and 2. Send one position for each name, or only for hip."),
        (["hip", "hip"], {"positions": [1.0, 2.0]}, "'hip' is named twice"),
        (["hip", "knee"], {"velocities": [1.0, math.nan]}, "b.velocity is not finite"),
        (["hip"], {"efforts": [1.0], "positions": [math.inf]}, "a.position is not finite"),
        (["hip"], {}, "'name' and 'effort' differ in length: 1 and 0."),
    ],
)  # fmt: skip
def test_a_bad_command_is_refused_whole(buffer, names, arrays, words):
    with pytest.raises(CommandError) as caught:
        buffer.by_name(names, arrays.pop("efforts", []), **arrays)
    assert words in str(caught.value)
    assert (buffer.accepted, buffer.rejected) == (0, 1)
    assert buffer.due_for_actuators(0.0, np.zeros(6)) is None and buffer.due(0.0) == []


@pytest.mark.parametrize(
    ("values", "words"),
    [([1.0], "6 commands expected, but 1 given. Give one for each of: a.position"), ([math.nan] * 6, "one finite")],
)
def test_commands_in_order_that_do_not_fit_are_refused(buffer, values, words):
    with pytest.raises(CommandError) as caught:
        buffer.actuators_by_order(values)
    assert words in str(caught.value) and buffer.rejected == 1


def test_nan_is_no_command_where_ros2_control_sends_it_for_interfaces_without_a_controller(simulation, buffer):
    buffer.skip_nan(True)
    nan = math.nan
    buffer.by_name(JOINTS, [nan, -2.0], positions=[0.5], velocities=[nan, 3.0])
    found = due(simulation, buffer)
    assert (found["a.position"], found["a.velocity"], found["a.effort"], found["b.velocity"]) == (0.5, 0.0, 0.0, 3.0)
    buffer.by_name(JOINTS, [nan, nan], positions=[nan], velocities=[nan, nan])  # before a controller is active
    assert buffer.due_for_actuators(0.0, np.zeros(6)) is None
    with pytest.raises(CommandError, match="position is not finite"):
        buffer.by_name(["hip"], [], positions=[math.inf])


def test_commands_of_each_actuator_expire_on_request_and_positions_are_held(simulation, buffer):
    buffer.watch_actuators(0.5)
    start = simulation.inputs[simulation.command_map.range]
    buffer.by_name(["hip"], [2.0], positions=[0.5], velocities=[0.1])
    buffer.by_name(["knee"], [], velocities=[3.0])
    buffer.by_name(["cylinder"], [7.0])
    assert buffer.due_for_actuators(10.0, start).tolist() == [0.5, 0.1, 2.0, 3.0, 0.0, 7.0]
    buffer.by_name(["knee"], [], velocities=[3.0])
    assert buffer.due_for_actuators(10.4, start) is not None
    assert buffer.take_expired_actuators() == []
    assert buffer.due_for_actuators(10.5, start).tolist() == [0.5, 0.0, 0.0, 3.0, 0.0, 0.0]
    assert (buffer.take_expired_actuators(), buffer.take_expired_actuators()) == (["a", "cylinder"], [])
    assert buffer.due_for_actuators(10.9, start).tolist() == [0.5, 0.0, 0.0, 0.0, 0.0, 0.0]
    assert (buffer.take_expired_actuators(), buffer.expired) == (["b"], 2)
    assert buffer.due_for_actuators(99.0, start) is None
    buffer.by_name(["cylinder"], [7.0])
    assert buffer.due_for_actuators(99.1, start)[5] == 7.0


def test_commands_of_actuators_that_are_not_watched_are_held(simulation, buffer):
    buffer.by_name(["cylinder"], [7.0])
    start = simulation.inputs[simulation.command_map.range]
    assert buffer.due_for_actuators(0.0, start)[5] == 7.0
    assert buffer.due_for_actuators(1e9, start) is None


@pytest.fixture
def rover():
    simulation = Simulation.from_file("rover")
    return simulation, CommandBuffer(simulation.effort_map, 0.5, simulation.command_map)


def test_a_velocity_of_a_base_commands_its_wheels_and_expires(rover):
    simulation, buffer = rover
    base, current = simulation.mechanism.bases[0], np.zeros(2)
    buffer.move(base, (0.5, 0.0, 0.0), (0.0, 0.0, 0.8))
    assert buffer.due_for_actuators(0.0, current) == pytest.approx([4.45, 8.05])
    assert buffer.due_for_actuators(0.49, current) is None
    assert buffer.due_for_actuators(0.5, current).tolist() == [0.0, 0.0]
    assert buffer.take_expired_actuators() == ["left_motor", "right_motor"] and buffer.expired == 1


def test_a_command_of_a_wheel_ends_the_watch_over_its_base(rover):
    simulation, buffer = rover
    buffer.move(simulation.mechanism.bases[0], (0.5, 0.0, 0.0), (0.0, 0.0, 0.0))
    buffer.due_for_actuators(0.0, np.zeros(2))
    buffer.by_name(["left_axle"], [], velocities=[1.0])
    assert buffer.due_for_actuators(0.1, np.zeros(2)) == pytest.approx([1.0, 6.25])
    assert buffer.due_for_actuators(5.0, np.zeros(2)) == pytest.approx([1.0, 0.0])


def test_a_velocity_that_a_base_cannot_have_is_rejected_and_changes_nothing(rover):
    simulation, buffer = rover
    for linear, angular in (((0.1, 0.2, 0.0), (0.0, 0.0, 0.0)), ((math.inf, 0.0, 0.0), (0.0, 0.0, 0.0))):
        with pytest.raises(CommandError):
            buffer.move(simulation.mechanism.bases[0], linear, angular)
    assert (buffer.accepted, buffer.rejected) == (0, 2) and buffer.due_for_actuators(0.0, np.zeros(2)) is None


LIMITED = MIXED.replace(
    "axis: [0, -1, 0]}\n  knee", "axis: [0, -1, 0], limits: {lower: -0.5, upper: 1}, velocity_limit: 2}\n  knee"
)


@pytest.fixture
def limited():
    simulation = Simulation.from_text(LIMITED)
    ranges = CommandRanges(simulation.mechanism)
    return simulation, CommandBuffer(simulation.effort_map, 0.5, simulation.command_map, 1e-3, ranges)


@pytest.mark.parametrize(
    ("position", "velocity", "expected", "excess"),
    [
        (0.9, -1.9, (0.9, -1.9), ""),
        (1.2, 0.0, (1.0, 0.0), "the position 1.2 of 'a' is not within -0.5 to 1"),
        (-7.0, -3.0, (-0.5, -2.0), "the position -7 of 'a' is not within -0.5 to 1"),
        (0.0, 5.0, (0.0, 2.0), "the velocity 5 of 'a' is not within -2 to 2"),
    ],
)
def test_positions_and_velocities_beyond_the_limits_of_a_joint_are_clamped_counted_and_named(
    limited, position, velocity, expected, excess
):
    simulation, buffer = limited
    buffer.by_name(["hip"], [], positions=[position], velocities=[velocity])
    found = due(simulation, buffer)
    assert (found["a.position"], found["a.velocity"]) == expected
    count = bool(excess)
    assert (buffer.limited, buffer.accepted, buffer.take_excess()) == (count, 1, excess)
    assert buffer.due_for_actuators(0.1, np.zeros(6)) is None and buffer.limited == count


def test_commands_keep_limits_that_have_changed(limited):
    simulation, buffer = limited
    buffer.by_name(["hip"], [], positions=[0.9], velocities=[1.5])
    assert due(simulation, buffer)["a.position"] == 0.9
    changed = with_values(simulation.mechanism, {"joints.hip.limits.upper": 0.4, "joints.hip.velocity_limit": 1.0})
    buffer.keep_within(CommandRanges(changed), changed.bases)
    found = due(simulation, buffer)
    assert (found["a.position"], found["a.velocity"]) == (0.4, 1.0)


def test_a_base_whose_wheels_have_changed_commands_them_otherwise(rover):
    simulation, buffer = rover
    base, radius = simulation.mechanism.bases[0], value_of(simulation.mechanism, "bases.rover.radius")
    changed = with_values(simulation.mechanism, {"bases.rover.radius": 2.0 * radius})
    buffer.keep_within(CommandRanges(changed), changed.bases)
    buffer.move(base, (0.5, 0.0, 0.0), (0.0, 0.0, 0.8))
    assert buffer.due_for_actuators(0.0, np.zeros(2)) == pytest.approx([4.45 / 2, 8.05 / 2])


def test_a_trajectory_beyond_limits_is_rejected_and_one_that_overshoots_them_is_clamped(limited):
    simulation, buffer = limited
    current = simulation.inputs[simulation.command_map.range]
    for points, reason in (
        ([(10**9, [1.5])], "the position 1.5 of 'hip' at point 1 is beyond the limits of the joint, -0.5 to 1"),
        ([(10**9, [0.5], [3.0]), (2 * 10**9, [0.5], [0.0])], "the velocity 3 of 'hip' at point 1"),
    ):
        with pytest.raises(CommandError, match=reason):
            buffer.follow(Trajectory(["hip"], [TrajectoryPoint(*point) for point in points]), 0, 0)
    assert buffer.rejected == 2 and not buffer.due_for_actuators(0.0, current)
    points = [(10**9, [0.9], [1.9]), (2 * 10**9, [0.9], [0.0])]  # a cubic that exceeds 1 between them
    buffer.follow(Trajectory(["hip"], [TrajectoryPoint(*point) for point in points]), 0, 0)
    positions = []
    for step in range(2001):
        found = buffer.due_for_actuators(1e-3 * step, current)
        current = current if found is None else found
        positions.append(current[0])
    assert max(positions) == 1.0 and positions[-1] == pytest.approx(0.9) and buffer.limited == 1
