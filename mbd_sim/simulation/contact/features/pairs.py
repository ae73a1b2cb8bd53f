"""The pairs of bodies that touch with changing features, and the narrow phase of each: see `compiled.pairs`.

A slot has features only while it is closed, and at the instants of events. Whether two bodies meet is known from the
distance that their narrow phase gives, so that the motion does not depend on what was looked at before.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mbd_sim.base.geometry.pose import Array, Pose, pack_poses
from mbd_sim.base.short_repr import short_repr
from mbd_sim.compiler.python.bound_kernel import Kernel
from mbd_sim.dynamics.contact.one_sided_equations import OneSidedEquations
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
from mbd_sim.simulation.contact.compiled.pairs import KNOWN, MEMORY, FeaturePair
from mbd_sim.simulation.contact.features.barrels import BarrelPair
from mbd_sim.simulation.contact.features.clusters import ClusterOnPlane
from mbd_sim.simulation.contact.features.narrow_phase import NarrowPhase, PhaseFunctions, SlotFeatures, functions_of
from mbd_sim.simulation.contact.features.outlines import OutlinePair
from mbd_sim.simulation.contact.features.polytopes import PolytopePair
from mbd_sim.simulation.contact.features.smooth import SmoothPair


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

    `parts` are the rows of the poses of both. A slot has `size` numbers.
    """

    contact: Contact
    phase: NarrowPhase
    gaps: tuple[int, ...]
    numbers: int
    size: int
    parts: tuple[int, int]

    def poses(self, poses: Array) -> tuple[Pose, Pose]:
        """The poses of both parts, from those of all; of pairs in a plane, in this plane."""
        across = _across(self.contact.still)
        one, other = (Pose(row[:3] * across, row[3:].reshape(3, 3).T) for row in (poses[part] for part in self.parts))
        return one, other

    def compiled(self, failures: list[BaseException]) -> tuple[FeaturePair, PhaseFunctions]:
        """The record for compiled code, with its own memory, and the functions that must live as long.

        :param failures: receives what functions in Python raise.
        """
        functions, memory = functions_of(self.phase, len(self.gaps), self.size, failures), np.zeros(MEMORY)
        memory[KNOWN] = -np.inf
        one, other = self.phase.bounds
        record = FeaturePair(
            functions.distance,
            functions.beyond,
            functions.margin,
            functions.touching,
            functions.renew,
            functions.data,
            self.phase.iterates,
            self.phase.found_at,
            self.parts[0],
            self.parts[1],
            np.concatenate([one.center, other.center]),
            np.array([one.radius, other.radius]),
            _across(self.contact.still),
            len(self.gaps),
            np.array(self.gaps, dtype=np.int64),
            self.numbers,
            self.size,
            memory,
        )
        return record, functions


class FeaturePairs:
    """All pairs of a model with changing features. It holds no state.

    :param features: the place of the numbers of the slots among the inputs.
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
        first = features
        for contact, gaps in slots.items():
            known = one_sided.gaps[gaps[0]].numbers
            assert known is not None
            size = known.shape[0]  # of a slot, the last of whose numbers is its key
            parts = rows[contact.first.at.part], rows[contact.second.at.part]
            self.pairs.append(SlottedPair(contact, narrow_phase(contact), tuple(gaps), first, size, parts))
            first += size * len(gaps)
        self._features = slice(features, first)

    def compiled(self, failures: list[BaseException]) -> list[tuple[FeaturePair, PhaseFunctions]]:
        """See `SlottedPair.compiled`."""
        return [pair.compiled(failures) for pair in self.pairs]

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
        found: dict[int, dict[int, SlotFeatures]] = {}
        for time, y in states:
            poses = self._poses(time, y, inputs)
            for index, pair in enumerate(self.pairs):
                both = pair.poses(poses)
                for each in pair.phase.touching(*both, tolerance) if _are_near(pair, both, tolerance) else ():
                    found.setdefault(index, {}).setdefault(each.key, each)
        for index, features in found.items():
            pair = self.pairs[index]
            for slot, each in zip(range(len(pair.gaps)), features.values(), strict=False):
                first = pair.numbers + slot * pair.size
                inputs[first : first + pair.size] = each.numbers
                if pair.phase.found_at >= 0:
                    inputs[first + pair.phase.found_at] = 0.0

    def distances(self, time: float, y: Array, inputs: Array) -> dict[int, float]:
        """The distance of the two bodies in m, by the index of each of their gaps."""
        poses = self._poses(time, y, inputs)
        found = ((pair, pair.phase.distance(*pair.poses(poses))) for pair in self.pairs)
        return {gap: distance for pair, distance in found for gap in pair.gaps}

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


def _across(still: int | None) -> Array:
    """0 for the axis along which nothing moves, and 1 for the others."""
    return np.array([float(axis != still) for axis in range(3)])
