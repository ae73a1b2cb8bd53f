"""The pairs of bodies that touch with changing features, and the narrow phase of each: see `compiled.pairs`.

A slot has features only while it is closed, and at the instants of events. Whether two bodies meet is known from the
distance that their narrow phase gives, so that the motion does not depend on what was looked at before.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.errors import DivergedError
from mbd_sim.base.geometry.pose import Array, Pose, pack_poses
from mbd_sim.base.short_repr import short_repr
from mbd_sim.compiler.ir.python_kinds import address_of, prototype
from mbd_sim.compiler.python.bound_kernel import Kernel
from mbd_sim.dynamics.contact.barrel_rows import BARREL_SIZE
from mbd_sim.dynamics.contact.one_sided_equations import OneSidedEquations
from mbd_sim.dynamics.contact.rows.pools import SlotPool
from mbd_sim.mechanism.elements.contacts import (
    Ball,
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
from mbd_sim.simulation.contact.compiled.features.barrels import BallOnBarrel
from mbd_sim.simulation.contact.compiled.pairs import KNOWN, MEMORY, NO_GAP, SEEN, FeaturePair
from mbd_sim.simulation.contact.features.clusters import ClusterOnPlane
from mbd_sim.simulation.contact.features.narrow_phase import (
    Bounds,
    CompiledPhase,
    NarrowPhase,
    PhaseFunctions,
    SlotFeatures,
    functions_of,
)
from mbd_sim.simulation.contact.features.outlines import OutlinePair
from mbd_sim.simulation.contact.features.polytopes import PolytopePair
from mbd_sim.simulation.contact.features.round_bodies import SmoothPair


class BarrelPair(CompiledPhase):
    """A ball and a cylinder; the ball is `inside` a tube, or on the cylinder: see `NarrowPhase`."""

    def __init__(self, ball: Ball, barrel: Barrel, *, inside: bool) -> None:
        half = 0.5 * barrel.length
        record = BallOnBarrel(ball.at.point, ball.radius, barrel.at.point, barrel.axis, barrel.radius, half, inside)
        reach = math.hypot(barrel.radius, half)
        bounds = Bounds(ball.at.point, ball.radius), Bounds(barrel.at.point, reach)
        super().__init__("barrel", record, bounds, 1, BARREL_SIZE, iterates=False)


def narrow_phase(contact: Contact) -> NarrowPhase:
    """The narrow phase of a contact with slots."""
    match contact.first, contact.second:
        case Cluster() as cluster, Face() as face:
            return ClusterOnPlane(cluster, face, contact.slots)
        case Solid() as first, Solid() as second:
            return PolytopePair(first, second, contact.slots, contact.still)
        case Ball() as ball, Barrel() as barrel:
            return BarrelPair(ball, barrel, inside=contact.inside)
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
class SlottedPair:
    """Two bodies, and where their slots are: their `gaps`, and the first of their `numbers` among the inputs.

    `parts` are the rows of the poses of both. A slot has `size` numbers. Pair `number` of a pool has some of its gaps;
    the numbers of the pairs that have them are among the inputs from `holders` on.
    """

    contact: Contact
    phase: NarrowPhase
    gaps: tuple[int, ...]
    numbers: int
    size: int
    parts: tuple[int, int]
    number: int = 0
    holders: int | None = None

    @property
    def slots(self) -> int:
        """How many of the gaps it can have."""
        return len(self.gaps) if self.holders is None else self.contact.slots

    def poses(self, poses: Array) -> tuple[Pose, Pose]:
        """The poses of both parts, from those of all; of pairs in a plane, in this plane."""
        across = _across(self.contact.still)
        one, other = (Pose(row[:3] * across, row[3:].reshape(3, 3).T) for row in (poses[part] for part in self.parts))
        return one, other

    def compiled(self, failures: list[BaseException], lacking: int) -> tuple[FeaturePair, PhaseFunctions]:
        """The record for compiled code, with its own memory, and the functions that must live as long.

        :param failures: receives what functions in Python raise.
        :param lacking: the address of what is called where a pool has too few slots.
        """
        functions, memory = functions_of(self.phase, self.slots, self.size, failures), np.zeros(MEMORY)
        memory[[KNOWN, SEEN]] = -np.inf
        one, other = self.phase.bounds
        record = FeaturePair(
            distance=functions.distance,
            beyond=functions.beyond,
            margin=functions.margin,
            touching=functions.touching,
            renew=functions.renew,
            data=functions.data,
            iterates=self.phase.iterates,
            found_at=self.phase.found_at,
            first=self.parts[0],
            second=self.parts[1],
            centers=np.concatenate([one.center, other.center]),
            radii=np.array([one.radius, other.radius]),
            axes=_across(self.contact.still),
            slots=self.slots,
            gaps=np.array(self.gaps if self.holders is None else [NO_GAP] * self.slots, dtype=np.int64),
            first_gap=self.gaps[0],
            numbers=self.numbers,
            size=self.size,
            number=self.number,
            shared=0 if self.holders is None else len(self.gaps),
            holders=self.holders or 0,
            lacking=lacking,
            memory=memory,
        )
        return record, functions


class FeaturePairs:
    """All pairs of a model with changing features. It holds no state.

    :param features: the place of the numbers of the slots among the inputs.
    `reaches` (parts + 1,) are how far from the origin of each part, and of ground, the centers of its bodies are, in m.

    :param tolerance: the gap in m that counts as zero.
    """

    __repr__ = short_repr

    def __init__(
        self, one_sided: OneSidedEquations, features: int, kernel: Kernel, part_names: Sequence[str], tolerance: float
    ) -> None:
        """:param kernel: which reads the poses of these parts."""
        self._read, self._reads_inputs = kernel.readers["poses"], kernel.reads_inputs["poses"]
        self._count, self.tolerance, self.places = len(part_names), tolerance, 12 * (len(part_names) + 1)
        self._ground = pack_poses(np.zeros((1, 3)), np.eye(3)[None])
        rows = {name: row for row, name in enumerate((*part_names, GROUND))}
        slots: dict[Contact, list[int]] = {}
        for gap in (index for index, gap in enumerate(one_sided.gaps) if gap.numbers is not None):
            contact = one_sided.gaps[gap].contact
            assert contact is not None
            slots.setdefault(contact, []).append(gap)
        self.pairs: list[SlottedPair] = []
        self.pools: dict[int, SlotPool] = {}  # by the first gap of each
        first, holders = features, features + one_sided.layout.feature_count
        for contact, gaps in slots.items():
            known, pool = one_sided.gaps[gaps[0]].numbers, one_sided.gaps[gaps[0]].pool
            assert known is not None
            size = known.shape[0]  # of a slot, the last of whose numbers is its key
            for number, each in enumerate([contact] if pool is None else pool.pairs):
                phase, at = narrow_phase(each), None if pool is None else holders
                parts = rows[each.first.at.part], rows[each.second.at.part]
                self.pairs.append(SlottedPair(each, phase, tuple(gaps), first, size, parts, number, at))
            if pool is not None:
                self.pools[gaps[0]] = pool
                holders += len(gaps)
            first += size * len(gaps)
        self._features, self._holders = slice(features, first), slice(first, holders)
        self.reaches = np.zeros(self._count + 1)
        for pair in self.pairs:
            for part, bounds in zip(pair.parts, pair.phase.bounds, strict=True):
                self.reaches[part] = max(self.reaches[part], math.hypot(*bounds.center))

    def compiled(
        self, failures: list[BaseException], marks: NDArray[np.int64]
    ) -> list[tuple[FeaturePair, PhaseFunctions]]:
        """See `SlottedPair.compiled`.

        :param marks: (1,) becomes 1 where a pool has too few slots.
        """
        lacking = {at: prototype("None", ())(partial(self._lack, at, failures, marks)) for at in self.pools}
        addresses = {at: address_of(function) for at, function in lacking.items()}
        found = [pair.compiled(failures, addresses.get(pair.gaps[0], 0)) for pair in self.pairs]
        return [(record, replace(functions, alive=(functions.alive, lacking))) for record, functions in found]

    def _lack(self, pool: int, failures: list[BaseException], marks: NDArray[np.int64]) -> None:
        failures.append(DivergedError(str(self.pools[pool].lacking)))
        marks[0] = 1

    def _poses(self, time: float, y: Array, inputs: Array) -> Array:
        """The poses (parts + 1, 12) of all parts and of ground."""
        out, moment = np.empty((self._count + 1, 12)), np.array([time])
        given = (y, inputs) if self._reads_inputs else (y,)
        self._read(moment.ctypes.data, *(each.ctypes.data for each in given), out.ctypes.data)
        out[-1:] = self._ground
        return out

    def find_all(self, states: Sequence[tuple[float, Array]], inputs: Array, tolerance: float) -> None:
        """Find the features of all slots at some states with their times, up to gaps of a tolerance in m.

        Those at the first state come first; nothing is kept of what the slots have been.
        """
        inputs[self._features] = 0.0
        inputs[self._holders] = 0.0
        found: dict[int, dict[int, SlotFeatures]] = {}
        for time, y in states:
            poses = self._poses(time, y, inputs)
            for index, pair in enumerate(self.pairs):
                both = pair.poses(poses)
                for each in pair.phase.touching(*both, tolerance) if _are_near(pair, both, tolerance) else ():
                    found.setdefault(index, {}).setdefault(each.key, each)
        used = dict.fromkeys(self.pools, 0)
        for index, features in found.items():
            pair = self.pairs[index]
            for slot, each in zip(range(pair.slots), features.values(), strict=False):
                place = slot
                if pair.holders is not None:
                    place = used[pair.gaps[0]]
                    if place == len(pair.gaps):
                        raise DivergedError(str(self.pools[pair.gaps[0]].lacking))
                    used[pair.gaps[0]] += 1
                    inputs[pair.holders + place] = pair.number
                first = pair.numbers + place * pair.size
                inputs[first : first + pair.size] = each.numbers
                if pair.phase.found_at >= 0:
                    inputs[first + pair.phase.found_at] = 0.0

    def distances(self, time: float, y: Array, inputs: Array) -> dict[int, float]:
        """The distance of two bodies in m, by the index of each of their gaps; for pools that of the nearest pair."""
        poses = self._poses(time, y, inputs)
        own = ((pair, pair.phase.distance(*pair.poses(poses))) for pair in self.pairs if pair.holders is None)
        found = {gap: distance for pair, distance in own for gap in pair.gaps}
        for gaps, pairs in self._pooled.items():
            found |= dict.fromkeys(gaps, _nearest(pairs, poses))
        return found

    @cached_property
    def _pooled(self) -> Mapping[tuple[int, ...], list[SlottedPair]]:
        """The pairs of each pool, by its gaps."""
        found: dict[tuple[int, ...], list[SlottedPair]] = {}
        for pair in self.pairs:
            if pair.holders is not None:
                found.setdefault(pair.gaps, []).append(pair)
        return found

    def are_moved(self, time: float, y: Array, inputs: Array, others: Array) -> bool:
        """Whether parts are elsewhere with other inputs at the same state: live values may move the ends of joints."""
        return not np.array_equal(self._poses(time, y, inputs), self._poses(time, y, others))

    def depths(self, time: float, y: Array, inputs: Array) -> Iterator[tuple[Contact, float]]:
        """The contacts whose bodies penetrate each other at a state, with the depths in m."""
        poses = self._poses(time, y, inputs)
        for pair in self.pairs:
            if (depth := -pair.phase.distance(*pair.poses(poses))) > 0.0:
                yield pair.contact, depth


def _are_near(pair: SlottedPair, poses: tuple[Pose, Pose], tolerance: float) -> bool:
    """Whether the spheres around both bodies overlap, up to a tolerance in m."""
    centers = [
        pose.position + np.sum(pose.rotation * bounds.center, axis=1)
        for pose, bounds in zip(poses, pair.phase.bounds, strict=True)
    ]
    apart = math.dist(*(center.tolist() for center in centers))
    return apart <= sum(bounds.radius for bounds in pair.phase.bounds) + tolerance


def _nearest(pairs: Sequence[SlottedPair], poses: Array) -> float:
    """The least distance of the bodies of some pairs in m; of those whose spheres are apart, that of the spheres."""
    ends = []
    for end in (0, 1):
        rows = poses[[pair.parts[end] for pair in pairs]]
        centers = np.array([pair.phase.bounds[end].center for pair in pairs])
        rotations = rows[:, 3:].reshape(-1, 3, 3)  # each column by column
        ends.append(rows[:, :3] + np.sum(rotations * centers[:, :, None], axis=1))
    radii = np.array([sum(bounds.radius for bounds in pair.phase.bounds) for pair in pairs])
    lines = ends[0] - ends[1]
    apart = np.sqrt(np.sum(lines * lines, axis=1)) - radii
    least = float(np.min(apart[apart > 0.0], initial=np.inf))
    for index in np.flatnonzero(apart <= 0.0).tolist():
        least = min(least, pairs[index].phase.distance(*pairs[index].poses(poses)))
    return least


def _across(still: int | None) -> Array:
    """0 for the axis along which nothing moves, and 1 for the others."""
    return np.array([float(axis != still) for axis in range(3)])
