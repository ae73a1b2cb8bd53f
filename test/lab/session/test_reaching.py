"""Inverse kinematics in a session: the mechanism is where the target is, at rest, and commands hold it there."""

import numpy as np
import pytest

from mbd_sim import load_mechanism, parse_mechanism
from mbd_sim.base.geometry.pose import Pose
from mbd_sim.base.geometry.rotation import from_rpy
from mbd_sim.lab.session.bench import Bench
from mbd_sim.lab.session.own_session import OwnSession
from mbd_sim.lab.session.reaching import Goal, Reacher, pose_of, position_commands
from test.waiting import wait_until

ROBOT = """
mechanism: robot
parts:
  slide: {mass: 1, inertia: [1, 1, 1]}
  arm: {mass: 1, inertia: [1, 1, 1], points: {tip: {at: [0.5, 0, 0], rotate: {rpy: [0, 0, 30 deg]}}}}
joints:
  rail: {type: prismatic, between: [ground, slide], axis: [1, 0, 0], drive: {command: position, bandwidth: 8 rad/s, lower: -1, upper: 1}}
  pivot: {type: revolute, between: [slide, arm], axis: [0, 0, 1], position: 20 deg}
actuators:
  motor: {type: effort, joint: pivot, servo: {controls: position, kp: 40, kd: 4}}
"""


@pytest.fixture
def reaching():
    """A session that turns by hand and the thread that looks for goals, by the name or the text of a mechanism."""
    made = []

    def make(mechanism):
        session = OwnSession(Bench.of(mechanism), clock=lambda: 0.0)  # it runs, but no time passes
        made.append(Reacher(session))
        return session, made[-1]

    yield make
    for one in made:
        one.stop()


def reach(session, reacher, goal, **options):
    """What was found for a goal, after the session has served it."""
    reacher.ask(goal, **options)
    wait_until(lambda: not reacher.searching, "the end of the search")
    session.turn()
    return reacher.found


def place(session, frame, at=(0.0, 0.0, 0.0)):
    simulation = session.bench.simulation
    return pose_of(simulation.mechanism, frame, np.array(at), simulation.poses())


def test_a_pose_of_a_held_point_is_reached_at_rest_at_the_same_time(reaching):
    session, reacher = reaching(load_mechanism("six_axis_arm"))
    simulation, at = session.bench.simulation, np.array([0.02, -0.01, 0.03])
    session.step(200)
    time, residual = simulation.time, simulation.energies.residual
    session.play()
    session.turn()
    now = place(session, "tool", at)
    target = Pose(now.position + np.array([0.05, 0.08, -0.06]), from_rpy(0.1, 0.3, -0.2) @ now.rotation)
    found = reach(session, reacher, Goal("tool", at, target.position, target.rotation))
    there = place(session, "tool", at)
    assert found.reached and not session.frame.running
    assert there.position == pytest.approx(target.position, abs=1e-8)
    assert there.rotation == pytest.approx(target.rotation, abs=1e-8)
    assert (simulation.time, np.abs(simulation.u).max()) == (time, 0.0)
    assert simulation.energies.residual == pytest.approx(residual, abs=1e-9)


def test_what_is_out_of_reach_is_approached_up_to_the_distance_that_is_told(reaching):
    session, reacher = reaching(load_mechanism("four_bar"))
    far = np.array([4.0, 0.0, 1.0])
    found = reach(session, reacher, Goal("coupler.P", np.zeros(3), far), near=True)
    left = np.linalg.norm(place(session, "coupler.P").position - far)
    assert not found.reached
    assert found.distance == pytest.approx(left, rel=1e-9)
    assert session.bench.simulation.violation.position < 1e-9


def test_drives_and_servos_are_put_and_commanded(reaching):
    session, reacher = reaching(parse_mechanism(ROBOT))
    simulation = session.bench.simulation
    goal = Goal("arm.tip", np.zeros(3), np.array([0.4, 0.45, 0.0]))
    before = simulation.state
    found = reach(session, reacher, goal, command=True)
    commands = position_commands(simulation.mechanism, found.positions)
    assert set(commands) == {"rail.position", "motor.position"}
    assert {name: session.bench.values()[name] for name in commands} == commands
    assert session.frame.running and np.allclose(before, simulation.state, atol=0.1)  # nothing was put anywhere
    assert reacher.commanded
    reach(session, reacher, goal)
    assert not reacher.commanded
    assert place(session, "arm.tip").position == pytest.approx(goal.position, abs=1e-8)
    session.step(500)  # the commands hold it there
    assert place(session, "arm.tip").position == pytest.approx(goal.position, abs=1e-6)


def test_a_mechanism_is_not_put_into_its_floor(reaching):
    session, reacher = reaching(load_mechanism("bounce"))
    before = session.bench.simulation.state
    (part,) = session.bench.simulation.model.part_names
    reach(session, reacher, Goal(part, np.zeros(3), np.array([0.0, 0.0, -2.0])))
    assert "beyond the bound" in session.frame.message and reacher.refused == session.frame.message
    assert np.array_equal(session.bench.simulation.state, before)
    reach(session, reacher, Goal(part, np.zeros(3), np.array([0.0, 0.0, 2.0])))
    assert not reacher.refused and place(session, part).position[2] == pytest.approx(2.0)


def test_a_newer_goal_ends_the_search_for_the_last(reaching):
    session, reacher = reaching(load_mechanism("four_bar"))
    near = Goal("coupler", np.zeros(3), place(session, "coupler").position)
    reacher.ask(Goal("coupler.P", np.zeros(3), np.array([9.0, 0.0, 9.0])))  # with seconds of other starts
    wait_until(lambda: reacher.found is not None, "the first configuration")
    assert reach(session, reacher, near).reached
