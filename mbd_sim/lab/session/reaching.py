"""A point of a part is brought to a target, by inverse kinematics beside the session, which goes on meanwhile."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from operator import methodcaller

import numpy as np

from mbd_sim.analysis.mechanics.inverse_kinematics import TRIES, InverseKinematics, improving
from mbd_sim.analysis.mechanics.kinematics import Kinematics
from mbd_sim.base.errors import MbdSimError
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.lab.session.session import Session
from mbd_sim.mechanism.elements.actuators import CoordinatePort
from mbd_sim.mechanism.elements.joint_types import CommandedDrive
from mbd_sim.mechanism.mechanism import Mechanism

BETTER = 1.0 - 1e-6  # of the distance and angle of the last one, below which a configuration is shown instead


@dataclass(frozen=True, eq=False)
class Goal:
    """Where a point shall be: the point `at` (3,) in the axes of a `frame`, which is a part or a point `part.point`.

    `position` (3,) and `rotation` (3, 3) are those of the target in ground's frame; None for any orientation.
    """

    frame: str
    at: Array
    position: Array
    rotation: Array | None = None

    def left(self, found: InverseKinematics, size: float) -> float:
        """How far a configuration is from the target, where 1 rad counts as the `size` of the mechanism, in m."""
        return found.distance if self.rotation is None else float(np.hypot(found.distance, size * found.angle))


class Reacher:
    """A thread that looks for the newest goal, and puts the mechanism there, or commands its joints to go there."""

    def __init__(self, session: Session) -> None:
        self._session, self._wanted = session, list[tuple[Goal, int, bool]]()
        self.found: InverseKinematics | None = None
        self.searching = self.commanded = False
        self.refused = ""  # why the mechanism cannot be put where it was found
        self._known: tuple[Mechanism, Kinematics] | None = None
        self._lock, self._wake, self._stopped = threading.Lock(), threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="lab_reaching", daemon=True)
        self._thread.start()

    def ask(self, goal: Goal, *, near: bool = False, command: bool = False) -> None:
        """Look for a goal, from any thread, instead of the one before.

        :param near: look only from where the mechanism is, not from other positions as well.
        :param command: do not move the mechanism: command its servos and drives.
        """
        with self._lock:
            self._wanted, self.searching = [(goal, 1 if near else TRIES, command)], True
        self._wake.set()

    def stop(self) -> None:
        """End the thread."""
        self._stopped.set()
        self._wake.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._stopped.is_set():
            self._wake.wait()
            self._wake.clear()
            with self._lock:
                wanted, self._wanted = self._wanted, []
            for goal, tries, command in wanted:
                try:
                    self._search(goal, tries, command)
                except (MbdSimError, ValueError) as error:
                    self._session.ask("not reached", methodcaller("tell", str(error)))
                with self._lock:
                    self.searching = bool(self._wanted)

    def _search(self, goal: Goal, tries: int, command: bool) -> None:
        """Go to each configuration that is nearer to the goal, or command the last, until another goal is wanted."""
        frame = self._session.frame
        if self._known is None or self._known[0] is not frame.mechanism:
            self._known = frame.mechanism, Kinematics(frame.mechanism)
        kinematics, best, last = self._known[1], np.inf, None
        size = kinematics.constraints.size or 1.0
        for found in improving(
            kinematics, goal.frame, goal.position, goal.rotation, goal.at, frame.q, frame.time, tries=tries
        ):
            if self._wake.is_set():
                return
            if last is None or goal.left(found, size) < BETTER * best:
                best, last, self.refused, self.commanded = goal.left(found, size), found, "", command
                self.found = found
                if not command:
                    self._session.ask("reach", partial(self._put, found))
        if command and last is not None:
            for name, value in position_commands(frame.mechanism, last.positions).items():
                self._session.ask(f"command {name}", methodcaller("set_command", name, value))

    def _put(self, found: InverseKinematics, session: Session) -> None:
        """Put the mechanism there; for the session, which shows why that is refused.

        :raises CommandError: parts would be inside each other, or beyond a stop.
        """
        try:
            session.put(found)
        except (MbdSimError, ValueError) as error:
            self.refused = str(error) if self.found is found else self.refused
            raise


def pose_of(mechanism: Mechanism, frame: str, at: Array, poses: Mapping[str, Pose]) -> Pose:
    """The pose of the point `at` (3,) of a frame, as in `Goal`, with the poses of the parts."""
    part, _, point = frame.partition(".")
    own = poses[part]
    if point:
        own = own @ mechanism.parts[part].points[point]
    return own @ Pose(at, np.eye(3))


def position_commands(mechanism: Mechanism, positions: Mapping[str, float]) -> dict[str, float]:
    """The commands that hold joints at positions, in rad and m, by the names of `Bench.values`."""
    found: dict[str, float] = {}
    for taker in mechanism.commanded:
        port = None if isinstance(taker, CommandedDrive) else taker.port
        joint = port.coordinate if isinstance(port, CoordinatePort) else taker.name if port is None else ""
        if "position" in taker.channels and joint in positions:
            found[f"{taker.name}.position"] = positions[joint]
    return found
