"""The action `~/follow_joint_trajectory` of control_msgs, if that package is installed."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import ModuleType
from typing import Any, assert_never

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from trajectory_msgs.msg import JointTrajectoryPoint

from mbd_sim.base.errors import CommandError, listed, nearest
from mbd_sim.ros.commands.command_buffer import Followed
from mbd_sim.ros.commands.trajectory_player import Outcome, Setpoint, Tolerance, TrajectoryGoal
from mbd_sim.ros.node.subscriptions import nanoseconds, trajectory_of
from mbd_sim.ros.standard.messages import installs
from mbd_sim.ros.stepping.thread import SteppingThread
from mbd_sim.simulation.run.run_point import joint_state_arrays, joint_state_names

ACTION = "~/follow_joint_trajectory"
PERIOD = 0.02  # s of real time between two looks at the goals


def serve_trajectory_action(
    node: Node, stepping_thread: SteppingThread, reject: Callable[[str, CommandError], None]
) -> TrajectoryAction | None:
    """Serve the action; None, which is logged, if control_msgs is not installed. `reject` reports refused goals."""
    try:
        actions = importlib.import_module("control_msgs.action")
    except ImportError:
        node.get_logger().warning(f"{ACTION} is not served: control_msgs is not installed. {installs('control_msgs')}")
        return None
    return TrajectoryAction(node, stepping_thread, reject, actions)


@dataclass(eq=False)
class _Active:
    """A goal under way: its handle, and what it demands."""

    handle: Any
    goal: TrajectoryGoal
    followed: Followed


@dataclass(frozen=True)
class _Progress:
    """How far a goal is, between two steps: the time in s from its start, and motions of its joints.

    `is_followed` is false once another command has ended the trajectory, and after its end.
    """

    elapsed: float
    is_followed: bool
    desired: Mapping[str, Setpoint]
    actual: Mapping[str, Setpoint]

    def deviations(self) -> dict[str, Setpoint]:
        """How far the joints are off the desired motions."""
        pairs = {name: (self.actual[name], wanted) for name, wanted in self.desired.items()}
        return {name: Setpoint(a.position - w.position, a.velocity - w.velocity) for name, (a, w) in pairs.items()}


@dataclass(frozen=True)
class _Ending:
    """How a goal ends: what changes the state of its handle, and its result."""

    change_state: Callable[[], None]
    code: str
    text: str


class _Server(ActionServer):  # type: ignore[misc]  # rclpy carries no types
    """Runs no callback for a goal before it has ended.

    A callback that awaits the end would be resumed over and over, which takes a whole processor.
    """

    def notify_execute(self, goal_handle: Any, execute_callback: Any) -> None:
        """A goal is executed from now on."""

    def send_result(self, handle: Any, result: Any) -> None:
        """Send the result of a goal that has ended."""
        super().notify_execute(handle, lambda _: result)


class TrajectoryAction:
    """Follows the trajectories of goals, with feedback, and ends them by their tolerances."""

    def __init__(
        self,
        node: Node,
        stepping_thread: SteppingThread,
        reject: Callable[[str, CommandError], None],
        actions: ModuleType,
    ) -> None:
        self._kind = actions.FollowJointTrajectory
        self._stepping_thread, self._reject = stepping_thread, reject
        self._commands, self._simulation = stepping_thread.run.commands, stepping_thread.simulation
        self._active: list[_Active] = []
        self._server = _Server(
            node,
            self._kind,
            ACTION,
            execute_callback=self._result,  # is not called: see `_Server`
            goal_callback=self._on_goal,
            handle_accepted_callback=self._on_accepted,
            cancel_callback=lambda handle: CancelResponse.ACCEPT,
        )
        node.create_timer(PERIOD, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _on_goal(self, request: Any) -> GoalResponse:
        try:
            now = self._stepping_thread.clock.ns
            curves = self._commands.checked(trajectory_of(request.trajectory), now)
            try:
                _require_joints(request, list(curves))
            except CommandError:
                self._commands.rejected += 1
                raise
        except CommandError as error:
            self._reject(ACTION, error)
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _on_accepted(self, handle: Any) -> None:
        trajectory, clock = trajectory_of(handle.request.trajectory), self._stepping_thread.clock
        followed: list[Followed] = []

        def follow() -> str:
            try:
                followed.append(self._commands.follow(trajectory, clock.ns, clock.zero_ns))
            except CommandError as error:
                return str(error)
            return ""

        problem = self._stepping_thread.between_steps(follow)
        handle.execute()
        if problem:
            self._end(handle, _Ending(handle.abort, "INVALID_GOAL", problem))
            return
        request, duration = handle.request, trajectory.points[-1].time
        late = 1e-9 * nanoseconds(request.goal_time_tolerance)
        goal = TrajectoryGoal(
            duration, _tolerances(request.path_tolerance), _tolerances(request.goal_tolerance), late or math.inf
        )
        self._active.append(_Active(handle, goal, followed[0]))

    def _look(self) -> None:
        """Send feedback, and end the goals that have succeeded, failed, or been canceled."""
        if not self._active:
            return
        progress: dict[_Active, _Progress] = {}

        def read() -> str:
            progress.update(self._progress())
            return ""

        if self._stepping_thread.between_steps(read):
            return
        for active, found in progress.items():
            if (ending := self._ending(active, found)) is not None:
                self._active.remove(active)
                self._end(active.handle, ending)
        for active in self._active:
            self._publish_feedback(active, progress[active])

    def _progress(self) -> Iterator[tuple[_Active, _Progress]]:
        """How far each goal is; for the stepping thread, in which a trajectory cannot end meanwhile."""
        simulation, clock = self._simulation, self._stepping_thread.clock
        y, inputs, now = simulation.state, simulation.inputs, clock.ns - clock.zero_ns
        position, velocity, _ = joint_state_arrays(simulation.model, simulation.time, y, inputs)
        actual = {
            name: Setpoint(*map(float, motion))
            for name, *motion in zip(joint_state_names(simulation.model), position, velocity, strict=True)
        }
        for active in self._active:
            followed, desired = active.followed, self._commands.desired(active.followed, now)
            yield active, _Progress(followed.elapsed(now), self._commands.follows(followed), desired, actual)

    def _ending(self, active: _Active, progress: _Progress) -> _Ending | None:
        """How a goal ends; None if it goes on. Joints that it leaves are held."""
        handle, elapsed = active.handle, progress.elapsed
        if handle.is_cancel_requested:
            self._commands.stop(active.followed)
            return _Ending(handle.canceled, "SUCCESSFUL", "canceled; the joints are held where they were sent")
        if elapsed < active.goal.duration and not progress.is_followed:
            return _Ending(handle.abort, "INVALID_GOAL", "ended by another command, another goal or a reset")
        if elapsed < 0.0 or (verdict := active.goal.verdict(elapsed, progress.deviations())) is None:
            return None
        match verdict.outcome:
            case Outcome.SUCCEEDED:
                return _Ending(handle.succeed, "SUCCESSFUL", verdict.text)
            case Outcome.LEFT_PATH:
                self._commands.stop(active.followed)
                return _Ending(handle.abort, "PATH_TOLERANCE_VIOLATED", verdict.text)
            case Outcome.MISSED_GOAL:
                return _Ending(handle.abort, "GOAL_TOLERANCE_VIOLATED", verdict.text)
            case _:
                assert_never(verdict.outcome)

    def _end(self, handle: Any, ending: _Ending) -> None:
        """End a goal. Whoever waits for its result gets it even if the change of its state could not be published."""
        try:
            ending.change_state()
        finally:
            self._server.send_result(handle, self._result(ending.code, ending.text))

    def _publish_feedback(self, active: _Active, progress: _Progress) -> None:
        desired, actual, deviations = progress.desired, progress.actual, progress.deviations()
        feedback = self._kind.Feedback(joint_names=list(desired))
        now = self._stepping_thread.clock.ns
        feedback.header.stamp.sec, feedback.header.stamp.nanosec = divmod(now, 1_000_000_000)
        for key, motions in (("desired", desired), ("actual", actual), ("error", deviations)):
            chosen = [motions[name] for name in desired]
            point = JointTrajectoryPoint(
                positions=[motion.position for motion in chosen], velocities=[motion.velocity for motion in chosen]
            )
            elapsed_ns = max(0, round(1e9 * progress.elapsed))
            point.time_from_start.sec, point.time_from_start.nanosec = divmod(elapsed_ns, 1_000_000_000)
            setattr(feedback, key, point)
        active.handle.publish_feedback(feedback)

    def _result(self, code: str, text: str) -> Any:
        return self._kind.Result(error_code=getattr(self._kind.Result, code), error_string=text)


def _tolerances(messages: Any) -> dict[str, Tolerance]:
    """The tolerances of joints; 0 and -1 stand for none."""
    return {
        message.name: Tolerance(*(value if value > 0.0 else math.inf for value in (message.position, message.velocity)))
        for message in messages
    }


def _require_joints(request: Any, joints: list[str]) -> None:
    """Refuse goals with tolerances or motions that cannot be followed.

    :raises CommandError: it names them.
    """
    if request.multi_dof_trajectory.points or request.multi_dof_trajectory.joint_names:
        raise CommandError("it has a trajectory of joints with several degrees of freedom", "Leave it empty.")
    if request.component_path_tolerance or request.component_goal_tolerance:
        raise CommandError("it has tolerances of components, which no joint here has", "Leave them empty.")
    for message in (*request.path_tolerance, *request.goal_tolerance):
        if message.name not in joints:
            remedy = nearest(message.name, joints)
            raise CommandError(f"its tolerance names '{message.name}', which it does not move", remedy)
        numbers = (message.position, message.velocity, message.acceleration)
        if not all(map(math.isfinite, numbers)):
            raise CommandError(f"a tolerance of '{message.name}' is not finite", "Give -1 for any deviation.")
        if message.acceleration > 0.0:
            raise CommandError(f"accelerations are not watched, as for {listed([message.name])}", "Leave them at zero.")
