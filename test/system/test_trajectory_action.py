"""The action FollowJointTrajectory: goals, refusals, feedback, tolerances and cancellation, from another participant."""

from __future__ import annotations

import collections
import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from builtin_interfaces.msg import Duration
from rclpy.action import ActionClient
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.task import Task
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from mbd_sim import Simulation
from mbd_sim.ros.commands.command_buffer import CommandBuffer
from mbd_sim.ros.node.trajectory_action import TrajectoryAction
from mbd_sim.ros.stepping.clock import Rates
from mbd_sim.ros.stepping.thread import SteppingThread
from test.system.nodes import Listener, SimNodeProcess, new_domain, running
from test.system.test_optional_interfaces import packages, variables  # noqa: F401

LIFT = """
mechanism: lift
parts: {table: {mass: 2}, arm: {mass: 1, inertia: [0.1, 0.1, 0.1]}}
joints:
  rail: {type: prismatic, between: [ground, table], axis: [0, 0, 1], drive: {command: position, bandwidth: 60}}
  hinge: {type: revolute, between: [table, arm], axis: [0, 0, 1], limits: {lower: -1, upper: 1}}
actuators:
  motor: {type: effort, joint: hinge, effort_limit: 0.5, servo: {controls: position, kp: 40, kd: 4}}
"""
SUCCEEDED, CANCELED, ABORTED = 4, 5, 6  # of action_msgs/GoalStatus


def goal(kind: Any, *points: tuple[float, list[float]], joints: tuple[str, ...] = ("rail",), **fields: Any) -> Any:
    trajectory = JointTrajectory(joint_names=list(joints))
    for time, positions in points:
        stamp = Duration(sec=int(time), nanosec=round(1e9 * (time % 1.0)))
        still = [0.0] * len(positions)
        trajectory.points.append(JointTrajectoryPoint(positions=positions, velocities=still, time_from_start=stamp))
    return kind.Goal(trajectory=trajectory, **fields)


class Client:
    """Sends goals to the node, and keeps the feedback."""

    def __init__(self, listener: Listener) -> None:
        from control_msgs.action import FollowJointTrajectory

        self.kind, self.listener, self.feedback = FollowJointTrajectory, listener, list[Any]()
        self._client = ActionClient(listener.node, FollowJointTrajectory, "sim_node/follow_joint_trajectory")
        listener.until(self._client.server_is_ready, "the action")

    def send(self, *points: tuple[float, list[float]], **fields: Any) -> Any:
        self.feedback.clear()
        request = goal(self.kind, *points, **fields)
        return self.wait(
            self._client.send_goal_async(request, feedback_callback=lambda m: self.feedback.append(m.feedback))
        )

    def result(self, handle: Any) -> tuple[int, Any]:
        answer = self.wait(handle.get_result_async())
        return answer.status, answer.result

    def wait(self, future: Any) -> Any:
        self.listener.until(future.done, "the answer")
        return future.result()


@contextlib.contextmanager
def serving(folder: Path, variables: dict[str, str]) -> Iterator[tuple[SimNodeProcess, Client]]:  # noqa: F811
    (folder / "lift.yaml").write_text(LIFT, encoding="utf-8")
    options = {"mechanism": str(folder / "lift.yaml"), "follow_joint_trajectory": True, "real_time_factor": 2.0}
    with running(folder, variables=variables, **options) as (process, listener):
        yield process, Client(listener)


def test_goals_succeed_fail_are_refused_replaced_and_canceled(tmp_path: Path, variables: dict[str, str]) -> None:  # noqa: F811
    with serving(tmp_path, variables) as (process, client):
        from control_msgs.msg import JointTolerance

        result, listener = client.kind.Result, client.listener
        handle = client.send((1.0, [0.5]), goal_tolerance=[JointTolerance(name="rail", position=1e-3)])
        assert handle.accepted
        status, answer = client.result(handle)
        assert (status, answer.error_code) == (SUCCEEDED, result.SUCCESSFUL)
        listener.until(lambda: abs(listener.states[-1].position[1] - 0.5) < 1e-3, "the state")
        for points, joints in (([(1.0, [2.0])], "hinge"), ([(1.0, [0.5])], "rial"), ([], "rail")):
            assert not client.send(*points, joints=(joints,)).accepted
        listener.until(lambda: "beyond the limits of the joint" in process.text, "the reason of the first refusal")
        wrong = [JointTolerance(name="hinge", position=1.0)]
        assert not client.send((1.0, [0.5]), path_tolerance=wrong).accepted
        # The weak motor of the hinge cannot follow.
        tight = [JointTolerance(name="hinge", position=0.05)]
        handle = client.send((0.2, [1.0]), (3.0, [1.0]), joints=("hinge",), path_tolerance=tight)
        status, answer = client.result(handle)
        assert (status, answer.error_code) == (ABORTED, result.PATH_TOLERANCE_VIOLATED)
        assert "the position of 'hinge' is" in answer.error_string
        first = client.send((60.0, [0.0]))
        second = client.send((60.0, [0.1]))
        assert first.accepted and second.accepted
        assert client.result(first)[0] == ABORTED
        listener.until(lambda: listener.states[-1].position[1] < 0.4995, "the motion of the second goal")
        listener.until(lambda: client.feedback and client.feedback[-1].actual.positions[0] < 0.4995, "its feedback")
        for seen in client.feedback:
            assert seen.joint_names == ["rail"] and 0.1 <= seen.desired.positions[0] <= 0.5 + 1e-9
            assert seen.error.positions[0] == pytest.approx(seen.actual.positions[0] - seen.desired.positions[0])
        client.wait(second.cancel_goal_async())
        assert client.result(second)[0] == CANCELED
        listener.until(lambda: abs(listener.states[-1].velocity[1]) < 1e-9, "the rest")
        assert 0.1 < listener.states[-1].position[1] < 0.4995


class SteppingOn(SteppingThread):
    """A thread that has taken a hundred steps more when the answer of an action arrives."""

    def between_steps(self, action: Callable[[], str]) -> str:
        def act_and_step() -> str:
            answer = action()
            for _ in range(100):
                self.run.advance(1)
            return answer

        return super().between_steps(act_and_step)


@contextlib.contextmanager
def served_here(kind: type[SteppingThread]) -> Iterator[Client]:
    """Serve the action in this process, paused."""
    from control_msgs import action as actions

    simulation = Simulation.from_text(LIFT)
    commands = CommandBuffer(simulation.effort_map, 0.0, simulation.command_map, simulation.step_size)
    thread = kind(simulation, commands, Rates(), paused=True)
    with contextlib.closing(Listener(new_domain())) as listener:
        node = Node("sim_node", context=listener.context)
        TrajectoryAction(node, thread, lambda *given: pytest.fail(str(given)), actions)
        listener.executor.add_node(node)
        thread.start()
        yield Client(listener)
        thread.stop()
        node.destroy_node()


@pytest.mark.usefixtures("variables")
def test_goals_succeed_if_they_end_before_an_answer_about_them_arrives() -> None:
    with served_here(SteppingOn) as client:
        for end in (0.5, 0.1):
            status, answer = client.result(client.send((0.25, [end])))
            assert (status, answer.error_string) == (SUCCEEDED, "")
            assert client.feedback


@pytest.mark.usefixtures("variables")
def test_a_goal_under_way_is_not_looked_at_without_a_pause(monkeypatch: pytest.MonkeyPatch) -> None:
    """A coroutine that awaits its end is resumed in each turn of the executor, which then never waits."""
    calls: list[Task] = []
    work = Task.__call__

    def counted(task: Task) -> None:
        calls.append(task)
        work(task)

    with served_here(SteppingThread) as client:
        assert client.send((60.0, [0.0])).accepted
        client.listener.until(lambda: client.feedback, "feedback")
        monkeypatch.setattr(Task, "__call__", counted)
        first = len(client.feedback)
        client.listener.until(lambda: len(client.feedback) >= first + 10, "more of it")
        assert max(collections.Counter(map(id, calls)).values()) <= 2


@pytest.mark.parametrize("failing", ["abort", "publish_feedback"])
def test_results_arrive_even_if_other_messages_about_a_goal_fail(
    failing: str,
    variables: dict[str, str],  # noqa: F811
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The server is in this process, paused; from the second goal on, one of rclpy's functions fails after its work."""
    failures: list[str] = []
    work = getattr(ServerGoalHandle, failing)

    def fail(handle: Any, *given: Any) -> None:
        work(handle, *given)
        failures.append(failing)
        raise RuntimeError(f"{failing} failed")

    with served_here(SteppingThread) as client:
        executor = client.listener.executor
        spin_once = executor.spin_once

        def spin(**given: Any) -> None:
            try:
                spin_once(**given)
            except RuntimeError as error:
                assert str(error) == f"{failing} failed"

        monkeypatch.setattr(client.listener, "executor", SimpleNamespace(spin_once=spin, shutdown=executor.shutdown))
        first = client.send((60.0, [0.0]))
        monkeypatch.setattr(ServerGoalHandle, failing, fail)
        second = client.send((60.0, [0.1]))
        status, answer = client.result(first)
        assert (status, answer.error_code) == (ABORTED, answer.INVALID_GOAL)
        client.wait(second.cancel_goal_async())
        status, answer = client.result(second)
        assert (status, answer.error_code) == (CANCELED, answer.SUCCESSFUL)
        assert failures and (failing == "publish_feedback" or len(failures) == 1)  # a goal ends once


def test_without_the_package_the_node_says_once_that_the_action_is_not_served(tmp_path: Path) -> None:
    pytest.importorskip("rclpy")
    with running(tmp_path, follow_joint_trajectory=True) as (process, listener):
        listener.until(
            lambda: "~/follow_joint_trajectory is not served: control_msgs is not installed" in process.text, "it"
        )
        listener.spin(0.3)
        assert process.text.count("~/follow_joint_trajectory is not served") == 1
