"""How goals end: by their tolerances, on the way, at the end, and after it."""

import math
from dataclasses import astuple

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.errors import CommandError
from mbd_sim.ros.commands.command_buffer import CommandBuffer
from mbd_sim.ros.commands.trajectory_player import (
    JointCurve,
    JointPoint,
    Outcome,
    Setpoint,
    Tolerance,
    Trajectory,
    TrajectoryGoal,
    TrajectoryPoint,
    between,
)
from test.ros.commands.test_joint_commands import MIXED

GOAL = TrajectoryGoal(2.0, {"hip": Tolerance(0.1, 0.5)}, {"hip": Tolerance(0.01)}, 0.3)


@pytest.mark.parametrize(
    ("elapsed", "position", "velocity", "outcome"),
    [
        (1.0, 0.09, 0.4, None),
        (1.0, -0.11, 0.0, Outcome.LEFT_PATH),
        (1.0, 0.0, 0.6, Outcome.LEFT_PATH),
        (2.0, 0.005, 9.0, Outcome.SUCCEEDED),  # the velocity is not among the tolerances of the end
        (2.2, 0.02, 0.0, None),
        (2.4, 0.02, 0.0, Outcome.MISSED_GOAL),
        (2.4, -0.005, 0.0, Outcome.SUCCEEDED),
    ],
)
def test_a_goal_ends_by_its_tolerances(elapsed, position, velocity, outcome):
    verdict = GOAL.verdict(elapsed, {"hip": Setpoint(position, velocity)})
    assert (None if verdict is None else verdict.outcome) is outcome


def test_the_verdict_says_how_far_which_joint_is_off():
    verdict = GOAL.verdict(1.0, {"hip": Setpoint(0.2)})
    assert verdict.text == "the position of 'hip' is 0.2 off, more than 0.1, at 1.000 s"


SECOND = 1_000_000_000


@pytest.fixture(scope="module")
def simulation():
    return Simulation.from_text(MIXED)  # hip has the actuator a, which takes a position, a velocity and an effort


class Played:
    """A buffer whose commands of the actuator a are those in effect."""

    def __init__(self, simulation):
        self.buffer = CommandBuffer(simulation.effort_map, 0.5, simulation.command_map, 1e-3)
        self.current = np.zeros(len(simulation.command_map.names))

    def follow(self, *points, start=0, now=0, zero=0, joints=("hip",)):
        self.buffer.follow(Trajectory(joints, [TrajectoryPoint(*point) for point in points], start), now, zero)

    def at(self, time):
        """The position and velocity that are commanded at a time in s, and whether they are new."""
        values = self.buffer.due_for_actuators(time, self.current)
        if values is not None:
            self.current = values
        return (*self.current[:2].tolist(), values is not None)


@pytest.fixture
def played(simulation):
    return Played(simulation)


@pytest.mark.parametrize(
    ("first", "second", "degree"),
    [
        (JointPoint(1.0, 0.3), JointPoint(3.0, -0.5, 0.7, 0.1), 1),
        (JointPoint(1.0, 0.3, 0.2), JointPoint(3.0, -0.5, 0.7, 0.1), 3),
        (JointPoint(1.0, 0.3, 0.2, -0.4), JointPoint(3.0, -0.5, 0.7, 0.1), 5),
    ],
)
def test_between_two_points_is_the_polynomial_of_what_both_give(first, second, degree):
    conditions = [(p, k) for p in (first, second) for k in range((degree + 1) // 2)]
    rows = [[math.perm(n, k) * p.time ** (n - k) if n >= k else 0.0 for n in range(degree + 1)] for p, k in conditions]
    polynomial = np.polynomial.Polynomial(np.linalg.solve(rows, [astuple(p)[1 + k] for p, k in conditions]))
    for time in np.linspace(1.0, 3.0, 9):
        expected = [polynomial(time), polynomial.deriv(1)(time), polynomial.deriv(2)(time)]
        assert between(first, second, time) == pytest.approx(expected, abs=1e-11)


def test_a_curve_holds_its_end_and_begins_anywhere():
    curve = JointCurve([JointPoint(1.0, 2.0, 0.0), JointPoint(2.0, 3.0, 0.0)])
    assert curve.at(2.0) == curve.at(9.0) == Setpoint(3.0)
    begun = curve.begun(0.0, Setpoint(1.0, 0.5))
    assert begun.at(0.0) == Setpoint(1.0, 0.5, begun.at(0.0).acceleration)
    assert begun.at(1.5) == curve.at(1.5)
    assert curve.begun(1.5, Setpoint(9.0)).at(1.5) == curve.at(1.5)


def test_a_trajectory_starts_at_once_ends_and_is_held(played):
    played.current[0] = 0.2
    played.follow((1 * SECOND, [1.2]))
    assert played.buffer.steps_to_sample(0, 1000) == 1
    assert played.at(2.0) == pytest.approx((0.2, 1.0, True))
    assert played.at(2.25) == pytest.approx((0.45, 1.0, True))
    assert played.at(3.0) == (1.2, 0.0, True)
    assert played.at(3.001) == (1.2, 0.0, False)
    assert played.buffer.steps_to_sample(0, 1000) == 1000


def test_a_stamp_in_the_future_waits_and_the_motion_before_goes_on(played):
    played.follow((0, [0.0], [0.0]), (2 * SECOND, [2.0], [0.0]))
    played.at(0.0)
    played.follow((1 * SECOND, [5.0], [0.0]), start=11 * SECOND, now=int(10.5 * SECOND), zero=10 * SECOND)
    half = played.at(0.999)
    assert half[0] == pytest.approx(1.0, abs=2e-3)
    assert played.at(1.0)[:2] == pytest.approx((1.0, 1.5), abs=1e-12)  # begins with the velocity of the one before
    assert played.at(1.001)[1] == pytest.approx(1.5, abs=0.03)
    assert played.at(2.0) == (5.0, 0.0, True)


def test_a_stamp_in_the_past_joins_the_motion_where_it_would_be(played):
    played.follow((0, [0.0]), (4 * SECOND, [4.0]), start=10 * SECOND, now=11 * SECOND, zero=10 * SECOND)
    assert played.at(1.0)[:2] == (1.0, 1.0)


def test_samples_are_due_at_the_rate_asked_for(played):
    played.buffer.sample_trajectories(100.0)
    played.follow((1 * SECOND, [1.0]))
    assert played.at(0.003) == (0.0, 1.0, True)  # the start is not delayed
    assert played.at(0.004)[2] is False
    assert played.buffer.steps_to_sample(4, 1000) == 6
    assert played.at(0.010) == pytest.approx((0.007, 1.0, True))


@pytest.mark.parametrize("ends", ["command", "order", "reset"])
def test_a_command_or_a_reset_ends_a_trajectory_and_its_velocity(played, ends):
    played.follow((1 * SECOND, [1.0]))
    played.at(0.0)
    played.at(0.5)
    if ends == "command":
        played.buffer.by_name(["hip"], [], positions=[0.7])
        assert played.at(0.6) == (0.7, 0.0, True)
    elif ends == "order":
        played.buffer.actuators_by_order([0.7, 0.1, 0.0, 0.0, 0.0, 0.0])
        assert played.at(0.6) == (0.7, 0.1, True)
    else:
        played.buffer.clear()
    assert played.at(0.7)[2] is False


def test_a_trajectory_does_not_expire(played):
    played.buffer.watch_actuators(0.1)
    played.buffer.by_name(["hip"], [], positions=[0.0], velocities=[0.5])
    played.follow((1 * SECOND, [1.0]))
    played.at(0.0)
    assert played.at(0.5) == pytest.approx((0.5, 1.0, True))
    assert played.buffer.take_expired_actuators() == []


def test_commands_of_other_actuators_leave_a_trajectory(played):
    played.follow((1 * SECOND, [1.0]))
    played.at(0.0)
    played.buffer.by_name(["knee"], [], velocities=[2.0])
    assert played.at(0.5)[0] == pytest.approx(0.5)
    assert played.current[3] == 2.0


def test_points_too_far_apart_for_numbers_give_no_infinite_commands(played):
    played.current[0] = -1e308
    played.follow((1, [1e308], [0.0], [0.0]), (2, [-1e308], [0.0], [0.0]))
    assert np.all(np.isfinite(played.at(0.0)[:2]))


@pytest.mark.parametrize(
    ("joints", "points", "start", "words"),
    [
        ((), [(0, [])], 0, "it names no joints"),
        (("hip", "hip"), [(0, [1.0, 2.0])], 0, "'hip' is named twice"),
        (("hip",), [], 0, "it has no points"),
        (("hop",), [(0, [1.0])], 0, "there is no joint 'hop'. Did you mean 'hip'?"),
        (("knee",), [(0, [1.0])], 0, "joint 'knee' takes no position, which a trajectory commands. Give it"),
        (("toe",), [(0, [1.0])], 0, "joint 'toe' takes no position"),
        (("hip",), [(0, [1.0]), (0, [2.0])], 0, "time_from_start of point 2 is 0 s. It must not be negative, and must"),
        (("hip",), [(-5, [1.0])], 0, "time_from_start of point 1 is -5e-09 s"),
        (("hip",), [(0, [1.0, 2.0])], 0, "'joint_names' and 'positions' of point 1 differ in length: 1 and 2."),
        (("hip",), [(0, [], [1.0])], 0, "'joint_names' and 'positions' of point 1 differ in length: 1 and 0."),
        (("hip",), [(0, [1.0], [1.0, 2.0])], 0, "'joint_names' and 'velocities' of point 1 differ in length: 1 and 2."),
        (("hip",), [(0, [1.0], [], [1.0])], 0, "point 1 has accelerations without velocities"),
        (("hip",), [(0, [1.0], [], [], [1.0])], 0, "point 1 has efforts, which a trajectory cannot have"),
        (("hip",), [(0, [math.nan])], 0, "the positions of hip at point 1 are not finite"),
        (("hip",), [(0, [1.0], [math.inf]), (5, [1.0])], 0, "the velocities of hip at point 1 are not finite"),
        (("hip",), [(0, [1.0], [0.5])], 0, "hip would move at the last point, but its position is held"),
        (("hip",), [(0, [1.0])], 9 * SECOND, "it ends at 9 s, before the present 10 s. Use simulated time"),
        (("hip",), [(0, [1.0])], 1_700_000_000 * SECOND, "more than a day after the present 10 s. Use simulated time"),
    ],
)
def test_a_bad_trajectory_is_refused_whole(played, joints, points, start, words):
    with pytest.raises(CommandError) as caught:
        played.follow(*points, joints=joints, start=start, now=10 * SECOND)
    assert words in str(caught.value)
    assert (played.buffer.accepted, played.buffer.rejected) == (0, 1)
    assert played.at(0.0)[2] is False
