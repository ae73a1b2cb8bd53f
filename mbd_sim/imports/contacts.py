"""Where two parts of an assembly touch: shafts in holes, balls in sockets, planes on planes, and holes in line.

Faces touch where they are the same surface, seen from both sides, up to a gap, and where they overlap.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.geometry.pose import Array
from mbd_sim.imports.assembly import ImportedPart, PartFace

ANGLE = 1e-3  # rad, up to which axes and normals are parallel
LEAST = 0.1  # of the gap, by which planes must overlap in every direction
EMBRACED = 2.0 * math.pi / 3.0  # rad, of its circumference, by which a hole at least surrounds a shaft
MOST_PAIRS = 4_000_000  # of triangles compared at once

ContactKind = Literal["shaft", "ball", "plane", "holes"]


@dataclass(frozen=True, eq=False)
class FaceContact:
    """Two faces that touch, of the first and of the second part: their middle `point` (3,) and `direction` (3,).

    The direction is that of the axis of a shaft or of holes in line, and the normal of a plane, which leads out of the
    first part; it is zero for a ball. `size` in m is the length along the axis, or the radius of a ball.
    """

    kind: ContactKind
    point: Array
    direction: Array
    radius: float
    size: float
    faces: tuple[int, int]  # by their places in the two parts


@dataclass(frozen=True, eq=False)
class PartSurface:
    """The faces of a part in the frame of the assembly, and their numbers as arrays."""

    faces: Sequence[PartFace]

    @cached_property
    def low(self) -> Array:
        """The lower corner (n, 3) of the box around each face."""
        return np.array([face.triangles.min(axis=(0, 1)) for face in self.faces]).reshape(-1, 3)

    @cached_property
    def high(self) -> Array:
        """The upper corner (n, 3) of the box around each face."""
        return np.array([face.triangles.max(axis=(0, 1)) for face in self.faces]).reshape(-1, 3)

    @cached_property
    def points(self) -> Array:
        """A point (n, 3) of each face."""
        return np.array([face.point for face in self.faces]).reshape(-1, 3)

    @cached_property
    def directions(self) -> Array:
        """The direction (n, 3) of each face."""
        return np.array([face.direction for face in self.faces]).reshape(-1, 3)

    @cached_property
    def radii(self) -> Array:
        """The radius (n,) of each face."""
        return np.array([face.radius for face in self.faces])

    def among(self, kind: str, convex: bool | None = None) -> NDArray[np.bool_]:
        """Whether each face (n,) is of a kind, and is convex or not."""
        return np.array(
            [face.kind == kind and convex in (None, face.convex) for face in self.faces], dtype=bool
        ).reshape(-1)


Mask = NDArray[np.bool_]


def contacts_of(parts: Sequence[ImportedPart], gap: float) -> dict[tuple[int, int], list[FaceContact]]:
    """Where each two parts touch, by their places in the assembly.

    :param gap: the largest distance in m of surfaces that touch, and difference of their radii.
    """
    surfaces = [PartSurface(part.faces()) for part in parts]
    found = {}
    for one, other in _near(surfaces, gap):
        contacts = [
            *_shafts(surfaces[one], surfaces[other], gap),
            *_balls(surfaces[one], surfaces[other], gap),
            *_planes(surfaces[one], surfaces[other], gap),
        ]
        if contacts:
            found[one, other] = contacts
    for pair, contacts in _holes_in_line(surfaces, found, gap):
        found[pair] = [*contacts, *found[pair]]
    return dict(sorted(found.items()))


def _near(surfaces: Sequence[PartSurface], gap: float) -> Iterator[tuple[int, int]]:
    """The pairs of parts whose boxes meet."""
    known = [number for number, surface in enumerate(surfaces) if surface.faces]
    low = {number: surfaces[number].low.min(axis=0) - gap for number in known}
    high = {number: surfaces[number].high.max(axis=0) + gap for number in known}
    for one, other in combinations(known, 2):
        if np.all(low[one] <= high[other]) and np.all(low[other] <= high[one]):
            yield one, other


def _meeting(one: PartSurface, other: PartSurface, gap: float) -> Mask:
    """Whether the boxes of each two faces (n, m) meet."""
    below = np.all(one.low[:, None] - gap <= other.high[None], axis=2)
    above = np.all(other.low[None] - gap <= one.high[:, None], axis=2)
    meeting: Mask = below & above
    return meeting


def _shafts(one: PartSurface, other: PartSurface, gap: float) -> list[FaceContact]:
    """Shafts of either part in holes of the other, each pair of faces; those that are embraced enough."""
    of_shafts = one.among("cylinder", True)[:, None] & other.among("cylinder", False)[None]
    of_holes = one.among("cylinder", False)[:, None] & other.among("cylinder", True)[None]
    possible = (of_shafts | of_holes) & _meeting(one, other, gap) & _coaxial(one, other, gap)
    possible &= np.abs(one.radii[:, None] - other.radii[None]) <= gap
    found = []
    for first, second in np.argwhere(possible):
        hole, shaft = one.faces[first], other.faces[second]
        if hole.convex:
            hole, shaft = shaft, hole
        length, middle = _overlap_along(hole, shaft)
        if length > gap:
            found.append(FaceContact("shaft", middle, hole.direction, hole.radius, length, (int(first), int(second))))
    return [contact for group in by_axis(found, gap) if _is_embraced(group, one, other) for contact in group]


def _coaxial(one: PartSurface, other: PartSurface, gap: float) -> Mask:
    """Whether the axes of each two faces (n, m) coincide where they are."""
    parallel = np.linalg.norm(np.cross(one.directions[:, None], other.directions[None]), axis=2) <= ANGLE
    middle = 0.5 * (one.low + one.high)
    away = middle[:, None] - other.points[None]
    own = middle - one.points
    own = own - np.sum(own * one.directions, axis=1)[:, None] * one.directions  # a half cylinder is not around its axis
    away = away - own[:, None]
    away = away - np.sum(away * other.directions[None], axis=2)[:, :, None] * other.directions[None]
    coaxial: Mask = parallel & (np.linalg.norm(away, axis=2) <= gap)
    return coaxial


def _overlap_along(first: PartFace, second: PartFace) -> tuple[float, Array]:
    """The length that two cylinders share along the axis of the first, and its middle; negative if they are apart."""
    low, high = -math.inf, math.inf
    for face in (first, second):
        along = (face.triangles - first.point) @ first.direction
        low, high = max(low, float(along.min())), min(high, float(along.max()))
    return high - low, first.point + 0.5 * (low + high) * first.direction


def by_axis(contacts: Sequence[FaceContact], gap: float) -> list[list[FaceContact]]:
    """The contacts with an axis in groups of a common one."""
    groups: list[list[FaceContact]] = []
    for contact in contacts:
        for group in groups:
            away = contact.point - group[0].point
            aside = away - (away @ group[0].direction) * group[0].direction
            turned = np.linalg.norm(np.cross(contact.direction, group[0].direction))
            if turned <= ANGLE and np.linalg.norm(aside) <= 2.0 * gap:
                group.append(contact)
                break
        else:
            groups.append([contact])
    return groups


def _is_embraced(group: Sequence[FaceContact], one: PartSurface, other: PartSurface) -> bool:
    """Whether the faces of each side go far enough around their axis; a rounded edge in a fillet does not."""
    first = {contact.faces[0] for contact in group}
    second = {contact.faces[1] for contact in group}
    return all(
        sum(surface.faces[face].turn for face in faces) >= EMBRACED
        for surface, faces in ((one, first), (other, second))
    )


def _balls(one: PartSurface, other: PartSurface, gap: float) -> list[FaceContact]:
    opposite = one.among("sphere", True)[:, None] & other.among("sphere", False)[None]
    opposite |= one.among("sphere", False)[:, None] & other.among("sphere", True)[None]
    possible = opposite & (np.abs(one.radii[:, None] - other.radii[None]) <= gap)
    possible &= np.linalg.norm(one.points[:, None] - other.points[None], axis=2) <= gap
    return [
        FaceContact(
            "ball", one.points[first], np.zeros(3), float(one.radii[first]), float(one.radii[first]), (first, second)
        )
        for first, second in np.argwhere(possible).tolist()
    ]


def _planes(one: PartSurface, other: PartSurface, gap: float) -> list[FaceContact]:
    possible = one.among("plane")[:, None] & other.among("plane")[None] & _meeting(one, other, gap)
    sines = np.linalg.norm(np.cross(one.directions[:, None], other.directions[None]), axis=2)
    possible &= (one.directions @ other.directions.T < 0.0) & (sines <= ANGLE)
    between = 0.5 * (one.low + one.high)[:, None] + 0.5 * (other.low + other.high)[None]
    away = np.einsum("nmi,ni->nm", 0.5 * between - one.points[:, None], one.directions)
    away = 2.0 * np.abs(away)  # the middle of both is half as far from the first plane as the second plane is
    possible &= away <= 2.0 * gap
    found = []
    for first, second in np.argwhere(possible).tolist():
        face, opposite = one.faces[first], other.faces[second]
        distance = abs(float((opposite.triangles.mean(axis=(0, 1)) - face.point) @ face.direction))
        if distance <= gap and (middle := _overlap_in_plane(face, opposite, LEAST * gap)) is not None:
            found.append(FaceContact("plane", middle, face.direction, 0.0, 0.0, (first, second)))
    return found


def _overlap_in_plane(face: PartFace, other: PartFace, least: float) -> Array | None:
    """The middle (3,) of what two planes share; None if they overlap by less than `least`.

    Two triangles overlap if their shadows on the normals of all six sides do.
    """
    normal = face.direction
    helper = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    x = helper / np.linalg.norm(helper)
    axes = np.column_stack([x, np.cross(normal, x)])
    first, second = (face.triangles - face.point) @ axes, (other.triangles - face.point) @ axes
    low, high = second.min(axis=(0, 1)), second.max(axis=(0, 1))
    first = first[np.all(first.min(axis=1) <= high, axis=1) & np.all(first.max(axis=1) >= low, axis=1)]
    low, high = first.min(axis=(0, 1), initial=math.inf), first.max(axis=(0, 1), initial=-math.inf)
    second = second[np.all(second.min(axis=1) <= high, axis=1) & np.all(second.max(axis=1) >= low, axis=1)]
    middles: list[Array] = []
    rows = max(1, MOST_PAIRS // max(len(second), 1))
    for start in range(0, len(first), rows):
        some = first[start : start + rows]
        pairs = np.argwhere(_depths(some, second) > least)
        ours, theirs = some[pairs[:, 0]], second[pairs[:, 1]]
        inner = np.maximum(ours.min(axis=1), theirs.min(axis=1)), np.minimum(ours.max(axis=1), theirs.max(axis=1))
        middles.append(0.5 * (inner[0] + inner[1]))
    shared = np.concatenate(middles) if middles else np.zeros((0, 2))
    if not len(shared):
        return None
    box_middle = 0.5 * (shared.min(axis=0) + shared.max(axis=0))
    middle: Array = face.point + axes @ box_middle
    return middle


def _depths(first: Array, second: Array) -> Array:
    """How far each two triangles (n, 3, 2) and (m, 3, 2) overlap at least, as (n, m); negative if they are apart."""
    depths = np.full((len(first), len(second)), math.inf)
    for triangles, of_first in ((first, True), (second, False)):
        sides = np.roll(triangles, -1, axis=1) - triangles
        lengths = np.linalg.norm(sides, axis=2)
        normals = np.stack([-sides[..., 1], sides[..., 0]], axis=2) / np.maximum(lengths, 1e-300)[..., None]
        for side in range(3):
            normal = normals[:, side]
            own = np.einsum("nki,ni->nk", triangles, normal)
            others = np.einsum("mki,ni->nmk", second if of_first else first, normal)
            depth = np.minimum(
                own.max(axis=1)[:, None] - others.min(axis=2), others.max(axis=2) - own.min(axis=1)[:, None]
            )
            depths = np.minimum(depths, depth if of_first else depth.T)
    return depths


def _holes_in_line(
    surfaces: Sequence[PartSurface], found: dict[tuple[int, int], list[FaceContact]], gap: float
) -> Iterator[tuple[tuple[int, int], list[FaceContact]]]:
    """Holes of parts that touch, on one axis and with one radius, for which the assembly has no shaft."""
    filled: set[tuple[int, int]] = set()
    for (one, other), contacts in found.items():
        for contact in contacts:
            if contact.kind == "shaft":
                filled |= {(one, contact.faces[0]), (other, contact.faces[1])}
    for (one, other), contacts in list(found.items()):
        if not all(contact.kind == "plane" for contact in contacts):
            continue
        first, second = surfaces[one], surfaces[other]
        possible = first.among("cylinder", False)[:, None] & second.among("cylinder", False)[None]
        possible &= _meeting(first, second, gap) & _coaxial(first, second, gap)
        possible &= np.abs(first.radii[:, None] - second.radii[None]) <= gap
        lines = []
        for a, b in np.argwhere(possible).tolist():
            if (one, a) in filled or (other, b) in filled:
                continue
            length, middle = _overlap_along(first.faces[a], second.faces[b])
            if abs(length) <= gap:
                face = first.faces[a]
                lines.append(FaceContact("holes", middle, face.direction, face.radius, face.radius, (a, b)))
        lines = [line for group in by_axis(lines, gap) if _is_embraced(group, first, second) for line in group]
        if lines:
            yield (one, other), lines
