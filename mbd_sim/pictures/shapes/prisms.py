"""Prisms as triangles: the outline of their faces is any polygon that does not cross itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.geometry.pose import Array

Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Prism:
    """A body of a `height` along z with an outline through `corners` in x and y, or without `closed` a wall."""

    corners: tuple[tuple[float, float], ...]
    height: float
    closed: bool = True


def prism_triangles(prism: Prism) -> Array:
    """The surface (n, 3, 3) of a prism, counterclockwise from outside."""
    corners, triangles = prism_mesh(prism)
    return corners[triangles]


def prism_mesh(prism: Prism) -> tuple[Array, Indices]:
    """The corners (n, 3) in m and the triangles (k, 3) of a prism; a wall has only its sides, seen from both."""
    outline, half = np.array(prism.corners), 0.5 * prism.height
    count = len(outline)
    corners = np.vstack([np.column_stack([outline, np.full(count, z)]) for z in (-half, half)])
    here = np.arange(count if prism.closed else count - 1)
    there = (here + 1) % count
    sides = np.vstack(
        [np.column_stack([here, there, there + count]), np.column_stack([here, there + count, here + count])]
    )
    if not prism.closed:
        return corners, np.vstack([sides, sides[:, ::-1]])
    face = polygon_triangles(outline)
    return corners, np.vstack([sides, face[:, ::-1], face + count])


def polygon_triangles(outline: Array) -> Indices:
    """The triangles (n - 2, 3) of a counterclockwise polygon (n, 2), by cutting off one ear after the other."""
    left, found = list(range(len(outline))), []
    while len(left) > 3:
        points = outline[left]
        before, after = np.roll(points, 1, axis=0), np.roll(points, -1, axis=0)
        turns = _cross(points - before, after - points)
        diagonals = np.hypot(*(after - before).T)
        order = [ear for ear in np.argsort(diagonals, kind="stable").tolist() if turns[ear] > 0.0]
        ear = next((ear for ear in order if _is_ear(points, ear)), int(np.argmax(turns)))
        found.append((left[ear - 1], left[ear], left[(ear + 1) % len(left)]))
        del left[ear]
    return np.array([*found, tuple(left)])


def _is_ear(points: Array, ear: int) -> bool:
    """Whether no other corner of a polygon (n, 2) is within the triangle of a corner and its neighbors."""
    a, b, c = points[ear - 1], points[ear], points[(ear + 1) % len(points)]
    others = np.delete(points, [ear - 1 if ear else len(points) - 1, ear, (ear + 1) % len(points)], axis=0)
    inside = [_cross(end - start, others - start) > 0.0 for start, end in ((a, b), (b, c), (c, a))]
    return not np.any(inside[0] & inside[1] & inside[2])


def _cross(one: Array, other: Array) -> Array:
    return np.asarray(one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0])
