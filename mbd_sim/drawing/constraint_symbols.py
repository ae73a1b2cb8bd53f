"""Constraints on the sheet: planes that wheels roll on, lines, curves and planes that points keep to, cables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from mbd_sim.drawing.gear_symbols import coupling_paths
from mbd_sim.drawing.ground_symbols import hatched_line
from mbd_sim.drawing.load_symbols import point_of
from mbd_sim.drawing.projection import Page
from mbd_sim.drawing.sheet import BACK, FRONT, GRAY, INK, WHITE, SheetPath, left_of
from mbd_sim.drawing.spring_symbols import cable_paths
from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.geometry.rotation import aligning_z, unit_or_zero
from mbd_sim.mechanism.constraints import Coupling, KnifeEdge
from mbd_sim.mechanism.records import GROUND, Attachment, Mechanism

SHEET = (246, 247, 249)
BLADE, THICK = 26.0, 3.4  # pt, half length and half width of an edge
HALF = 0.6  # of a plane or a line, by the size of the mechanism


def constraint_paths(page: Page, mechanism: Mechanism, poses: Mapping[str, Pose], size: float) -> list[SheetPath]:
    """What is to be seen of the constraints, besides rods of constant length, and curves and surfaces."""
    paths: list[SheetPath] = []
    planes: set[tuple[float, ...]] = set()
    for constraint in mechanism.constraints:
        points = getattr(constraint, "points", None)
        if points is not None:
            paths += _cable(page, poses, points)
            continue
        if isinstance(constraint, Coupling):
            paths += coupling_paths(page, mechanism, poses, constraint)
            continue
        if isinstance(constraint, KnifeEdge):
            paths += _blade(page, poses, constraint)
        base = getattr(constraint, "plane", None) or getattr(constraint, "base", None)
        on = getattr(constraint, "center", None) or getattr(constraint, "point", None)
        if not isinstance(base, Attachment) or not isinstance(on, Attachment):
            continue
        normals = _normals(constraint)
        if len(normals):
            turned = normals @ _rotation(poses, base).T
            plane = (*turned[0].round(6), round(float(point_of(poses, base) @ turned[0]) / size, 6))
            if len(normals) == 1 and plane in planes:
                continue
            planes.add(plane)
            paths += _flat(page, point_of(poses, base), point_of(poses, on), turned, size, base.part == GROUND)
    return paths


def _normals(constraint: Any) -> Array:
    """Normals (k, 3) in the frame of the part that carries the constraint."""
    if hasattr(constraint, "normals"):
        return np.atleast_2d(constraint.normals)
    return np.atleast_2d(constraint.normal) if hasattr(constraint, "normal") else np.zeros((0, 3))


def _flat(page: Page, base: Array, on: Array, normals: Array, size: float, grounded: bool) -> list[SheetPath]:
    """A plane (one normal) or a line (two), near the point that keeps to it."""
    foot = on - sum(((on - base) @ normal) * normal for normal in normals)
    if len(normals) == 2:
        along = unit_or_zero(np.cross(normals[0], normals[1]))
        ends = page.project(np.array([foot - HALF * size * along, foot + HALF * size * along]))
        return [SheetPath(ends, edge=GRAY, width=1.4, dash=(7.0, 3.0), layer=BACK, depth=page.depth(foot))]
    normal = unit_or_zero(normals[0])
    if abs(float(normal @ page.view.toward)) < 1e-6:
        along = np.cross(page.view.toward, normal)
        ends = page.project(np.array([foot - HALF * size * along, foot + HALF * size * along]))
        plain = [SheetPath(ends, edge=INK, width=1.4, layer=BACK)]
        return hatched_line(ends[0], ends[1], -page.direction(normal)) if grounded else plain
    if page.view.planar:
        return []
    across = HALF * size * aligning_z(normal)[:, :2]
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) @ across.T
    return [SheetPath(page.project(foot + corners), edge=GRAY, fill=SHEET, width=0.8, closed=True, layer=BACK)]


def _blade(page: Page, poses: Mapping[str, Pose], edge: KnifeEdge) -> list[SheetPath]:
    """A lens along the edge, pointed at both ends."""
    along = page.direction(_rotation(poses, edge.point) @ unit_or_zero(edge.direction))
    half = BLADE * float(np.hypot(*along))
    if half < 2.0 * THICK:
        return []
    turn = np.linspace(0.0, np.pi, 13)
    sides = np.concatenate([np.sin(turn), -np.sin(turn)]) * THICK
    lengths = np.concatenate([-np.cos(turn), np.cos(turn)]) * half
    at = point_of(poses, edge.point)
    points = page.project(at) + np.outer(lengths, unit_or_zero(along)) + np.outer(sides, left_of(along))
    return [SheetPath(points, edge=WHITE, fill=INK, width=0.8, closed=True, layer=FRONT, depth=page.depth(at))]


def _cable(page: Page, poses: Mapping[str, Pose], points: tuple[Attachment, ...]) -> list[SheetPath]:
    line = np.array([point_of(poses, at) for at in points])
    return cable_paths(page, line, page.depth(line.mean(axis=0)))


def _rotation(poses: Mapping[str, Pose], at: Attachment) -> Array:
    return np.eye(3) if at.part == GROUND else poses[at.part].rotation
