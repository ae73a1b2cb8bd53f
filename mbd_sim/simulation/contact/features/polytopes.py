"""Convex polytopes with their faces and edges, for `compiled.features.polytopes`.

All sums are written out: their bits do not depend on the processor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.contact.feature_rows import SLOT_SIZE
from mbd_sim.mechanism.elements.contacts import Solid
from mbd_sim.simulation.contact.compiled.features.polytope_distances import PARALLEL, Polytopes, SharpHull
from mbd_sim.simulation.contact.features.narrow_phase import Bounds, CompiledPhase


class Polytope:
    """A solid with its faces and edges in the frame of its part."""

    def __init__(self, solid: Solid) -> None:
        self.vertices, self.radius = solid.vertices, solid.radius
        self.faces, self.edges = solid.faces, solid.edges
        self.normals = np.array([_normal(self.vertices[list(face)]) for face in solid.faces]).reshape(-1, 3)
        self.offsets = dots(self.normals, self.vertices[[face[0] for face in solid.faces]])
        ends = np.array(self.edges, dtype=int).reshape(-1, 2)
        lines = self.vertices[ends[:, 1]] - self.vertices[ends[:, 0]]
        self.lengths = np.sqrt(dots(lines, lines))
        self.starts, self.directions = self.vertices[ends[:, 0]], lines / self.lengths[:, None]
        self.axes = _without_parallel(self.directions)
        self.center = 0.5 * (self.vertices.max(axis=0) + self.vertices.min(axis=0))
        reach = self.vertices - self.center
        self.reach = float(np.sqrt(dots(reach, reach).max())) + self.radius

    @cached_property
    def borders(self) -> tuple[Array, Array]:
        """Of each face (m, k, 3), the corners, and the directions from its sides into it; the last ones may repeat."""
        most = max(map(len, self.faces))
        corners, inward = np.empty((2, len(self.faces), most, 3))
        for number, (face, normal) in enumerate(zip(self.faces, self.normals, strict=True)):
            loop = [*face, *[face[-1]] * (most - len(face))]
            ends = [*face[1:], *[face[0]] * (most - len(face) + 1)]
            sides = self.vertices[ends] - self.vertices[loop]
            corners[number] = self.vertices[loop]
            inward[number] = cross(normal, sides) / np.sqrt(dots(sides, sides))[:, None]
        return corners, inward

    @cached_property
    def beside_edges(self) -> list[list[Array]]:
        """Of each edge, the directions (3,) from it into the faces that it bounds."""
        found: list[list[Array]] = [[] for _ in self.edges]
        index = {edge: number for number, edge in enumerate(self.edges)}
        for face, inward in zip(self.faces, self.borders[1] if self.faces else (), strict=True):
            for k, vertex in enumerate(face):
                following = face[(k + 1) % len(face)]
                found[index[min(vertex, following), max(vertex, following)]].append(inward[k])
        return found

    @cached_property
    def from_vertices(self) -> list[list[Array]]:
        """Of each vertex, the directions (3,) of the edges that leave it."""
        found: list[list[Array]] = [[] for _ in self.vertices]
        for (one, other), direction in zip(self.edges, self.directions, strict=True):
            found[one].append(direction)
            found[other].append(-direction)
        return found

    @cached_property
    def segments(self) -> tuple[Array, Array, Array]:
        """The starts, directions and lengths of the edges; a point is an edge without a length."""
        if len(self.edges):
            return self.starts, self.directions, self.lengths
        return self.vertices, np.zeros((1, 3)), np.zeros(1)


class Polygon(Polytope):
    """The cross-section of a prism along the axis `still`, counterclockwise about it; its sides are faces."""

    def __init__(self, solid: Solid, still: int) -> None:
        super().__init__(replace(solid, faces=()))
        self.faces, count = solid.faces, len(solid.faces)
        ends = np.array(solid.faces, dtype=int).reshape(-1, 2)
        sides = self.vertices[ends[:, 1]] - self.vertices[ends[:, 0]]
        self._sides = sides / np.sqrt(dots(sides, sides))[:, None]
        self.normals = cross(self._sides, np.broadcast_to(np.eye(3)[still], (count, 3)))
        self.offsets = dots(self.normals, self.vertices[ends[:, 0]])
        self.edges, self.axes = (), np.zeros((0, 3))

    @cached_property
    def borders(self) -> tuple[Array, Array]:
        """See `Polytope`; those of a side are its ends."""
        return self.vertices[np.array(self.faces, dtype=int)], np.stack([self._sides, -self._sides], axis=1)

    @cached_property
    def from_vertices(self) -> list[list[Array]]:
        """See `Polytope`; along the sides."""
        found: list[list[Array]] = [[] for _ in self.vertices]
        for (one, other), side in zip(self.faces, self._sides, strict=True):
            found[one].append(side)
            found[other].append(-side)
        return found

    @cached_property
    def segments(self) -> tuple[Array, Array, Array]:
        """See `Polytope`; the corners."""
        return self.vertices, np.zeros_like(self.vertices), np.zeros(len(self.vertices))


def _without_parallel(directions: Array) -> Array:
    """The first of all directions (n, 3) that are parallel."""
    kept: list[Array] = []
    for direction in directions:
        if all(float(dots(across, across)) > PARALLEL**2 for across in (cross(direction, other) for other in kept)):
            kept.append(direction)
    return np.array(kept).reshape(-1, 3)


def _normal(corners: Array) -> Array:
    """The unit normal (3,) of a loop of corners (n, 3)."""
    across = cross(corners - corners[0], np.roll(corners, -1, axis=0) - corners[0])
    total = across.sum(axis=0)
    return np.asarray(total / np.sqrt(dots(total, total)))


def dots(one: Array, other: Array) -> Array:
    """Dot products along the last axis, of length 3."""
    return np.asarray(one[..., 0] * other[..., 0] + one[..., 1] * other[..., 1] + one[..., 2] * other[..., 2])


def cross(one: Array, other: Array) -> Array:
    """Cross products along the last axis."""
    x, y, z = (one[..., i] for i in range(3))
    a, b, c = (other[..., i] for i in range(3))
    return np.stack([y * c - z * b, z * a - x * c, x * b - y * a], axis=-1)


def turned(rotation: Array, vectors: Array) -> Array:
    """Vectors (..., 3) of a part in ground's axes."""
    x, y, z = (vectors[..., i : i + 1] for i in range(3))
    return np.asarray(x * rotation[:, 0] + y * rotation[:, 1] + z * rotation[:, 2])


class PolytopePair(CompiledPhase):
    """Two polytopes: see `NarrowPhase`."""

    def __init__(self, first: Solid, second: Solid, slots: int, still: int | None) -> None:
        """:param still: the axis of ground across which both are polygons; None in space."""
        bodies = [Polytope(each) if still is None else Polygon(each, still) for each in (first, second)]
        bounds = Bounds(bodies[0].center, bodies[0].reach), Bounds(bodies[1].center, bodies[1].reach)
        radii, is_solid = np.array([first.radius, second.radius]), bool(first.faces or second.faces)
        record = Polytopes(_hull(bodies[0]), _hull(bodies[1]), radii, first.radius + second.radius, is_solid, slots)
        super().__init__("polytope", record, bounds, slots, SLOT_SIZE, iterates=False)


def _hull(body: Polytope) -> SharpHull:
    """The numbers of a polytope for compiled code."""
    corners, inward = body.borders if body.faces else (np.zeros((0, 0, 3)), np.zeros((0, 0, 3)))
    starts, directions, lengths = body.segments
    beside = body.beside_edges if body.edges else []
    return SharpHull(
        len(body.vertices),
        _array(body.vertices),
        len(body.faces),
        _array(body.normals),
        _array(body.offsets),
        np.array([face[0] for face in body.faces], dtype=np.int64),
        corners.shape[1],
        _array(corners),
        _array(inward),
        len(body.edges),
        np.array(body.edges, dtype=np.int64).ravel(),
        _array(body.directions),
        _array(body.lengths),
        len(body.axes),
        _array(body.axes),
        len(starts),
        _array(starts),
        _array(directions),
        _array(lengths),
        _firsts(beside),
        _array([direction for each in beside for direction in each]),
        _firsts(body.from_vertices),
        _array([direction for each in body.from_vertices for direction in each]),
    )


def _array(values: object) -> Array:
    return np.array(values, dtype=float).ravel()


def _firsts(groups: Sequence[Sequence[Array]]) -> NDArray[np.int64]:
    """Where each of several groups begins in a list of all, and where the last one ends."""
    return np.cumsum([0, *map(len, groups)])
