"""The convex hull of points in space, a polyhedron with plane polygons as faces (Barber, Dobkin & Huhdanpaa 1996).

The farthest point is added first, so that a hull that is cut short at a number of corners is close to the whole one.
Products are added up one by one rather than by a library, so that the hull is the same on every machine.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array

THIN = 1e-5  # thickness of a hull, relative to its size, below which it counts as flat
TOLERANCES = (1e-10, 1e-9, 1e-8)  # relative to the size: points nearer to a face lie on it; the first that works
BLOCK = 20_000  # points that are compared with all faces at once
FLAT = 10.0  # times the tolerance: triangles with corners nearer to the plane of another one belong to its face

Triangles = NDArray[np.intp]


@dataclass(frozen=True)
class Hull:
    """The numbers of the points that are `corners`, and the `faces` as places in these, counterclockwise from outside.

    `beyond` is how far in m the farthest of the points is outside: 0 unless the number of corners was limited.
    """

    corners: tuple[int, ...]
    faces: tuple[tuple[int, ...], ...]
    beyond: float


def convex_hull(points: Array, most: int) -> Hull:
    """The convex hull of points (n, 3) with at most `most` ≥ 4 corners; known for points that were asked before.

    :raises InputError: the points lie in a plane.
    """
    return _known_hull(np.ascontiguousarray(points, dtype=float).tobytes(), most)


@functools.lru_cache(maxsize=1024)  # each reading of a file builds its contacts several times, with hulls of meshes
def _known_hull(entries: bytes, most: int) -> Hull:
    points = np.frombuffer(entries).reshape(-1, 3)
    size = float(np.max(np.ptp(points, axis=0), initial=0.0))
    first = _tetrahedron(points, THIN * size)
    for tolerance in TOLERANCES:
        try:
            triangles, beyond = _triangles(points, first, tolerance * size, most)
            loops = _polygons(points, triangles, FLAT * tolerance * size)
        except _BrokenLoopError:
            continue
        corners = sorted({corner for loop in loops for corner in loop})
        place = {corner: number for number, corner in enumerate(corners)}
        return Hull(tuple(corners), tuple(tuple(place[corner] for corner in loop) for loop in loops), beyond)
    raise InputError("has no hull that can be computed: its points nearly lie in one another's faces")


def fans(faces: Sequence[Sequence[int]]) -> Triangles:
    """The triangles (k, 3) into which faces are cut from their first corners."""
    cut = [(face[0], face[side], face[side + 1]) for face in faces for side in range(1, len(face) - 1)]
    return np.array(cut, dtype=np.intp).reshape(-1, 3)


def face_normals(corners: Array, faces: Sequence[Sequence[int]]) -> Array:
    """The unit normals (k, 3) of plane faces, which point to where their corners run counterclockwise (Newell)."""
    normals = []
    for face in faces:
        arms = corners[list(face)] - corners[face[0]]
        normal = np.sum(np.cross(arms, np.roll(arms, -1, axis=0)), axis=0)
        normals.append(normal / np.sqrt(_dot(normal, normal)))
    return np.array(normals)


class _BrokenLoopError(ValueError):
    """The border of a region of triangles is not one closed line, because of round-off."""


def _dot(one: Array, other: Array) -> Array:
    return np.asarray(one[..., 0] * other[..., 0] + one[..., 1] * other[..., 1] + one[..., 2] * other[..., 2])


def _last_of_largest(points: Array, heights: Array, tolerance: float) -> int:
    """The number of the highest point; of those that are equally high the last in x, y, z, which is a corner."""
    highest = np.flatnonzero(heights >= heights.max() - tolerance)
    return int(highest[np.lexsort(points[highest].T[::-1])[-1]])


def _tetrahedron(points: Array, thin: float) -> tuple[int, int, int, int]:
    """The numbers of four corners that span a solid, in the order of a right-handed frame.

    :raises InputError: there are none.
    """
    remedy = "Give points that enclose a volume, or use a plate, a rod or a particle."
    if len(points) < 4 or not thin > 0.0:
        raise InputError("needs at least 4 different points", remedy)
    a = int(np.lexsort(points.T[::-1])[0])
    arms = points - points[a]
    b = _last_of_largest(points, _dot(arms, arms), 0.0)
    along = arms[b] / np.sqrt(_dot(arms[b], arms[b]))
    aside = arms - _dot(arms, along)[:, None] * along
    c = _last_of_largest(points, _dot(aside, aside), 0.0)
    width = np.sqrt(_dot(aside[c], aside[c]))
    if not width > thin:
        raise InputError("has all its points on a line", remedy)
    normal = np.cross(along, aside[c] / width)
    heights = _dot(arms, normal)
    d = _last_of_largest(points, np.abs(heights), 0.0)
    if not abs(heights[d]) > thin:
        raise InputError("has all its points in a plane", remedy)
    return (a, b, c, d) if heights[d] > 0.0 else (a, c, b, d)


def _planes(points: Array, triangles: Triangles) -> tuple[Array, Array]:
    """The unit normals (k, 3) that point outward, and the heights (k,) of the planes along them."""
    a, b, c = points[triangles].swapaxes(0, 1)
    normals = np.cross(b - a, c - a)
    normals /= np.sqrt(_dot(normals, normals))[:, None]
    return normals, _dot(normals, a)


def _triangles(points: Array, first: tuple[int, int, int, int], tolerance: float, most: int) -> tuple[Triangles, float]:
    """The triangles (k, 3) of the hull, and how far the farthest point is outside."""
    a, b, c, d = first
    triangles = np.array([[a, c, b], [a, b, d], [b, c, d], [c, a, d]], dtype=np.intp)
    normals, offsets = _planes(points, triangles)
    every = np.arange(len(points))
    outside, count = _Outside.of(points, every[:0], normals, offsets, tolerance), 4
    while True:
        if count == most or not len(outside.points):
            outside = _Outside.of(points, every, normals, offsets, tolerance)
            if count == most or not len(outside.points):
                return triangles, float(outside.heights.max(initial=0.0))
        new = int(outside.points[_last_of_largest(points[outside.points], outside.heights, tolerance)])
        visible, count = _dot(points[new], normals) - offsets > tolerance, count + 1
        ends = _border(triangles[visible])
        added = np.array([[start, stop, new] for start, stop in ends.items()], dtype=np.intp)
        own_normals, own_offsets = _planes(points, added)
        moved = outside.points[visible[outside.above]]
        beside = _Outside.of(points, moved, own_normals, own_offsets, tolerance)
        outside = outside.without(visible).joined(beside, int(np.count_nonzero(~visible)))
        triangles = np.vstack([triangles[~visible], added])
        normals, offsets = np.vstack([normals[~visible], own_normals]), np.append(offsets[~visible], own_offsets)


@dataclass(frozen=True, eq=False)
class _Outside:
    """The numbers of `points` (n,) outside a hull, each with a triangle that it is `above` and its height there in m.

    A point above a triangle that is replaced is above one of the new ones, or inside.
    """

    points: Triangles
    above: Triangles
    heights: Array

    @classmethod
    def of(cls, places: Array, points: Triangles, normals: Array, offsets: Array, tolerance: float) -> _Outside:
        """Those of some points at `places` that are higher than `tolerance` above a plane, with the highest."""
        above, heights = np.zeros(len(points), dtype=np.intp), np.zeros(len(points))
        for first in range(0, len(points), BLOCK):
            block = slice(first, first + BLOCK)
            found = _dot(places[points[block], None], normals) - offsets
            above[block] = np.argmax(found, axis=1)
            heights[block] = np.max(found, axis=1)
        beyond = heights > tolerance
        return cls(points[beyond], above[beyond], heights[beyond])

    def without(self, gone: NDArray[np.bool_]) -> _Outside:
        """Those above other triangles than those that are `gone`; the numbers of the others close up."""
        stays, number = ~gone[self.above], np.cumsum(~gone) - 1
        return _Outside(self.points[stays], number[self.above[stays]], self.heights[stays])

    def joined(self, other: _Outside, first: int) -> _Outside:
        """Both; the triangles of the other one have the numbers from `first` on."""
        return _Outside(
            np.append(self.points, other.points),
            np.append(self.above, other.above + first),
            np.append(self.heights, other.heights),
        )


def _border(triangles: Triangles) -> dict[int, int]:
    """The border of a region of triangles, counterclockwise: where each of its points leads.

    :raises _BrokenLoopError: it is not one closed line.
    """
    edges = [(int(t[side]), int(t[(side + 1) % 3])) for t in triangles for side in range(3)]
    known = set(edges)
    border = [(start, stop) for start, stop in edges if (stop, start) not in known]
    found = dict(border)
    if len(found) != len(border) or len(_loop(found)) != len(border):
        raise _BrokenLoopError
    return found


def _loop(border: dict[int, int]) -> list[int]:
    """The points of a closed line in their order, from the one with the smallest number."""
    loop = [min(border)]
    while (following := border.get(loop[-1], loop[0])) != loop[0] and len(loop) < len(border):
        loop.append(following)
    return loop


def _polygons(points: Array, triangles: Triangles, flat: float) -> list[list[int]]:
    """The corners of each face: of all triangles in one plane. Points along an edge are not corners.

    :raises _BrokenLoopError: the triangles of a plane are not one region.
    """
    normals, offsets = _planes(points, triangles)
    a, b, c = points[triangles].swapaxes(0, 1)
    areas = _dot(np.cross(b - a, c - a), normals)
    left, loops = np.ones(len(triangles), dtype=bool), []
    for seed in np.argsort(-areas, kind="stable"):
        if left[seed]:
            lower = np.min(_dot(points[triangles], normals[seed]) - offsets[seed], axis=1)
            face = left & (lower > -flat) & (_dot(normals, normals[seed]) > 0.0)
            left &= ~face
            loops.append(_loop(_border(triangles[face])))
    faces_at: dict[int, int] = {}
    for corner in (corner for loop in loops for corner in loop):
        faces_at[corner] = faces_at.get(corner, 0) + 1
    return [[corner for corner in loop if faces_at[corner] > 2] for loop in loops]
