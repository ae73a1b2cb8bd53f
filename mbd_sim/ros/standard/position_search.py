"""Searches for joint positions by inverse kinematics, in a process of their own beside the node.

A search takes up to seconds, in the interpreter that the stepping thread would have to share. The process knows
neither ROS nor the run: each search has the state from which it begins.
"""

from __future__ import annotations

import os
import pickle
import socket
import sys
import time
from collections.abc import Callable

import numpy as np

from mbd_sim.analysis.mechanics.inverse_kinematics import InverseKinematics, improving
from mbd_sim.analysis.mechanics.kinematics import Kinematics
from mbd_sim.base.errors import MbdSimError
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.operating_system import lower_priority
from mbd_sim.dynamics.constraints.assembly import close_nearby
from mbd_sim.dynamics.layouts.coordinate_names import with_positions
from mbd_sim.lab.session.link import SocketEnd
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.ros.standard.position_orders import PositionAnswer, PositionSearch

NICENESS = 10  # so that the node comes first where there is not enough processor time for both


def searched(kinematics: Kinematics, search: PositionSearch, clock: Callable[[], float]) -> PositionAnswer:
    """Search; of a target that is not reached, the answer has the nearest position that was found until then."""
    end, late = clock() + search.limit, False

    def stop() -> bool:
        nonlocal late
        late = clock() >= end
        return late

    try:
        q = _begun(kinematics, search)
        target = Pose(search.position, np.eye(3) if search.rotation is None else search.rotation)
        if search.relative_to is not None:
            target = kinematics.poses(q, search.time)[search.relative_to] @ target
        rotation = None if search.rotation is None else target.rotation
        *_, found = improving(
            kinematics, search.frame, target.position, rotation, q=q, time=search.time, stop=stop
        )  # fmt: skip
    except (MbdSimError, ValueError) as error:
        return PositionAnswer("INVALID_ROBOT_STATE", str(error))
    return _answer(kinematics, search, found, late=late)


def _begun(kinematics: Kinematics, search: PositionSearch) -> Array:
    """The coordinates (nq,) with which the search begins: those of the seed, with the loops closed.

    :raises ValueError: no position near them closes the loops.
    """
    q = with_positions(kinematics.mechanism, kinematics.layout, kinematics.checked(search.q), search.seed)
    free = np.array([name not in search.seed for name in _names_of_speeds(kinematics)], dtype=bool)
    closing = close_nearby(kinematics.constraints, search.time, q, free)
    return closing.q if closing.closed else kinematics.closed(q, search.time)


def _names_of_speeds(kinematics: Kinematics) -> list[str]:
    joints = (joint for joint in kinematics.mechanism.joints.values() if not joint.drive)
    return [name for joint in joints for name in joint.motion_names]


def _answer(
    kinematics: Kinematics, search: PositionSearch, found: InverseKinematics, *, late: bool
) -> PositionAnswer:  # fmt: skip
    outcome, text = "SUCCESS", ""
    if not found.reached:
        outcome, text = "NO_IK_SOLUTION", found.reason
    if not found.reached and late:
        outcome, text = "TIMED_OUT", f"not reached within {search.limit:.3g} s. {found.reason}"
    poses: dict[str, Array] = {}
    for joint in kinematics.mechanism.joints.values():
        if joint.kind.quaternion is not None and not joint.drive:
            own = found.q[kinematics.layout.q[joint.name]]
            position = own[: joint.kind.quaternion] if joint.kind.quaternion else np.zeros(3)
            poses[joint.name] = np.concatenate([position, own[joint.kind.quaternion :]])
    return PositionAnswer(outcome, text, found.positions, poses)


def main() -> int:
    """Serve the node over the socket whose number is the first argument, until it closes it.

    The node sends the mechanism, searches, and again a mechanism when live values have changed it.
    """
    lower_priority(NICENESS)
    link = SocketEnd(socket.socket(fileno=int(sys.argv[1])), blocking=True)
    known: Mechanism | None = None
    kinematics: Kinematics | None = None
    try:
        while True:
            order = _received(link)
            if isinstance(order, Mechanism):
                known, kinematics = order, None
                continue
            try:
                assert known is not None
                kinematics = kinematics or Kinematics(known)
                answer = searched(kinematics, order, time.monotonic)
            except MbdSimError as error:
                answer = PositionAnswer("FAILURE", str(error))
            link.send(pickle.dumps(answer))
    except (OSError, KeyboardInterrupt):
        os._exit(0)


def _received(link: SocketEnd) -> Mechanism | PositionSearch:
    message = link.receive()
    assert message is not None
    order: Mechanism | PositionSearch = pickle.loads(message)  # noqa: S301  (from the node that started this process)
    return order
