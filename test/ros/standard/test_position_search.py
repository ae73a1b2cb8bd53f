"""Searches for positions as the process beside a node does them: from seeds, in frames of parts, within their time."""

import random

import numpy as np
import pytest

from mbd_sim import Kinematics, load_mechanism
from mbd_sim.base.geometry.rotation import from_quaternion, from_rpy
from mbd_sim.dynamics.layouts.coordinate_names import with_positions
from mbd_sim.files.load import parse_mechanism
from mbd_sim.ros.standard.position_orders import PositionSearch
from mbd_sim.ros.standard.position_search import searched
from test.analysis.mechanics.test_inverse_kinematics import random_robot


def search(kinematics, frame, pose, **changes):
    whole = {"relative_to": None, "q": kinematics.start, "seed": {}, "time": 0.0, "limit": 60.0} | changes
    return PositionSearch(frame, pose.position, pose.rotation, **whole)


def asked(kinematics, *arguments, **changes):
    return searched(kinematics, search(kinematics, *arguments, **changes), lambda: 0.0)


@pytest.mark.parametrize("seed", range(6))
def test_random_robots_are_put_by_the_answer_where_the_target_was(seed):
    """Positions under wrong names, quaternions in another order, targets that do not turn with the part they refer to."""
    rng = random.Random(seed)
    text, last = random_robot(rng)
    robot = Kinematics(parse_mechanism(text))
    numbers = np.random.default_rng(seed)
    here, there = (
        robot.closed(robot.constraints.displaced(robot.start, scale * numbers.uniform(-1.0, 1.0, robot.layout.nv)))
        for scale in (0.4, 0.6)
    )
    seen, goal = robot.poses(here), robot.poses(there)[last]
    # The state of the run is the start; the seed says that the robot is elsewhere, where the first part is, too.
    relative = seen["p0"].inverse() @ goal
    answer = asked(robot, last, relative, relative_to="p0", seed=robot.positions(here))
    assert answer.outcome == "SUCCESS" and not answer.text
    put = robot.poses(with_positions(robot.mechanism, robot.layout, robot.start, answer.positions))[last]
    assert put.position == pytest.approx(goal.position, abs=1e-8)
    assert np.max(np.abs(put.rotation - goal.rotation)) < 1e-8
    turning = [name for name, joint in robot.mechanism.joints.items() if joint.kind.quaternion is not None]
    assert list(answer.joint_poses) == turning
    for name in turning:
        q = with_positions(robot.mechanism, robot.layout, robot.start, answer.positions)
        own = q[robot.layout.q[name]]
        assert answer.joint_poses[name][:3] == pytest.approx(np.zeros(3))
        expected, found = from_quaternion(own), from_quaternion(answer.joint_poses[name][3:])
        assert np.max(np.abs(expected - found)) < 1e-12


def test_the_seed_selects_the_configuration_and_closes_the_loops_with_what_it_names():
    linkage = Kinematics(load_mechanism("four_bar"))
    turned = linkage.closed(linkage.start + np.array([0.4, 0.0, 0.0]))
    goal = linkage.poses(turned)["coupler"]
    crank = linkage.mechanism.name and next(iter(linkage.positions()))
    begun = asked(linkage, "coupler", goal, seed={crank: turned[0]}, limit=-1.0)  # stops before the first step
    assert begun.outcome == "SUCCESS"  # it begins at the goal
    elsewhere = asked(linkage, "coupler", goal, limit=-1.0)
    assert elsewhere.outcome == "TIMED_OUT" and "within -1 s" in elsewhere.text
    assert elsewhere.positions == pytest.approx(linkage.positions(linkage.start))
    assert asked(linkage, "coupler", goal).positions == pytest.approx(linkage.positions(turned), abs=1e-8)


def test_what_is_out_of_reach_is_answered_with_the_nearest_positions():
    arm = Kinematics(load_mechanism("double_rod"))
    far = arm.poses(arm.start)["lower"]
    answer = asked(arm, "lower", type(far)(np.array([0.0, 0.0, -9.0]), from_rpy(0.0, 0.0, 0.0)))
    assert answer.outcome == "NO_IK_SOLUTION" and "8 m" in answer.text
    assert answer.positions == pytest.approx({"shoulder": 0.0, "elbow": 0.0}, abs=1e-6)


def test_a_state_that_closes_no_loops_is_an_error():
    linkage = Kinematics(load_mechanism("four_bar"))
    answer = asked(linkage, "coupler", linkage.poses()["coupler"], q=np.full(3, np.nan))
    assert answer.outcome == "INVALID_ROBOT_STATE" and answer.text and not answer.positions
