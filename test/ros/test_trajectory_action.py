"""How the action ends goals, with handles in this process whose messages cannot always be published."""

import types

import pytest
from builtin_interfaces.msg import Duration, Time
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from mbd_sim import Simulation
from mbd_sim.ros import trajectory_action
from mbd_sim.ros.command_buffer import CommandBuffer
from mbd_sim.ros.rates import Rates
from mbd_sim.ros.stepping_thread import SteppingThread
from mbd_sim.ros.trajectory_action import TrajectoryAction

CODES = {
    "SUCCESSFUL": 0,
    "INVALID_GOAL": -1,
    "PATH_TOLERANCE_VIOLATED": -4,
    "GOAL_TOLERANCE_VIOLATED": -5,
}
SLIDER = """
mechanism: slider
parts: {table: {mass: 2}}
joints: {rail: {type: prismatic, between: [ground, table], axis: [0, 0, 1], drive: {command: position, bandwidth: 60}}}
"""


class Handle:
    """A goal of a client; messages of the server about it may fail as over DDS, after its state has changed."""

    is_cancel_requested = False

    def __init__(self, number, seconds, *, failing=""):
        point = JointTrajectoryPoint(positions=[0.5], velocities=[0.0], time_from_start=Duration(sec=seconds))
        self.request = types.SimpleNamespace(
            trajectory=JointTrajectory(header=Header(stamp=Time()), joint_names=["rail"], points=[point]),
            goal_time_tolerance=Duration(),
            path_tolerance=[],
            goal_tolerance=[],
        )
        self.goal_id = types.SimpleNamespace(uuid=bytes([number] * 16))
        self.failing, self.states, self.feedback = failing, [], 0

    def execute(self):
        self.states.append("executing")

    def abort(self):
        assert self.states == ["executing"]  # a goal ends once
        self.states.append("aborted")
        if self.failing == "abort":
            raise RuntimeError("failed to publish status")

    def canceled(self):
        self.states.append("canceled")

    def publish_feedback(self, message):
        if self.failing == "feedback":
            raise RuntimeError("failed to publish feedback")
        self.feedback += 1


@pytest.fixture
def action(monkeypatch):
    """The action of a paused simulation, whose goals are examined on request."""

    def message(**fields):
        return types.SimpleNamespace(header=Header(), **fields)

    simulation = Simulation.from_text(SLIDER)
    commands = CommandBuffer(simulation.effort_map, 0.0, simulation.command_map, simulation.step_size)
    thread = SteppingThread(simulation, commands, Rates(), paused=True)
    thread.start()
    monkeypatch.setattr(trajectory_action, "ActionServer", lambda *given, **named: None)
    node = types.SimpleNamespace(create_timer=lambda *given, **named: None)
    result = type("Result", (types.SimpleNamespace,), CODES)
    kind = types.SimpleNamespace(Feedback=message, Result=result)
    yield TrajectoryAction(node, thread, None, types.SimpleNamespace(FollowJointTrajectory=kind))
    thread.stop()


@pytest.mark.parametrize("failing", ["", "abort"])
def test_the_result_of_a_replaced_goal_is_there_even_if_its_state_could_not_be_published(action, failing):
    first, second = Handle(1, 60, failing=failing), Handle(2, 60)
    action._on_accepted(first)
    result = action._results[first.goal_id.uuid]
    action._on_accepted(second)
    for _ in range(3):
        try:
            action._look()
        except RuntimeError:
            assert failing and not second.feedback
    assert first.states == ["executing", "aborted"] and second.states == ["executing"]
    assert result.done() and result.result().error_code == CODES["INVALID_GOAL"]
    assert second.feedback == (2 if failing else 3)  # the next one is not held up


def test_goals_end_once_even_if_feedback_cannot_be_published(action):
    first, second = Handle(1, 60), Handle(2, 60, failing="feedback")
    action._on_accepted(first)
    action._on_accepted(second)
    with pytest.raises(RuntimeError, match="feedback"):
        action._look()
    assert first.states == ["executing", "aborted"]
    second.is_cancel_requested = True
    action._look()
    assert second.states == ["executing", "canceled"]
    assert action._results[second.goal_id.uuid].result().error_code == CODES["SUCCESSFUL"]
