"""Solids of a mechanism that moves in a plane: prisms across it touch as their cross-sections do."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.mechanism.elements.contacts import Barrel, Contact, Solid

ALIGNED = 1e-12  # of the size of a body, by which the ends of a prism may be off its cross-section


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
