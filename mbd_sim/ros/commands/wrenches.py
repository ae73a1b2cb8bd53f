"""Buffers commanded wrenches from the topics until the next step, with a watchdog. Independent of ROS."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from mbd_sim.base.errors import CommandError, nearest
from mbd_sim.base.geometry.pose import Array
from mbd_sim.mechanism.elements.parts import GROUND
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.simulation.model.commands import WrenchMap
from mbd_sim.simulation.run.simulation import BaseSimulation

WrenchTargets = Sequence[tuple[str, str | None]]  # a part, and one of its points or None for the mass center

ALL = "*"  # stands for all parts and points
GROUND_FRAMES = ("", GROUND, "world")  # frames that mean ground's axes


@dataclass(frozen=True, eq=False)
class Wrench:
    """A force (3,) in N and a couple (3,) in N·m on a part, in the axes of `frame`.

    The force acts at a point of the part by name, or at its mass center where `point` is None.
    """

    part: str
    force: Array
    couple: Array
    frame: str = GROUND
    point: str | None = None

    def apply(self, simulation: BaseSimulation) -> None:
        """Apply the wrench from the next step on; the simulation reports what changes.

        Given in the part's own frame, it rotates with the part. Given in the frame of another part, it keeps the
        direction that this frame has now.
        """
        force, couple, axes = self.force, self.couple, "ground"
        if self.frame == self.part:
            axes = "part"
        elif self.frame != GROUND:
            rotation = simulation.poses()[self.frame].rotation
            force, couple = rotation @ force, rotation @ couple
        simulation.set_wrench(self.part, force, couple, at=self.point, axes=axes)


class Pull(Protocol):
    """A wrench on a part that follows the motion, as that of a spring; `apply` sets that of the present state.

    `point` (3,) is where it acts, in the frame of the part, and `target` (3,) where it pulls to, in ground's.
    """

    @property
    def part(self) -> str: ...  # noqa: D102
    @property
    def point(self) -> Array: ...  # noqa: D102
    @property
    def target(self) -> Array: ...  # noqa: D102
    def apply(self, simulation: BaseSimulation) -> None: ...  # noqa: D102


PULL_PERIOD = 2e-3  # s of simulated time between two wrenches of a pull


@dataclass(frozen=True)
class ExpiredWrench:
    """A part on which the wrench ends at the next step."""

    part: str

    def apply(self, simulation: BaseSimulation) -> None:
        """End the wrench from the next step on."""
        simulation.expire_wrench(self.part)


class WrenchBuffer:
    """Takes wrenches in one thread and passes them to the stepping thread.

    A wrench is accepted or rejected as a whole; on each part the newest one acts. If none has arrived for a part
    for `timeout` seconds of simulated time (0: no limit), the wrench on that part is set to zero, unless it is zero.
    """

    def __init__(self, wrench_map: WrenchMap, parts: Sequence[str], timeout: float, frame_prefix: str = "") -> None:
        """`parts` are those of the mechanism, in whose frames a wrench may be given."""
        self.timeout = timeout
        self.accepted = self.rejected = self.expired = 0
        self._map, self._parts, self._prefix = wrench_map, tuple(parts), frame_prefix
        self._new: dict[str, Wrench | Pull] = {}
        self._pulls: dict[str, Pull] = {}  # by part
        self._pulled = -math.inf  # s, the time of their last wrenches
        self._lock = threading.Lock()
        self._since: dict[str, float] = {}
        self._acting: dict[str, bool] = {}  # whether the newest wrench on a part is other than zero

    @property
    def loaded(self) -> tuple[str, ...]:
        """The parts that accept wrenches."""
        return tuple(self._map.slices)

    def take(self, part: str, point: str | None, frame: str, force: Sequence[float], couple: Sequence[float]) -> None:
        """Take a wrench on a part, in the axes of `frame`: a part's name, `ground`, `world`, or empty for ground.

        :raises CommandError: rejected; nothing changes.
        """
        try:
            name = frame.removeprefix(self._prefix)
            if frame not in GROUND_FRAMES and name not in (*GROUND_FRAMES, *self._parts):
                raise CommandError(f"there is no frame '{frame}'", nearest(name, (GROUND, *self._parts)))
            self._map.numbers(part, force, couple, point, "ground")
        except CommandError:
            self.rejected += 1
            raise
        axes = GROUND if frame in GROUND_FRAMES or name in GROUND_FRAMES else name
        wrench = Wrench(part, np.array(force, dtype=float), np.array(couple, dtype=float), axes, point)
        with self._lock:
            self._new[part] = wrench
            self.accepted += 1

    def pull(self, pull: Pull) -> None:
        """Take a pull, which expires as a wrench does unless it is repeated.

        :raises CommandError: rejected; nothing changes.
        """
        try:
            self._map.numbers(pull.part, pull.target, (0.0, 0.0, 0.0), pull.point, "ground")
        except CommandError:
            self.rejected += 1
            raise
        with self._lock:
            self._new[pull.part] = pull
            self.accepted += 1

    def steps_to_pull(self, step_size: float, at_most: int) -> int:
        """The steps to the next wrench of a pull, or fewer."""
        return min(at_most, max(1, round(PULL_PERIOD / step_size))) if self._pulls else at_most

    def due(self, time: float) -> Iterator[Wrench | Pull | ExpiredWrench]:
        """What to apply from simulated `time` (s, monotonic) on."""
        with self._lock:
            newest, self._new = self._new, {}
        for part, wrench in newest.items():
            self._since[part] = time
            if isinstance(wrench, Wrench):
                self._pulls.pop(part, None)
                self._acting[part] = bool(np.any(wrench.force) or np.any(wrench.couple))
                yield wrench
            else:
                self._pulls[part], self._acting[part] = wrench, True
        if self._since and self.timeout > 0.0:
            for part in [part for part, since in self._since.items() if time - since >= self.timeout]:
                del self._since[part]
                self._pulls.pop(part, None)
                if not self._acting[part]:
                    continue
                self.expired += 1
                yield ExpiredWrench(part)
        if self._pulls and time - self._pulled >= PULL_PERIOD * (1.0 - 1e-9):
            self._pulled = time
            yield from self._pulls.values()

    def clear(self) -> None:
        """Discard all wrenches, as after a reset."""
        with self._lock:
            self._new = {}
        self._since.clear()
        self._pulls.clear()


def wrench_targets(mechanism: Mechanism, names: Sequence[str]) -> WrenchTargets:
    """The parts and points of parts that accept wrenches: the named ones, or all if a name is `*`.

    :raises ValueError: there is no such part or point.
    """
    targets = {(name, point) for name, part in mechanism.parts.items() for point in (None, *part.points)}
    known = {part if point is None else f"{part}.{point}": (part, point) for part, point in sorted(targets, key=str)}
    for name in names:
        if name not in known and name != ALL:
            raise ValueError(f"wrenches: there is no part or point '{name}'. {nearest(name, known)}")
    return list(known.values()) if ALL in names else [known[name] for name in names]
