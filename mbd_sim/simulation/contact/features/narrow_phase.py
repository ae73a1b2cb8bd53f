"""What the narrow phase of a pair of bodies has to tell."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from mbd_sim.base.geometry.pose import Array, Pose, pack_poses
from mbd_sim.compiler.ir.python_kinds import address_of, packed, prototype
from mbd_sim.simulation.contact.compiled.library import called, library
from mbd_sim.simulation.contact.compiled.pairs import DISTANCE, MARGIN, RENEW, SPOT, TOUCHING


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
    renewed after each step. Number `found_at` of a slot is negative if its features were found within each other, where
    its gap was zero; without such numbers it is -1.
    """

    iterates: bool
    found_at: int
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
        self,
        kind: str,
        record: Any,
        bounds: tuple[Bounds, Bounds],
        slots: int,
        slot_size: int,
        *,
        iterates: bool,
        found_at: int = -1,
    ) -> None:
        self.kind, self.bounds, self.iterates, self.found_at = kind, bounds, iterates, found_at
        self._record, self.packed = record, packed(record)
        self._sizes = slots, slot_size

    def distance(self, one: Pose, other: Pose) -> float:
        """See `NarrowPhase`."""
        return float(called(f"{self.kind}_distance", self.packed, _packed(one), _packed(other)))

    def touching(self, one: Pose, other: Pose, tolerance: float) -> list[FoundFeatures]:
        """See `NarrowPhase`."""
        slots, count = self.found(one, other, tolerance)
        return [FoundFeatures(numbers.copy()) for numbers in slots[:count]]

    def found(self, one: Pose, other: Pose, tolerance: float) -> tuple[Array, int]:
        """The numbers (slots, size) of what touches, and how much that is."""
        slots = np.zeros(self._sizes)
        return slots, called(f"{self.kind}_touching", self.packed, _packed(one), _packed(other), tolerance, slots)

    def margin(self, one: Pose, other: Pose, numbers: Array) -> float:
        """See `NarrowPhase`."""
        return float(called(f"{self.kind}_margin", self.packed, _packed(one), _packed(other), numbers, np.zeros(SPOT)))

    def renewed(self, one: Pose, other: Pose, numbers: Array) -> Array:
        """See `NarrowPhase`."""
        found = numbers.copy()
        if self.iterates:
            called(f"{self.kind}_renew", self.packed, _packed(one), _packed(other), found)
        return found


def _packed(pose: Pose) -> Array:
    return np.asarray(pack_poses(pose.position[None], pose.rotation[None])[0])


@dataclass(frozen=True, eq=False)
class PhaseFunctions:
    """The addresses of the functions of a narrow phase, which are given `data`; `alive` must live as long."""

    distance: int
    beyond: int
    margin: int
    touching: int
    renew: int
    data: int
    alive: object


def functions_of(phase: NarrowPhase, slots: int, size: int, failures: list[BaseException]) -> PhaseFunctions:
    """The distance, margin, touching and renewed features for compiled code.

    :param slots: of the pair, each with `size` numbers.
    :param failures: receives what functions in Python raise; nothing is computed any more after that.
    """
    functions, kinds = _Callbacks(phase, slots, size, failures), (DISTANCE, MARGIN, TOUCHING, RENEW)
    known: dict[str, int] = library().addresses
    addresses, alive, data = list[int](), list[object](), 0
    if isinstance(phase, CompiledPhase):
        data = phase.packed.ctypes.data
    for kind, name in zip(kinds, ("distance", "margin", "touching", "renew"), strict=True):
        if isinstance(phase, CompiledPhase) and getattr(type(phase), name, None) is getattr(CompiledPhase, name, None):
            addresses.append(known.get(f"{phase.kind}_{name}", 0))
        else:
            alive.append(prototype(kind.result, kind.arguments)(getattr(functions, name)))
            addresses.append(address_of(alive[-1]))
    distance, margin, touching, renew = addresses
    beyond = known.get(f"{phase.kind}_beyond", 0) if isinstance(phase, CompiledPhase) else 0
    return PhaseFunctions(distance, beyond, margin, touching, renew, data, (phase, alive))


class _Callbacks:
    """The functions of a narrow phase that is written in Python, with addresses in place of poses and numbers."""

    def __init__(self, phase: NarrowPhase, slots: int, size: int, failures: list[BaseException]) -> None:
        self._phase, self._slots, self._size, self._failures = phase, slots, size, failures

    def distance(self, _: int, one: int, other: int) -> float:
        """See `NarrowPhase`."""
        return self._guarded(lambda: self._phase.distance(_pose(one), _pose(other)))

    def margin(self, _: int, one: int, other: int, numbers: int, spot: int) -> float:
        """See `NarrowPhase`; the `spot` stays without a normal: no areas shrink."""
        return self._guarded(lambda: self._phase.margin(_pose(one), _pose(other), _view(numbers, self._size)))

    def touching(self, _: int, one: int, other: int, tolerance: float, out: int) -> int:
        """See `NarrowPhase`; the numbers of the slots are written."""

        def found() -> int:
            features = self._phase.touching(_pose(one), _pose(other), tolerance)
            for numbers, each in zip(
                _view(out, self._slots * self._size).reshape(-1, self._size), features, strict=False
            ):
                numbers[:] = each.numbers
            return len(features)

        return 0 if math.isnan(count := self._guarded(found)) else int(count)

    def renew(self, _: int, one: int, other: int, numbers: int) -> None:
        """See `NarrowPhase`; the numbers are changed."""

        def renewed() -> float:
            own = _view(numbers, self._size)
            own[:] = self._phase.renewed(_pose(one), _pose(other), own)
            return 0.0

        self._guarded(renewed)

    def _guarded(self, compute: Callable[[], float]) -> float:
        """A result, or NaN from the first failure on."""
        try:
            return math.nan if self._failures else compute()
        except BaseException as error:  # which must not pass through compiled code
            self._failures.append(error)
            return math.nan


def _pose(at: int) -> Pose:
    row = _view(at, 12).copy()
    return Pose(row[:3], row[3:].reshape(3, 3).T)


def _view(at: int, count: int) -> Array:
    """Numbers in memory as an array."""
    return np.frombuffer(memoryview((ctypes.c_double * count).from_address(at)), np.float64)
