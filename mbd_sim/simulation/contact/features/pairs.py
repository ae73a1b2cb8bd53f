"""The pairs of bodies that touch with changing features: which are near, and when their features change.

A slot has features only while it is closed, and at the instants of events. Whether two bodies meet is known from the
distance that their narrow phase gives, so that the motion does not depend on what was looked at before.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from mbd_sim.base.geometry.pose import Array, Pose, pack_poses
from mbd_sim.base.roots import first_zero
from mbd_sim.base.short_repr import short_repr
from mbd_sim.compiler.python.bound_kernel import Kernel
from mbd_sim.dynamics.contact.one_sided_equations import OneSidedEquations
from mbd_sim.mechanism.elements.contacts import (
    Barrel,
    Cluster,
    ConeBody,
    Contact,
    EllipsoidBody,
    Face,
    PlanarBody,
    Solid,
)
from mbd_sim.mechanism.elements.parts import GROUND
from mbd_sim.simulation.contact.features.clearances import Clearances
from mbd_sim.simulation.contact.features.clusters import ClusterOnPlane
from mbd_sim.simulation.contact.features.narrow_phase import NarrowPhase, SlotFeatures
from mbd_sim.simulation.contact.features.outlines import OutlinePair
from mbd_sim.simulation.contact.features.polytopes import PolytopePair
from mbd_sim.simulation.contact.features.smooth import SmoothPair

PATH = 1.05  # of the straight line, the path of a body in a step
AT_REST = 1e-6  # of the tolerance, by which the poses of bodies at rest may change in a step
BRIEF = 2.0**-8  # of a step, in which the rate of a distance is measured
NARROWING = 60  # thirds by which the lowest distance within a step is sought
DEEPER = 0.02  # of the tolerance, by which bodies must be deeper at an impact than at the one before, beyond round-off
BORDER = 0.5  # of the tolerance, by which the point of a closed slot may be beside its face or edge after an event


def narrow_phase(contact: Contact) -> NarrowPhase:
    """The narrow phase of a contact with slots."""
    match contact.first, contact.second:
        case Cluster() as cluster, Face() as face:
            return ClusterOnPlane(cluster, face, contact.slots)
        case Solid() as first, Solid() as second:
            return PolytopePair(first, second, contact.slots, contact.still)
        case PlanarBody() as first, PlanarBody() as second:
            return OutlinePair(first, second, contact.slots, contact.names)
        case (
            (Solid() | Barrel() | ConeBody() | EllipsoidBody()) as first,
            (Solid() | Barrel() | ConeBody() | EllipsoidBody()) as second,
        ):
            return SmoothPair(first, second, contact.slots)
        case one, other:
            raise ValueError(f"contact {contact.name}: {type(one).__name__} and {type(other).__name__} have no slots")


@dataclass(frozen=True, eq=False)
class FeaturePair:
    """Two bodies, and where their slots are: the indices of their `gaps`, and of their `numbers` among the inputs.

    `parts` are the rows of the poses of both.
    """

    contact: Contact
    phase: NarrowPhase
    gaps: tuple[int, ...]
    numbers: tuple[slice, ...]
    parts: tuple[int, int]


class PosesInTime(Protocol):
    """A motion from a state on: what is read of it after a length in s."""

    def poses(self, length: float) -> Array:
        """The poses of all parts, see `FeaturePairs.poses`."""

    def gaps(self, length: float) -> Array:
        """The gaps (gaps,) in m of the slots with their present features."""


class FeaturePairs:
    """All pairs of a model with changing features. It holds no state.

    :param closed: the place of the closed gaps among the inputs, and `features` that of the numbers of the slots.
    :param tolerance: the gap in m that counts as zero.
    """

    __repr__ = short_repr

    def __init__(
        self,
        one_sided: OneSidedEquations,
        closed: int,
        features: int,
        kernel: Kernel,
        part_names: Sequence[str],
        tolerance: float,
    ) -> None:
        """:param kernel: which reads the poses of these parts."""
        self._read, self._reads_inputs = kernel.readers["poses"], kernel.reads_inputs["poses"]
        self._count, self._tolerance, self._closed = len(part_names), tolerance, closed
        self._ground = pack_poses(np.zeros((1, 3)), np.eye(3)[None])
        rows = {name: row for row, name in enumerate((*part_names, GROUND))}
        slots: dict[Contact, list[int]] = {}
        for gap in (index for index, gap in enumerate(one_sided.gaps) if gap.numbers is not None):
            contact = one_sided.gaps[gap].contact
            assert contact is not None
            slots.setdefault(contact, []).append(gap)
        self.pairs: list[FeaturePair] = []
        first = features
        for contact, gaps in slots.items():
            known = one_sided.gaps[gaps[0]].numbers
            assert known is not None
            size = known.shape[0]  # of a slot, the last of whose numbers is its key
            numbers = tuple(slice(first + size * k, first + size * (k + 1)) for k in range(len(gaps)))
            parts = rows[contact.first.at.part], rows[contact.second.at.part]
            self.pairs.append(FeaturePair(contact, narrow_phase(contact), tuple(gaps), numbers, parts))
            first = numbers[-1].stop
        self._features = slice(features, first)
        self._parts = np.array([pair.parts for pair in self.pairs], dtype=int).reshape(-1, 2)
        self._bounds = [pair.phase.bounds for pair in self.pairs]
        self._across = np.array([_across(pair.contact.still) for pair in self.pairs])

    def clearances(self) -> Clearances:
        """Where the distances of one motion are remembered."""
        return Clearances(self._parts, self._bounds, self._across)

    def poses(self, time: float, y: int, inputs: int) -> Array:
        """The poses (parts + 1, 12) of all parts and of ground, from the addresses of a state and of the inputs."""
        out, moment = np.empty((self._count + 1, 12)), np.array([time])
        given = (y, inputs) if self._reads_inputs else (y,)
        self._read(moment.ctypes.data, *given, out.ctypes.data)
        out[-1:] = self._ground
        return out

    def closed(self, pair: FeaturePair, inputs: Array) -> list[int]:
        """The slots of a pair that are closed."""
        return [slot for slot, gap in enumerate(pair.gaps) if inputs[self._closed + gap]]

    def first_change(
        self, motion: PosesInTime, inputs: Array, known: Clearances, first: float | None, length: float
    ) -> float | None:
        """Where two bodies meet or features change, if that is before the `first` event or before a length in s.

        :param known: distances of this motion; those that are computed are added.
        """
        end = length if first is None else first
        for index in self._approaching(motion.poses(0.0), motion.poses(end), inputs, known) if end else ():
            found = self._change(index, motion, inputs, known, end)
            if found is not None:
                first = end = found
                if not end:
                    break
        return first

    def _approaching(self, before: Array, after: Array, inputs: Array, known: Clearances) -> list[int]:
        """The pairs that may have met on the way from the poses before to those after it: not those at rest."""
        moves = np.any(np.abs(after - before) > AT_REST * self._tolerance, axis=1)
        if not np.any(moves):
            return []
        path = PATH * known.paths(before, after) + 4.0 * self._tolerance
        near = known.at_least(before) + known.at_least(after) <= path
        near |= np.array([bool(self.closed(pair, inputs)) for pair in self.pairs])
        near &= np.any(moves[self._parts], axis=1)
        if np.any(near):
            near &= known.spheres(before) + known.spheres(after) <= path
        return [int(index) for index in np.flatnonzero(near)]

    def _change(self, index: int, motion: PosesInTime, inputs: Array, known: Clearances, end: float) -> float | None:
        pair = self.pairs[index]
        closed = self.closed(pair, inputs)
        gaps, both = [pair.gaps[slot] for slot in closed], dict[float, tuple[Pose, Pose]]()

        def poses(s: float) -> tuple[Pose, Pose]:
            if s not in both:
                both[s] = _poses_of(pair, motion.poses(s))
            return both[s]

        def distance(s: float) -> float:
            found = pair.phase.distance(*poses(s))
            return found - min(0.0, *motion.gaps(s)[gaps].tolist()) if gaps else found

        def margin(s: float) -> float:
            return min((pair.phase.margin(*poses(s), inputs[pair.numbers[slot]]) for slot in closed), default=np.inf)

        last, room = distance(end), margin(end)
        known.note(index, motion.poses(end), last)
        if last >= 0.0 and room >= -self._tolerance:
            path = PATH * float(known.paths(motion.poses(0.0), motion.poses(end))[index])
            return None if closed else self._passed(path, distance, end, last)
        start = distance(0.0)
        spare = self._tolerance if closed else DEEPER * self._tolerance
        offset = spare + max(0.0, -start) if closed or start <= self._tolerance else 0.0

        def value(s: float) -> float:
            return min(distance(s) + offset, margin(s) + self._tolerance)

        if (last := min(last + offset, room + self._tolerance)) >= 0.0:
            return None
        return first_zero(value, end, min(start + offset, margin(0.0) + self._tolerance), last, 0.0)

    def _passed(self, path: float, distance: Callable[[float], float], end: float, last: float) -> float | None:
        """Where bodies meet that are apart at both ends of a step, but turn back or pass each other within it.

        :param path: how far in m they can move against each other in the step.
        """
        if last >= path or (start := distance(0.0)) + last >= path or start <= self._tolerance:
            return None
        brief = BRIEF * end
        if distance(brief) >= start or distance(end - brief) >= last:
            return None
        low, high = 0.0, end
        for _ in range(NARROWING):
            one, other = low + (high - low) / 3.0, high - (high - low) / 3.0
            values = distance(one), distance(other)
            if min(values) < 0.0:
                lowest = one if values[0] < 0.0 else other
                return first_zero(distance, lowest, start, distance(lowest), 0.0)
            low, high = (low, other) if values[0] < values[1] else (one, high)
        return None

    def _overlapping(self, poses: Array) -> list[int]:
        """The pairs whose spheres overlap."""
        gaps = self.clearances().spheres(poses)
        return [int(index) for index in np.flatnonzero(gaps <= 4.0 * self._tolerance)]

    def renew(self, time: float, y: Array, inputs: Array) -> None:
        """Find the features of all slots at a state; closed slots keep theirs as long as these are where they meet."""
        poses = self.poses(time, y.ctypes.data, inputs.ctypes.data)
        near = self._overlapping(poses)
        for index, pair in enumerate(self.pairs):
            if index in near:
                self._renew(pair, poses, inputs)
            else:
                for slot in range(len(pair.gaps)):
                    self._empty(pair, slot, inputs)

    def find_all(self, states: Sequence[tuple[float, Array]], inputs: Array, tolerance: float) -> None:
        """Find the features of all slots at some states with their times, up to gaps of a tolerance in m.

        Those at the first state come first; nothing is kept of what the slots have been.
        """
        inputs[self._features] = 0.0
        found: dict[int, dict[int, SlotFeatures]] = {}
        for time, y in states:
            poses = self.poses(time, y.ctypes.data, inputs.ctypes.data)
            for index in self._overlapping(poses):
                pair = self.pairs[index]
                for each in pair.phase.touching(*_poses_of(pair, poses), tolerance):
                    found.setdefault(index, {}).setdefault(each.key, each)
        for index, features in found.items():
            for numbers, each in zip(self.pairs[index].numbers, features.values(), strict=False):
                inputs[numbers] = each.numbers

    def _renew(self, pair: FeaturePair, poses: Array, inputs: Array) -> None:
        both = _poses_of(pair, poses)
        kept: dict[int, int] = {}
        for slot in self.closed(pair, inputs):
            numbers = inputs[pair.numbers[slot]]
            if pair.phase.margin(*both, numbers) >= -BORDER * self._tolerance:
                kept[int(numbers[-1])] = slot
        touching = pair.phase.touching(*both, self._tolerance)
        found = [each for each in touching if each.key not in kept]
        if len(found) > len(pair.gaps) - len(kept):  # as where a corner that lies on a corner has a slot for each side
            keys = {each.key for each in touching}
            kept = {key: slot for key, slot in kept.items() if key in keys}
        old = {int(inputs[numbers][-1]): slot for slot, numbers in enumerate(pair.numbers)}
        free = [slot for slot in range(len(pair.gaps)) if slot not in kept.values()]
        chosen = {old[each.key]: each for each in found if old.get(each.key) in free}
        free = [slot for slot in free if slot not in chosen]
        chosen |= dict(zip(free, (each for each in found if each.key not in old), strict=False))
        for slot in range(len(pair.gaps)):
            if slot in chosen:
                if inputs[pair.numbers[slot]][-1] != chosen[slot].key:
                    self._empty(pair, slot, inputs)
                inputs[pair.numbers[slot]] = chosen[slot].numbers
            elif slot not in kept.values():
                self._empty(pair, slot, inputs)

    def _empty(self, pair: FeaturePair, slot: int, inputs: Array) -> None:
        inputs[pair.numbers[slot]] = 0.0
        inputs[self._closed + pair.gaps[slot]] = 0.0

    def end_step(self, time: float, y: Array, inputs: Array) -> None:
        """After a step: empty the slots that are open, and renew what the rows of the others iterate from."""
        for pair in self.pairs:
            closed = self.closed(pair, inputs)
            for slot, numbers in enumerate(pair.numbers):
                if slot not in closed:
                    inputs[numbers] = 0.0
            if closed and pair.phase.iterates:
                both = _poses_of(pair, self.poses(time, y.ctypes.data, inputs.ctypes.data))
                for slot in closed:
                    inputs[pair.numbers[slot]] = pair.phase.renewed(*both, inputs[pair.numbers[slot]])

    def distances(self, time: float, y: Array, inputs: Array) -> dict[int, float]:
        """The distance of the two bodies in m, by the index of each of their gaps."""
        poses = self.poses(time, y.ctypes.data, inputs.ctypes.data)
        found = ((pair, pair.phase.distance(*_poses_of(pair, poses))) for pair in self.pairs)
        return {gap: distance for pair, distance in found for gap in pair.gaps}

    def depths(self, time: float, y: Array, inputs: Array) -> Iterator[tuple[Contact, float]]:
        """The contacts whose bodies penetrate each other at a state, with the depths in m."""
        poses = self.poses(time, y.ctypes.data, inputs.ctypes.data)
        for index in self._overlapping(poses):
            pair = self.pairs[index]
            if (depth := -pair.phase.distance(*_poses_of(pair, poses))) > 0.0:
                yield pair.contact, depth


def _poses_of(pair: FeaturePair, poses: Array) -> tuple[Pose, Pose]:
    """The poses of both parts; of pairs in a plane, in this plane."""
    across = _across(pair.contact.still)
    one, other = (Pose(row[:3] * across, row[3:].reshape(3, 3).T) for row in (poses[part] for part in pair.parts))
    return one, other


def _across(still: int | None) -> Array:
    """0 for the axis along which nothing moves, and 1 for the others."""
    return np.array([float(axis != still) for axis in range(3)])
