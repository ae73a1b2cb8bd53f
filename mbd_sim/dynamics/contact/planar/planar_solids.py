"""Bodies that move in a plane: prisms touch as their cross-sections do, and outlines the shadows of other bodies.

An outline is endless across its plane, so that a body touches it exactly as the shadow of the body along that direction
does. The shadow of a polytope is a polygon, rounded if the body is; that of a cylinder or a cone is known where its
axis is across the plane or in it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.geometry.rotation import aligning_z
from mbd_sim.base.linear_algebra import product
from mbd_sim.mechanism.elements.contacts import Barrel, ConeBody, Contact, ContactBody, Face, PlanarBody, Solid
from mbd_sim.mechanism.elements.parts import Attachment
from mbd_sim.mechanism.outlines.pieces import Outline, Piece, Point, Round, Straight

ALIGNED = 1e-12  # of the size of a body, by which the ends of a prism may be off its cross-section
MOST_POINTS = 4  # in which two outlines can touch at once
ACROSS = 1e-5  # cosine of the angle between an axis and the plane: the digits that people write
SAME = 1e-9  # of the size, up to which corners are one, or on one line
FAR = 1e6  # m, to the ends of a plane
SMOOTH = 1e-6  # rad, turn of a joint that counts as none


def in_plane(contact: Contact, still: int, places: Mapping[str, float]) -> Contact | None:
    """The contact as one of cross-sections if both solids are prisms along an axis; None if they never meet.

    :param still: the axis of ground along which no part moves, and about which all turn.
    :param places: of the parts along it, in m.
    """
    first, second = contact.first, contact.second
    if isinstance(first, Barrel) and isinstance(second, Barrel):
        upright = min(abs(first.axis[still]), abs(second.axis[still])) > 1.0 - ALIGNED
        return replace(contact, slots=0) if upright else contact  # as circles
    if not isinstance(first, Solid) or not isinstance(second, Solid):
        return contact
    one, other = _cross_section(first, still), _cross_section(second, still)
    if one is None or other is None:
        return contact
    (low, high), (other_low, other_high) = (_ends(solid, still, places) for solid in (first, second))
    overlap = min(high, other_high) - max(low, other_low)
    if overlap < 0.0 and first.radius + second.radius > 0.0:
        return contact
    if overlap < 0.0 or (overlap == 0.0 and low < high and other_low < other_high):
        return None
    slots = min(2, len(one.vertices), len(other.vertices))
    return replace(contact, first=one, second=other, slots=slots, still=still)


def _ends(solid: Solid, still: int, places: Mapping[str, float]) -> tuple[float, float]:
    along = solid.vertices[:, still] + places[solid.at.part]
    return float(along.min()), float(along.max())


def _cross_section(solid: Solid, still: int) -> Solid | None:
    """The cross-section of a prism, counterclockwise about the axis, with its sides as faces; None for other bodies."""
    points = solid.vertices.copy()
    size = float(np.abs(points - points[0]).max())
    low, high = points[:, still].min(), points[:, still].max()
    points[:, still] = 0.0
    corners: list[Array] = []
    ends: list[list[float]] = []
    for vertex, point in zip(solid.vertices, points, strict=True):
        at = [k for k, corner in enumerate(corners) if np.abs(corner - point).max() <= ALIGNED * size]
        if not at:
            corners.append(point)
            ends.append([])
        ends[at[0] if at else -1].append(float(vertex[still]))
    thick = high - low > ALIGNED * size
    if any(min(each) - low > ALIGNED * size or high - max(each) > ALIGNED * size for each in ends):
        return None
    if thick and solid.radius:
        return None
    section = np.array(corners)
    x, y = (section[:, (still + k) % 3] - section[:, (still + k) % 3].mean() for k in (1, 2))
    order = sorted(range(len(section)), key=lambda k: math.atan2(y[k], x[k]))
    count = len(order)
    sides = tuple((k, (k + 1) % count) for k in range(count)) if count > 1 else ()
    return replace(solid, vertices=section[order], faces=sides)


def between_outlines(contact: Contact, rotations: Mapping[str, Array]) -> Contact:
    """A contact with an outline as one of two outlines; others stay as they are.

    :param rotations: (3, 3) of parts and ground, which hold the axis of the outline in the frames of both parts.
    :raises InputError: the shadow of a body is no chain of lines and arcs.
    """
    planar = [body for body in (contact.first, contact.second) if isinstance(body, PlanarBody)]
    if not planar:
        return contact
    axis = product(rotations[planar[0].at.part], planar[0].axes[:, 2])
    first, second = (
        body if isinstance(body, PlanarBody) else _shadow(body, product(rotations[body.at.part].T, axis), name)
        for body, name in zip((contact.first, contact.second), contact.names, strict=True)
    )
    return replace(contact, first=first, second=second, slots=_slots(first, second))


def _shadow(body: ContactBody, axis: Array, name: str) -> PlanarBody:
    """The outline of a body along an axis in the frame of its part."""
    axes = aligning_z(axis)
    match body:
        case Solid(vertices=vertices, radius=radius):
            outline = rounded_polygon(convex_polygon(product(vertices, axes[:, :2])), radius)
        case Barrel() | ConeBody():
            center, along = product(body.at.point, axes[:, :2]), product(body.axis, axes[:, :2])
            if math.hypot(*along) <= ACROSS:
                outline = rounded_polygon([_point(center)], body.radius)
            elif abs(float(product(body.axis, axis))) <= ACROSS:
                half, across = 0.5 * body.length * along, body.radius * np.array([-along[1], along[0]])
                tip = across * (0.0 if isinstance(body, ConeBody) else 1.0)
                corners = [center - half - across, center - half + across, center + half + tip, center + half - tip]
                outline = rounded_polygon(convex_polygon(np.array(corners)), 0.0)
            else:
                message = f"the axis of {name!r} is neither across the plane of the outline nor in it"
                raise InputError(message, "Turn it into the plane, or give it an outline of its own.")
        case Face(at=at, normal=normal):
            if abs(float(product(normal, axis))) > ACROSS:
                message = f"the plane of {name!r} is not across that of the outline"
                raise InputError(message, "Choose another 'normal', or the 'plane' of the outline.")
            axes = np.column_stack([np.cross(normal, axis), normal, axis])
            wall = Outline((Straight((FAR, 0.0), (-FAR, 0.0)),), closed=False)
            return PlanarBody(Attachment(at.part, np.zeros(3)), at.point, axes, wall)
        case _:
            raise ValueError(f"{type(body).__name__} has no shadow")
    return PlanarBody(Attachment(body.at.part, np.zeros(3)), np.zeros(3), axes, outline)


def _point(point: Array) -> Point:
    return float(point[0]), float(point[1])


def convex_polygon(points: Array) -> list[Point]:
    """The corners of the convex hull of points (n, 2), counterclockwise (Andrew 1979)."""
    ordered = sorted(map(_point, points))
    slack = SAME * max(math.dist(ordered[0], other) for other in ordered)
    distinct = [one for k, one in enumerate(ordered) if all(math.dist(one, other) > slack for other in ordered[:k])]

    def chain(run: list[Point]) -> list[Point]:
        kept: list[Point] = []
        for point in run:
            while len(kept) > 1 and _beside(kept[-2], kept[-1], point) <= slack:
                kept.pop()
            kept.append(point)
        return kept[:-1]

    return [*chain(distinct), *chain(distinct[::-1])] or distinct


def _beside(start: Point, middle: Point, end: Point) -> float:
    """How far in m a point is to the right of the line from the one before it to the one after it."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    return (dx * (start[1] - middle[1]) - dy * (start[0] - middle[0])) / math.hypot(dx, dy)


def rounded_polygon(corners: list[Point], radius: float) -> Outline:
    """The outline at a distance of a convex polygon; of one point a circle, of two a slot, both ways."""
    if len(corners) == 1:
        return Outline((Round(corners[0], radius, -math.pi, math.pi),))
    sides = [Straight(one, other) for one, other in zip(corners, [*corners[1:], corners[0]], strict=True)]
    pieces: list[Piece] = []
    for side, following in zip(sides, [*sides[1:], sides[0]], strict=True):
        (nx, ny), (ax, ay), (bx, by) = side.normal, side.start, side.end
        pieces.append(Straight((ax + radius * nx, ay + radius * ny), (bx + radius * nx, by + radius * ny)))
        turn = abs(math.remainder(following.first - side.first, 2.0 * math.pi))
        pieces.append(Round(side.end, radius, side.first, side.first + turn))
    return Outline(tuple(pieces))


def _slots(first: PlanarBody, second: PlanarBody) -> int:
    """In how many points two outlines can touch: a roller in two of a hollow one, others in up to four."""
    outlines = [body.outline for body in (first, second) if not _is_circle(body.outline)]
    if len(outlines) == 2:
        return MOST_POINTS
    return 1 if not outlines or _is_convex(outlines[0]) else 2


def _is_circle(outline: Outline) -> bool:
    return len(outline.pieces) == 1 and isinstance(outline.pieces[0], Round)


def _is_convex(outline: Outline) -> bool:
    turned = sum(piece.last - piece.first for piece in outline.pieces)
    is_convex = all(piece.last >= piece.first for piece in outline.pieces)
    return outline.closed and is_convex and abs(turned - 2.0 * math.pi) < SMOOTH * len(outline.pieces)
