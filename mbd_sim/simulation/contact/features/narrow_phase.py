"""What the narrow phase of a pair of bodies has to tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from mbd_sim.base.geometry.pose import Array, Pose, pack_poses
from mbd_sim.compiler.ir.python_kinds import packed
from mbd_sim.simulation.contact.compiled.library import called


@dataclass(frozen=True, eq=False)
class Bounds:
    """A sphere around a body: its `center` (3,) in the frame of the part, and its `radius` in m."""

    center: Array
    radius: float


class SlotFeatures(Protocol):
    """What touches at a slot."""

    @property
    def key(self) -> int:
        """By which the narrow phase knows the features; not 0."""

    @property
    def numbers(self) -> Array:
        """All numbers (SLOT_SIZE,) of the slot."""


class NarrowPhase(Protocol):
    """The geometry of two bodies from the poses of their parts. It keeps no state: poses and numbers say everything.

    Its results have the same bits on every processor: products and sums of single numbers, no matrix products.
    `bounds` are those of both bodies. `iterates`: rows start an iteration from numbers of closed slots, which are
    renewed after each step.
    """

    iterates: bool
    bounds: tuple[Bounds, Bounds]

    def distance(self, one: Pose, other: Pose) -> float:
        """In m, continuous in both poses, and negative where the bodies penetrate each other.

        Where they are apart, any positive number that is not more than their distance will do.
        """

    def touching(self, one: Pose, other: Pose, tolerance: float) -> Sequence[SlotFeatures]:
        """The features whose gaps are zero up to the tolerance in m, or as negative as the distance; in a fixed order.

        All points that can bear a force: the corners of the area where faces touch. At most as many as there are slots.
        """

    def margin(self, one: Pose, other: Pose, numbers: Array) -> float:
        """How far in m the features of a closed slot, given by its numbers, are from where others take their place.

        It falls through zero where a point leaves its face or edge. Features that `touching` finds have at least minus
        half the tolerance.
        """

    def renewed(self, one: Pose, other: Pose, numbers: Array) -> Array:
        """The numbers of a closed slot after a step, with what its row iterates from; the same ones without any."""


@dataclass(frozen=True, eq=False)
class FoundFeatures:
    """What touches at a slot, see `SlotFeatures`."""

    numbers: Array

    @property
    def key(self) -> int:
        """The last of the numbers."""
        return int(self.numbers[-1])


class CompiledPhase:
    """A narrow phase whose functions are compiled: `polytope_distance` of the kind `polytope`, and so on.

    :param record: of both bodies, for these functions.
    :param slot_size: the numbers of a slot.
    """

    def __init__(
        self, kind: str, record: Any, bounds: tuple[Bounds, Bounds], slots: int, slot_size: int, *, iterates: bool
    ) -> None:
        self.kind, self.bounds, self.iterates = kind, bounds, iterates
        self._record, self.packed = record, packed(record)
        self._sizes = slots, slot_size

    def distance(self, one: Pose, other: Pose) -> float:
        """See `NarrowPhase`."""
        return float(called(f"{self.kind}_distance", self.packed, _packed(one), _packed(other)))

    def touching(self, one: Pose, other: Pose, tolerance: float) -> list[FoundFeatures]:
        """See `NarrowPhase`."""
        slots = np.zeros(self._sizes)
        count = called(f"{self.kind}_touching", self.packed, _packed(one), _packed(other), tolerance, slots)
        return [FoundFeatures(numbers.copy()) for numbers in slots[:count]]

    def margin(self, one: Pose, other: Pose, numbers: Array) -> float:
        """See `NarrowPhase`."""
        return float(called(f"{self.kind}_margin", self.packed, _packed(one), _packed(other), numbers))

    def renewed(self, one: Pose, other: Pose, numbers: Array) -> Array:
        """See `NarrowPhase`."""
        found = numbers.copy()
        if self.iterates:
            called(f"{self.kind}_renew", self.packed, _packed(one), _packed(other), found)
        return found


def _packed(pose: Pose) -> Array:
    return pack_poses(pose.position[None], pose.rotation[None])[0]
