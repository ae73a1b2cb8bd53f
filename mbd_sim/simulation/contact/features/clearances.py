"""Lower bounds of distances, so that bodies that are apart need not be looked at after each step.

A distance changes by no more than points of both bodies move against each other. What was computed at some poses
therefore bounds it at any others, whatever was between them: nothing depends on what is remembered.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.geometry.pose import Array, unpack_poses
from mbd_sim.simulation.contact.features.narrow_phase import Bounds
from mbd_sim.simulation.contact.features.polytopes import dots


class Clearances:
    """The latest distances of pairs of bodies, in m, and the places at which they were computed."""

    def __init__(self, parts: NDArray[np.intp], bounds: list[tuple[Bounds, Bounds]], across: Array) -> None:
        """:param parts: the rows (pairs, 2) of the poses of both bodies.

        :param across: (pairs, 3) 0 for axes along which nothing moves, otherwise 1.
        """
        self._parts, self._across = parts, across
        self._centers = np.array([[each.center for each in both] for both in bounds])
        self._radii = np.array([[each.radius for each in both] for both in bounds])
        self._lines, self._rotations = np.zeros((len(parts), 3)), np.zeros((len(parts), 2, 3, 3))
        self._distances = np.full(len(parts), -np.inf)

    def spheres(self, poses: Array) -> Array:
        """The distances (pairs,) of the spheres around both bodies."""
        line, _ = self._places(poses)
        return np.asarray(np.sqrt(dots(line, line)) - self._radii.sum(axis=1))

    def paths(self, before: Array, after: Array) -> Array:
        """How far (pairs,) points of one body have moved at most against the other, in m, on straight lines."""
        return self._moved(*self._places(before), *self._places(after))

    def at_least(self, poses: Array) -> Array:
        """Lower bounds (pairs,) of the distances at these poses, from the latest ones."""
        return self._distances - self._moved(self._lines, self._rotations, *self._places(poses))

    def note(self, pair: int, poses: Array, distance: float) -> None:
        """Remember the distance of a pair at these poses."""
        lines, rotations = self._places(poses)
        self._lines[pair], self._rotations[pair], self._distances[pair] = lines[pair], rotations[pair], distance

    def _places(self, poses: Array) -> tuple[Array, Array]:
        """The lines (pairs, 3) between the centers, and the rotations (pairs, 2, 3, 3)."""
        positions, rotations = unpack_poses(poses)
        own = rotations[self._parts]
        x, y, z = (self._centers[..., i : i + 1] for i in range(3))
        centers = positions[self._parts] + x * own[..., 0] + y * own[..., 1] + z * own[..., 2]
        return (centers[:, 0] - centers[:, 1]) * self._across, own

    def _moved(self, line: Array, rotations: Array, other_line: Array, other_rotations: Array) -> Array:
        change, turned = other_line - line, other_rotations - rotations
        squares = dots(turned, turned)
        turning = np.sqrt(squares[..., 0] + squares[..., 1] + squares[..., 2])
        at_ends = np.where(turning > 0.0, self._radii, 0.0) * turning  # a plane is infinite, but may not turn
        return np.asarray(np.sqrt(dots(change, change)) + at_ends[:, 0] + at_ends[:, 1])
