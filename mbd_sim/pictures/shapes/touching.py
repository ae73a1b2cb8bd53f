"""The contacts that are closed in one state, as pictures show them: points, forces and normals."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.mechanism.values.source import Location
from mbd_sim.pictures.shapes.extent import Extent
from mbd_sim.pictures.shapes.joints import LONG, LONGEST, pulls

if TYPE_CHECKING:
    from mbd_sim.simulation.model.model import Model
    from mbd_sim.simulation.run.simulation import BaseSimulation

NORMAL = 0.06  # length of the line along a normal, on both sides of its point, relative to the mechanism's size
SHORT = 1e-3  # relative to the mechanism's size; shorter arrows are not drawn
SLIGHTEST = 1e-4  # of the forces that count, relative to the weight of all parts
FITTING = (0.2, 2.0)  # forces, relative to the weight, whose arrows are neither short nor long
USUAL, REMEMBERED = 0.9, 600  # a share of the largest forces of so many pictures


@dataclass(frozen=True, eq=False)
class Touching:
    """Contacts that are closed: their `points` in m, `forces` in N and unit `normals`, all (n, 3), in ground's frame.

    `pushes` (n,): the arrow of the force ends at its point; else, for a rope, it starts there. `of_shapes` (n,): bodies
    touch, which can hide the point.
    """

    points: Array
    forces: Array
    normals: Array
    pushes: Array
    of_shapes: Array

    def in_front(self, extent: Extent) -> Touching:
        """With the points of shapes in front of all parts, see `Extent.in_front`."""
        return replace(self, points=extent.in_front(self.points, self.of_shapes))

    def normal_lines(self, size: float) -> Array:
        """The ends (n, 2, 3) of the lines along the normals, for a mechanism of a `size` in m."""
        return normal_lines(self.points, self.normals, size)

    def arrows(self, size: float, full: float, longest: float = LONGEST) -> Iterator[tuple[Array, Array]]:
        """The ends (3,) of the arrows that are long enough to be seen.

        :param full: the force in N of an arrow of `LONG`; none is longer than `longest`.
        """
        for point, force, pushes in zip(self.points, self.forces, self.pushes.tolist(), strict=True):
            magnitude = float(np.linalg.norm(force))
            length = min(LONG * magnitude / full, longest)
            if length > SHORT:
                along = length * size * force / magnitude
                yield (point - along, point) if pushes else (point, point + along)


class ForceScale:
    """The force in N that an arrow of `LONG` stands for at contacts: `full`.

    This is the weight of all parts. Where springs or motors press harder, or all forces are small, as between the teeth
    of a clock with a heavy pendulum, it is the largest force that most of the last pictures have.
    """

    def __init__(self, weight: float) -> None:
        self.full = self._weight = weight
        self._largest = deque[float](maxlen=REMEMBERED)

    def add(self, forces: Array) -> None:
        """Take the forces (n, 3) of a picture into account."""
        largest = float(np.max(np.linalg.norm(forces, axis=1), initial=0.0))
        if largest > SLIGHTEST * self._weight:
            self._largest.append(largest)
            usual = float(np.quantile(self._largest, USUAL))
            low, high = FITTING
            self.full = self._weight if low * self._weight <= usual <= high * self._weight else usual


_NOWHERE, _NONE = np.zeros((0, 3)), np.zeros(0, dtype=bool)
NONE_TOUCHING = Touching(_NOWHERE, _NOWHERE, _NOWHERE, _NONE, _NONE)


def normal_lines(points: Array, normals: Array, size: float) -> Array:
    """The ends (n, 2, 3) of lines along normals (n, 3) through points (n, 3)."""
    along = NORMAL * size * normals
    return np.stack([points - along, points + along], axis=1)


def of_shapes(placed: Sequence[tuple[Location, int | None]]) -> Array:
    """Which of the contacts (n,) that have a place are those of shapes."""
    return np.array([owner[0] == "contacts" for owner, _ in placed], dtype=bool)


def closed_places(indices: Sequence[int | None], inputs: Array, forces: Array) -> Array:
    """Which contacts (..., n) are closed.

    :param indices: of the inputs (..., m) that are 1 while they are; None for compliant contacts, which are closed
        while they exert forces (..., n, 3).
    """
    known = np.array([-1 if index is None else index for index in indices], dtype=np.int64)
    return np.where(known < 0, forces.any(axis=-1), inputs[..., known] > 0.0)


def touching(model: Model, time: float, y: Array, inputs: Array) -> Touching:
    """The closed contacts of a model in a state."""
    readings = model.contact_readings
    if not readings.placed:
        return NONE_TOUCHING
    places = readings.places(time, y, inputs)
    pushes = np.array([not pulls(model.mechanism, owner) for owner, _ in readings.placed], dtype=bool)
    closed = closed_places([index for _, index in readings.placed], inputs, places[:, 1])
    shapes = of_shapes(readings.placed)
    return Touching(places[closed, 0], places[closed, 1], places[closed, 2], pushes[closed], shapes[closed])


def touching_now(simulation: BaseSimulation) -> Touching:
    """The closed contacts in the present state of a simulation."""
    return touching(simulation.model, simulation.time, simulation.y, simulation.inputs)
