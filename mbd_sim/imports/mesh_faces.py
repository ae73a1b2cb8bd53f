"""Planes, cylinders and spheres in a mesh: regions of triangles whose corners lie on one.

Triangles belong together where they meet at a small angle. Programs put the corners of the triangles on the surface, so
that its axis and radius follow from them up to the digits of the file.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.geometry.pose import Array
from mbd_sim.imports.assembly import PartFace, covered_angle

Numbers = NDArray[np.intp]  # of triangles

FLAT = math.radians(0.2)  # between triangles of a plane
SMOOTH = math.radians(31.0)  # between neighboring triangles of a round face
FEWEST = 8  # triangles of a round face
INEXACT = 2e-3  # deviation of corners from a round face, relative to its radius


def faces_of_mesh(triangles: Array) -> tuple[PartFace, ...]:
    """The faces of a closed mesh of triangles (n, 3, 3) in m."""
    edges = triangles[:, 1:] - triangles[:, :1]
    normals = np.cross(edges[:, 0], edges[:, 1])
    areas = np.linalg.norm(normals, axis=1)
    kept = areas > 1e-12 * areas.max()
    triangles, normals = triangles[kept], normals[kept] / areas[kept, None]
    pairs, angles = _neighbors(triangles, normals)
    flat = _regions(len(triangles), pairs[angles <= FLAT])
    smooth = _regions(len(triangles), pairs[angles <= SMOOTH])
    found, in_round = [], np.zeros(len(triangles), dtype=bool)
    for members in _members(smooth):
        if len(members) >= FEWEST and len(np.unique(flat[members])) >= FEWEST // 2:
            face = _cylinder(triangles[members], normals[members]) or _sphere(triangles[members], normals[members])
            if face is not None:
                found.append(face)
                in_round[members] = True
    planes = [members for members in _members(flat) if not in_round[members].any()]
    return (*found, *(_plane(triangles[members], normals[members]) for members in planes))


def _neighbors(triangles: Array, normals: Array) -> tuple[Numbers, Array]:
    """Pairs (k, 2) of triangles with a common edge, and the angles (k,) between them in rad."""
    _, corner = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    corners = corner.reshape(-1, 3)
    starts, ends = corners.ravel(), np.roll(corners, -1, axis=1).ravel()
    keys = np.minimum(starts, ends) * (int(corners.max()) + 1) + np.maximum(starts, ends)
    order = np.argsort(keys, kind="stable")
    same = keys[order][1:] == keys[order][:-1]
    pairs = np.column_stack([order[:-1][same], order[1:][same]]) // 3
    cosines = np.clip(np.sum(normals[pairs[:, 0]] * normals[pairs[:, 1]], axis=1), -1.0, 1.0)
    return pairs, np.arccos(cosines)


def _regions(count: int, pairs: Numbers) -> Numbers:
    """A number (count,) for each triangle, equal for those that pairs connect."""
    labels = np.arange(count)
    while True:
        new = labels.copy()
        np.minimum.at(new, pairs[:, 0], labels[pairs[:, 1]])
        np.minimum.at(new, pairs[:, 1], labels[pairs[:, 0]])
        new = np.minimum(new, new[new])
        if np.array_equal(new, labels):
            return labels
        labels = new


def _members(labels: Numbers) -> Iterator[Numbers]:
    """The triangles of each region."""
    order = np.argsort(labels, kind="stable")
    yield from np.split(order, np.flatnonzero(np.diff(labels[order])) + 1)


def _plane(triangles: Array, normals: Array) -> PartFace:
    normal = normals.mean(axis=0)
    return PartFace("plane", triangles.mean(axis=(0, 1)), normal / np.linalg.norm(normal), 0.0, True, 0.0, triangles)


def _cylinder(triangles: Array, normals: Array) -> PartFace | None:
    """The cylinder whose axis is perpendicular to all normals."""
    axis = np.linalg.svd(normals, full_matrices=False)[2][2]
    if np.max(np.abs(normals @ axis)) > INEXACT:
        return None
    helper = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    x = helper / np.linalg.norm(helper)
    across = np.column_stack([x, np.cross(axis, x)])
    points = triangles.reshape(-1, 3)
    fit = _round_through(points @ across)
    if fit is None:
        return None
    center, radius = fit
    point = across @ center + axis * float((points @ axis).mean())
    radial = triangles.mean(axis=1) - point
    convex = bool(np.sum(radial * normals) > 0.0)
    return PartFace("cylinder", point, axis, radius, convex, covered_angle(triangles, point, axis), triangles)


def _sphere(triangles: Array, normals: Array) -> PartFace | None:
    fit = _round_through(triangles.reshape(-1, 3))
    if fit is None:
        return None
    center, radius = fit
    convex = bool(np.sum((triangles.mean(axis=1) - center) * normals) > 0.0)
    return PartFace("sphere", center, np.zeros(3), radius, convex, 0.0, triangles)


def _round_through(points: Array) -> tuple[Array, float] | None:
    """Center and radius of the circle or the sphere through points (n, 2 or 3); None if they lie on none."""
    middle = points.mean(axis=0)
    moved = points - middle
    size = float(np.abs(moved).max())
    if size == 0.0:
        return None
    rows = np.column_stack([2.0 * moved / size, np.ones(len(moved))])
    solution, _, rank, _ = np.linalg.lstsq(rows, np.sum((moved / size) ** 2, axis=1), rcond=1e-9)
    square = float(solution[-1] + solution[:-1] @ solution[:-1])
    if rank < rows.shape[1] or square <= 0.0:
        return None
    center, radius = size * solution[:-1], size * math.sqrt(square)
    deviation = np.abs(np.linalg.norm(moved - center, axis=1) - radius).max()
    return (middle + center, radius) if deviation <= INEXACT * radius else None
