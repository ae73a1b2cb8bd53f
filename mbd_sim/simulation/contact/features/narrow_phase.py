"""What the narrow phase of a pair of bodies has to tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from mbd_sim.base.geometry.pose import Array, Pose


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
