"""The rim of a disc that lies flat on a plane: a few of its points carry it, where its lowest point is not defined.

An upright disc touches a plane in the lowest point of its rim. As it falls flat, that point runs around the rim ever
faster. Below a small tilt fixed points of the rim therefore protrude beyond the plane of the disc, so that it rests on
them, and its lowest point is withdrawn. With the tilt s, the sine of the angle between the axis and the normal,
points protrude by `BULGE` r s² (1 - x) / (1 + x)², x = (s / `FLAT_TILT`)²: the gap is exact where the disc lies flat,
and no point touches from `FLAT_TILT` on. Between `EXACT_TILT` and `FLAT_TILT` the lowest point leaves the plane.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import casadi as ca
import numpy as np

from mbd_sim.dynamics.loop_equations import perpendiculars
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.contacts import FIRST_RIM, Contact, Face, Rim, RimPoint

POINTS = 6  # of a rim that carry it; in a plane mechanism the two in its plane
FLAT_TILT = 0.02  # sine of the tilt below which a disc lies flat
EXACT_TILT = 0.5 * FLAT_TILT  # sine of the tilt from which on the lowest point is exact
BULGE = 31.0  # at `EXACT_TILT` the points beside the lowest one are lower than it: 1 - cos(π / 6) = 0.134


def can_lie_flat(rim: Rim | RimPoint, face: Face, still: int | None) -> bool:
    """Whether a rim and a plane can be parallel; not so if the axis remains in the plane, as that of a wheel.

    :param still: the axis of ground, 0, 1 or 2, along which no part moves; None if there is none.
    """
    return still is None or face.normal[still] != 0.0 or abs(rim.axis[still]) != 1.0


def with_rim_points(contact: Contact, still: int | None) -> Iterator[Contact]:
    """A contact, and those of the points that carry it if it is one of a rim that can lie flat.

    :param still: see `can_lie_flat`.
    """
    yield contact
    rim, face = contact.first, contact.second
    if not isinstance(rim, Rim) or not isinstance(face, Face) or not (rim.first and can_lie_flat(rim, face, still)):
        return
    name = contact.quantity.removesuffix(FIRST_RIM)
    for number, direction in enumerate(_directions(rim, face, still), start=1):
        point = RimPoint(rim.at, rim.axis, rim.radius, rim.length, direction)
        yield replace(contact, quantity=f"{name} edge {number}", first=point)


def _directions(rim: Rim, face: Face, still: int | None) -> Array:
    """The directions (n, 3) of the points, in the frame of the part."""
    if still is not None and face.normal[still] == 0.0 and rim.axis[still] == 0.0:
        across = np.cross(rim.axis, np.eye(3)[still])
        return np.array([across, -across])
    angles = [2.0 * math.pi * number / POINTS for number in range(POINTS)]
    return np.array([[math.cos(angle), math.sin(angle)] for angle in angles]) @ perpendiculars(rim.axis)


def protrusion(radius: float, square: ca.SX) -> ca.SX:
    """How far in m the points of a rim protrude, from the square s² of its tilt; negative where it is not flat."""
    x = square / FLAT_TILT**2
    return BULGE * radius * square * (1.0 - x) / (1.0 + x) ** 2


def withdrawn(radius: float, square: ca.SX) -> ca.SX:
    """How far in m the lowest point is below the center at tilts up to `EXACT_TILT`, from s²; negative at s = 0.

    Its value r s at `EXACT_TILT` and its first two derivatives by s are continuous with those of the rim.
    """
    x = square / EXACT_TILT**2
    return radius * EXACT_TILT * (-0.125 + x * (2.25 + x * (-1.625 + x * 0.5)))
