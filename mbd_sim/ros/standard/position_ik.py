"""The service `~/compute_ik` of moveit_msgs, if that package is installed: joint positions for a pose of a part.

The type and the name are those of MoveIt, so that its clients can ask a node. Nothing is moved. The search is done in a
process of its own, and other requests are answered meanwhile.
"""

from __future__ import annotations

import importlib
import pickle
import subprocess
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
from geometry_msgs.msg import Quaternion, Transform, Vector3
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.time import Time

from mbd_sim.base.geometry.pose import Array
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.ros.standard.late_service import LateService
from mbd_sim.ros.standard.messages import filled, installs
from mbd_sim.ros.standard.position_orders import PositionAnswer, PositionSearch
from mbd_sim.ros.standard.position_request import PresentPositions, RefusedError, RequestReader
from mbd_sim.ros.stepping.thread import SteppingThread
from mbd_sim.simulation.run.run_point import joint_state_arrays, joint_state_names

if TYPE_CHECKING:
    from mbd_sim.lab.session.link import SocketEnd

SERVICE = "~/compute_ik"
PROGRAM = "mbd_sim.ros.standard.position_search"  # a module
PERIOD = 0.005  # s between two looks for answers, while there are requests
GRACE = 30.0  # s that the process may take beyond the time of a search, as where it traces a large mechanism
MOST_WAITING = 20  # requests
CLOSE_TIMEOUT = 2.0  # s
SOURCE = "mbd_sim"


def serve_position_ik(
    node: Node, stepping_thread: SteppingThread, frame_prefix: str, position_only: Callable[[], bool]
) -> PositionIkService | None:
    """Serve it; None, which is logged, if moveit_msgs is not installed.

    :param position_only: whether requests leave the orientation free.
    """
    try:
        messages, services = (importlib.import_module(f"moveit_msgs.{kind}") for kind in ("msg", "srv"))
    except ImportError:
        node.get_logger().info(
            f"{SERVICE}, inverse kinematics, is not served: moveit_msgs is not installed. {installs('moveit_msgs')}"
        )
        return None
    return PositionIkService(node, stepping_thread, frame_prefix, position_only, messages, services)


@dataclass(frozen=True, eq=False)
class _Waiting:
    search: PositionSearch
    response: Any
    present: PresentPositions


class PositionIkService:
    """Checks requests, has them searched for one after another, and answers them."""

    def __init__(
        self,
        node: Node,
        stepping_thread: SteppingThread,
        frame_prefix: str,
        position_only: Callable[[], bool],
        messages: ModuleType,
        services: ModuleType,
    ) -> None:
        self._stepping_thread, self._prefix, self._position_only = stepping_thread, frame_prefix, position_only
        self._codes, self._log = messages.MoveItErrorCodes, node.get_logger()
        self._waiting = deque[_Waiting]()
        self._since = 0.0  # s, since when the first one is searched for
        self._known: Mechanism | None = None  # to the process
        self._process: subprocess.Popen[bytes] | None = None
        self._link: SocketEnd | None = None
        self._service = LateService(node, services.GetPositionIK, SERVICE, self._on_request)
        self._timer = node.create_timer(PERIOD, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._timer.cancel()

    def close(self) -> None:
        """End the process; requests that wait are not answered."""
        if self._link is not None:
            self._link.close()
        if self._process is not None:
            try:
                self._process.wait(CLOSE_TIMEOUT / 20.0)  # it ends by itself only between two searches
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        self._process = self._link = None

    def _on_request(self, request: Any, response: Any) -> Any:
        try:
            if len(self._waiting) >= MOST_WAITING:
                raise RefusedError("FAILURE", f"{MOST_WAITING} requests wait already", "Ask again later.")
            present = self._present()
            model, alone = self._stepping_thread.simulation.model, self._position_only()
            search = RequestReader(model, self._prefix, position_only=alone).search(request.ik_request, present)
            self._ask(search)
        except RefusedError as refusal:
            return self._failed(response, refusal.code, str(refusal))
        self._waiting.append(_Waiting(search, response, present))
        if len(self._waiting) == 1:
            self._since = time.monotonic()
            self._timer.reset()
        return None

    def _ask(self, search: PositionSearch) -> None:
        """Send a search to the process, which is started at the first one."""
        if self._process is None or self._process.poll() is not None:
            from mbd_sim.lab.session.link import start_linked

            (self._process, self._link), self._known = start_linked(PROGRAM), None
        assert self._link is not None
        mechanism = self._stepping_thread.simulation.live_mechanism
        try:
            if mechanism is not self._known:
                self._link.send(pickle.dumps(mechanism))
                self._known = mechanism
            self._link.send(pickle.dumps(search))
        except OSError as error:
            raise RefusedError("FAILURE", f"the process that searches has ended: {error}", "Ask again.") from error

    def _look(self) -> None:
        """Answer the requests whose searches have ended."""
        try:
            while self._waiting and self._link is not None and (message := self._link.receive()) is not None:
                self._finish(pickle.loads(message))  # noqa: S301  (from the process that this node has started)
        except OSError:
            self._abandon("the process that searches has ended. See the console, and ask again.")
        if self._waiting and time.monotonic() - self._since > self._waiting[0].search.limit + GRACE:
            self._abandon("the search did not end in its time, and was ended.")
        if not self._waiting:
            self._timer.cancel()

    def _finish(self, answer: PositionAnswer) -> None:
        waiting = self._waiting.popleft()
        self._since = time.monotonic()
        response = self._failed(waiting.response, answer.outcome, answer.text)
        if answer.positions:
            solution = response.solution
            stamp = Time(nanoseconds=waiting.present.stamp_ns).to_msg()
            positions = {**waiting.present.positions, **answer.positions}
            state, joints = solution.joint_state, solution.multi_dof_joint_state
            state.header.stamp = joints.header.stamp = stamp
            state.name = list(waiting.present.positions)
            state.position = [positions[name] for name in waiting.present.positions]
            joints.joint_names = list(answer.joint_poses)
            joints.transforms = [_transform(pose) for pose in answer.joint_poses.values()]
        self._service.send(response)

    def _abandon(self, reason: str) -> None:
        """Answer all requests that wait with a failure; the next one starts another process."""
        self._log.error(f"{SERVICE}: {reason}")
        if self._process is not None:
            self._process.kill()
        self.close()
        while self._waiting:
            self._service.send(self._failed(self._waiting.popleft().response, "FAILURE", reason))

    def _failed(self, response: Any, code: str, text: str) -> Any:
        error = response.error_code
        error.val = getattr(self._codes, code)
        if hasattr(error, "message"):
            error.message, error.source = text, SOURCE
        return response

    def _present(self) -> PresentPositions:
        read: list[PresentPositions] = []
        thread = self._stepping_thread

        def look() -> str:
            simulation, model = thread.simulation, thread.simulation.model
            time, y, inputs = simulation.time, simulation.state, simulation.inputs
            positions, _, _ = joint_state_arrays(model, time, y, inputs)
            named = dict(zip(joint_state_names(model), map(float, positions), strict=True))
            read.append(PresentPositions(thread.clock.ns, time, named, y[model.q_range].copy()))
            return ""

        if problem := thread.between_steps(look):
            raise RefusedError("FAILURE", problem, "")
        return read[0]


def _transform(pose: Array) -> Transform:
    """The message of a position and a quaternion (w, x, y, z), (7,)."""
    x, y, z, qw, qx, qy, qz = pose.tolist()
    return Transform(
        translation=filled(Vector3(), np.array([x, y, z])), rotation=Quaternion(w=qw, x=qx, y=qy, z=qz)
    )  # fmt: skip
