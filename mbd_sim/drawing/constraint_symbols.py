"""Constraints: planes that wheels roll on, lines and planes that guide points, knife edges, cables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import assert_never

import numpy as np

from mbd_sim.drawing.gear_symbols import coupling_paths
from mbd_sim.drawing.ground_symbols import hatched_line
from mbd_sim.drawing.load_symbols import point_of
from mbd_sim.drawing.projection import Page
from mbd_sim.drawing.rope_symbols import rope_paths
from mbd_sim.drawing.sheet import BACK, FRONT, GRAY, INK, WHITE, SheetPath, left_of
from mbd_sim.drawing.spring_symbols import cable_paths
from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.geometry.rotation import aligning_z, unit_or_zero
from mbd_sim.mechanism.constraints import (
    Cable,
    Clutch,
    Constraint,
    Coupling,
    Distance,
    Flat,
    KnifeEdge,
    Rolling,
    Surface,
)
from mbd_sim.mechanism.contacts import Contact, Face
from mbd_sim.mechanism.records import GROUND, Attachment, Mechanism

PLANE = (246, 247, 249)
BLADE_HALF_LENGTH, BLADE_HALF_WIDTH = 26.0, 3.4  # pt
HALF_LENGTH = 0.6  # of a plane or a line, relative to the size of the mechanism


@dataclass(frozen=True, eq=False)
class _Guide:
    """The plane (one normal) or line (two) through `base` on which `point` lies; `normals` are in the base's part.

    `hatched` is -1 for hatching below a plane, where a one-sided point cannot be, 1 for above it, and 0 for none.
    """

    base: Attachment
    point: Attachment
    normals: Array
    hatched: float


def constraint_paths(page: Page, mechanism: Mechanism, poses: Mapping[str, Pose], size: float) -> list[SheetPath]:
    """The symbols of the constraints, except rods of constant length, and curves and surfaces; `size` in m."""
    paths: list[SheetPath] = []
    planes: set[tuple[float, ...]] = set()
    guides: list[_Guide | None] = []
    for constraint in mechanism.constraints:
        paths += _own_symbol(page, mechanism, poses, constraint)
        guides.append(_guide_of(constraint))
    for guide in [*guides, *map(_face_of, mechanism.contacts)]:
        if guide is None:
            continue
        base = point_of(poses, guide.base)
        normals = guide.normals @ _rotation(poses, guide.base).T
        plane = (*normals[0].round(6), round(float(base @ normals[0]) / size, 6))
        if len(normals) == 1 and plane in planes:
            continue
        planes.add(plane)
        paths += _plane_or_line(page, base, point_of(poses, guide.point), normals, size, guide.hatched)
    return paths


def _own_symbol(page: Page, mechanism: Mechanism, poses: Mapping[str, Pose], constraint: Constraint) -> list[SheetPath]:
    match constraint:
        case Cable(points=points, length=length, bound=bound):
            line = np.array([point_of(poses, at) for at in points])
            if bound == "at_most":
                return rope_paths(page, mechanism, line, length)
            return cable_paths(page, line, page.depth(line.mean(axis=0)))
        case Coupling():
            return coupling_paths(page, mechanism, poses, constraint)
        case KnifeEdge():
            return _blade(page, poses, constraint)
        case Flat() | Rolling():
            return []
        case Clutch():
            return []  # between joints, whose symbols show its place
        case Distance() | Surface():
            return []  # drawn by `two_point_paths` and `curve_paths`
        case _:
            assert_never(constraint)


def _guide_of(constraint: Constraint) -> _Guide | None:
    match constraint:
        case Flat(base=base, point=point, normals=normals, bound=bound):
            hatched = 1.0 if bound == "at_most" else -1.0 if bound == "at_least" else _below(base)
            return _Guide(base, point, np.atleast_2d(normals), hatched)
        case Rolling(plane=plane, center=center, normal=normal):
            return _Guide(plane, center, np.atleast_2d(normal), _below(plane))
        case KnifeEdge(plane=plane, point=point, normal=normal):
            return _Guide(plane, point, np.atleast_2d(normal), _below(plane))
        case Distance() | Surface() | Coupling() | Cable() | Clutch():
            return None
        case _:
            assert_never(constraint)


def _face_of(contact: Contact) -> _Guide | None:
    """The plane of a contact; only that of a ground is drawn, since a part has its own shape."""
    face = contact.second
    if not isinstance(face, Face) or face.at.part != GROUND:
        return None
    return _Guide(face.at, contact.first.at, np.atleast_2d(face.normal), -1.0)


def _below(base: Attachment) -> float:
    return -1.0 if base.part == GROUND else 0.0


def _plane_or_line(
    page: Page, base: Array, point: Array, normals: Array, size: float, hatched: float
) -> list[SheetPath]:
    """A plane (one normal) or a line (two), near the `point` (3,) that it guides."""
    foot = point - sum(((point - base) @ normal) * normal for normal in normals)
    if len(normals) == 2:
        along = unit_or_zero(np.cross(normals[0], normals[1]))
        ends = page.project(np.array([foot - HALF_LENGTH * size * along, foot + HALF_LENGTH * size * along]))
        return [SheetPath(ends, edge=GRAY, width=1.4, dash=(7.0, 3.0), layer=BACK, depth=page.depth(foot))]
    normal = unit_or_zero(normals[0])
    if abs(float(normal @ page.view.toward)) < 1e-6:
        along = np.cross(page.view.toward, normal)
        ends = page.project(np.array([foot - HALF_LENGTH * size * along, foot + HALF_LENGTH * size * along]))
        if hatched:
            return hatched_line(ends[0], ends[1], hatched * page.direction(normal))
        return [SheetPath(ends, edge=INK, width=1.4, layer=BACK)]
    if page.view.planar:
        return []
    across = HALF_LENGTH * size * aligning_z(normal)[:, :2]
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) @ across.T
    return [SheetPath(page.project(foot + corners), edge=GRAY, fill=PLANE, width=0.8, closed=True, layer=BACK)]


def _blade(page: Page, poses: Mapping[str, Pose], edge: KnifeEdge) -> list[SheetPath]:
    """A lens along the edge, pointed at both ends."""
    along = page.direction(_rotation(poses, edge.point) @ unit_or_zero(edge.direction))
    half_length = BLADE_HALF_LENGTH * float(np.hypot(*along))
    if half_length < 2.0 * BLADE_HALF_WIDTH:
        return []
    angles = np.linspace(0.0, np.pi, 13)
    sideways = np.concatenate([np.sin(angles), -np.sin(angles)]) * BLADE_HALF_WIDTH
    forward = np.concatenate([-np.cos(angles), np.cos(angles)]) * half_length
    at = point_of(poses, edge.point)
    points = page.project(at) + np.outer(forward, unit_or_zero(along)) + np.outer(sideways, left_of(along))
    return [SheetPath(points, edge=WHITE, fill=INK, width=0.8, closed=True, layer=FRONT, depth=page.depth(at))]


def _rotation(poses: Mapping[str, Pose], at: Attachment) -> Array:
    return np.eye(3) if at.part == GROUND else poses[at.part].rotation
