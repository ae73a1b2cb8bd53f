"""Wrenches on their way from topics to the simulation, with their watchdog. Knows no ROS."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mbd_sim.errors import CommandError, nearest
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import GROUND, Mechanism
from mbd_sim.simulation.events import EventKind
from mbd_sim.simulation.simulation import Simulation
from mbd_sim.simulation.wrenches import WrenchMap

Loadable = Sequence[tuple[str, str | None]]  # parts, with a point of theirs or None for the mass centre

EVERY = "*"  # stands for all parts and points
INERTIAL = ("", GROUND, "world")  # frames that mean ground's axes


@dataclass(frozen=True, eq=False)
class Wrench:
    """A force (3,) in N and a couple (3,) in N·m on a part, in the axes of `frame`; `point` None: the mass centre."""

    part: str
    force: Array
    couple: Array
    frame: str = GROUND
    point: str | None = None

    def apply(self, simulation: Simulation) -> None:
        """Let it act from the next step on.

        In the part's own frame it turns with the part; in that of another part it has the direction of this moment.
        """
        force, couple, axes = self.force, self.couple, "ground"
        if self.frame == self.part:
            axes = "part"
        elif self.frame != GROUND:
            turn = simulation.poses()[self.frame].rotation
            force, couple = turn @ force, turn @ couple
        simulation.set_wrench(self.part, force, couple, at=self.point, axes=axes)


@dataclass(frozen=True)
class DueWrench:
    """A wrench that takes effect at the next step, and why."""

    kind: EventKind
    wrench: Wrench


class WrenchBuffer:
    """Takes wrenches in one thread and hands them to the stepping thread.

    A wrench is accepted or rejected whole; on each part the newest one acts. Without one for `timeout` seconds of
    simulated time (0: for ever) that on its part goes to zero.
    """

    def __init__(self, wrench_map: WrenchMap, parts: Sequence[str], timeout: float, frame_prefix: str = "") -> None:
        """`parts` are those of the mechanism: the frames that a wrench may be given in."""
        self.timeout = timeout
        self.accepted = self.rejected = self.expired = 0
        self._map, self._parts, self._prefix = wrench_map, tuple(parts), frame_prefix
        self._fresh: deque[Wrench] = deque()
        self._since: dict[str, float] = {}

    @property
    def loaded(self) -> tuple[str, ...]:
        """The parts that take wrenches."""
        return tuple(self._map.slices)

    def place(self, part: str) -> slice:
        """Where the wrench on a part stands among the inputs of the equations."""
        return self._map.slices[part]

    def take(self, part: str, point: str | None, frame: str, force: Sequence[float], couple: Sequence[float]) -> None:
        """Take a wrench on a part, in the axes of `frame`: a part's name, or ground, world or nothing.

        :raises CommandError: rejected; nothing changes.
        """
        try:
            name = frame.removeprefix(self._prefix)
            if frame not in INERTIAL and name not in (*INERTIAL, *self._parts):
                raise CommandError(f"there is no frame '{frame}'. {nearest(name, (GROUND, *self._parts))}")
            self._map.numbers(part, force, couple, point, "ground")
        except CommandError:
            self.rejected += 1
            raise
        named = GROUND if frame in INERTIAL or name in INERTIAL else name
        self._fresh.append(Wrench(part, np.array(force, dtype=float), np.array(couple, dtype=float), named, point))
        self.accepted += 1

    def due(self, time: float) -> Iterator[DueWrench]:
        """What to apply from simulated `time` (s, never going back) on."""
        newest: dict[str, Wrench] = {}
        while self._fresh:
            wrench = self._fresh.popleft()
            newest[wrench.part] = wrench
        for part, wrench in newest.items():
            self._since[part] = time
            yield DueWrench(EventKind.COMMAND, wrench)
        if self._since and self.timeout > 0.0:
            for part in [part for part, since in self._since.items() if time - since >= self.timeout]:
                del self._since[part]
                self.expired += 1
                yield DueWrench(EventKind.EXPIRED, Wrench(part, np.zeros(3), np.zeros(3)))

    def clear(self) -> None:
        """Forget all wrenches, as after a reset."""
        self._fresh.clear()
        self._since.clear()


def loadable(mechanism: Mechanism, given: Sequence[str]) -> Loadable:
    """Parts, and points of parts, that take wrenches: those that are given, or all where one is `*`.

    :raises ValueError: there is no such part or point.
    """
    every = {(name, point) for name, part in mechanism.parts.items() for point in (None, *part.points)}
    known = {name if point is None else f"{name}.{point}": (name, point) for name, point in sorted(every, key=str)}
    for name in given:
        if name not in known and name != EVERY:
            raise ValueError(f"wrenches: there is no part or point '{name}'. {nearest(name, known)}")
    return list(known.values()) if EVERY in given else [known[name] for name in given]
