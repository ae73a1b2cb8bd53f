"""How far the corners, balls and rims of a part are from a plane, and which touch: the narrow phase of clusters.

The gaps are those that slots have, see `cluster_rows`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from mbd_sim.compiler.ir.python_kinds import Array, integers, zeros
from mbd_sim.dynamics.contact.cluster_rows import BALL, RIM
from mbd_sim.dynamics.contact.feature_rows import SLOT_SIZE
from mbd_sim.dynamics.contact.shapes import BULGE, EXACT_TILT, FLAT_TILT
from mbd_sim.simulation.contact.compiled.features.vectors import add, dot, place, spread, subtract, turn, turn_back

FLAT, EXACT = FLAT_TILT * FLAT_TILT, EXACT_TILT * EXACT_TILT
DEEPER = 8.0  # times the tolerance, by which bodies that touch at once may be less deep than the deepest one
KIND, RADIUS, LENGTH, CENTER, AXIS, ARM = 0, 1, 2, 3, 6, 9  # of the numbers of a body, which are those of a slot
SPOT = 7  # the place that `margin` writes, see `SPOT` in `pairs`: the areas of clusters do not shrink


@dataclass(frozen=True)
class ClusterOnFace:
    """The numbers (count, SLOT_SIZE) of the bodies of a cluster, and a plane: its `point` (3,) and `normal` (3,)."""

    count: int
    numbers: Array
    point: Array
    normal: Array
    slots: int


def read_gaps(p: ClusterOnFace, one: Array, other: Array, gaps: Array) -> float:
    """The distances (count,) of the bodies, and the least of them."""
    normal, own, point, away, least = zeros(3), zeros(3), zeros(3), zeros(3), math.inf
    turn(other, p.normal, normal)
    turn_back(one, normal, own)  # in the part's axes, in which the bodies stay where they are
    place(other, p.point, point)
    subtract(one, point, away)
    height = dot(away, normal)
    for i in range(p.count):
        gaps[i] = gap_of(p.numbers[SLOT_SIZE * i :], own, height)
        least = min(least, gaps[i])
    return least


def gap_of(body: Array, normal: Array, height: float) -> float:
    """The distance of a body.

    :param normal: (3,) of the plane, in the axes of the part.
    :param height: of the origin of the part above the plane.
    """
    radius, level = body[RADIUS], dot(body[CENTER:], normal) + height
    if body[KIND] == BALL:
        return level - radius
    slope, square = dot(body[AXIS:], normal), 0.0
    for i in range(3):
        across = normal[i] - body[AXIS + i] * slope
        square += across * across
    if body[KIND] == RIM:
        return level - below(radius, square)
    flat = square / FLAT
    bulge = BULGE * radius * square * (1.0 - flat) / ((1.0 + flat) * (1.0 + flat))
    return level + (body[LENGTH] * slope if slope < 0.0 else 0.0) + radius * dot(body[ARM:], normal) - bulge


def below(radius: float, square: float) -> float:
    """How far the lowest point of a rim is below its center, from the square of the sine of its tilt."""
    if square >= EXACT:
        return radius * square / math.sqrt(square)
    x = square / EXACT
    return radius * EXACT_TILT * (-0.125 + x * (2.25 + x * (-1.625 + x * 0.5)))


def cluster_distance(p: ClusterOnFace, one: Array, other: Array) -> float:
    """See `NarrowPhase`."""
    gaps = zeros(p.count)
    return read_gaps(p, one, other, gaps)


def cluster_touching(p: ClusterOnFace, one: Array, other: Array, tolerance: float, slots: Array) -> int:
    """See `NarrowPhase`; of too many bodies, those that are farthest from each other."""
    gaps, found, chosen, count, slot = zeros(p.count), integers(p.count), integers(p.count), 0, 0
    points, nearest = zeros(3 * p.count), zeros(p.count)
    limit = max(tolerance, read_gaps(p, one, other, gaps) + DEEPER * tolerance)
    for i in range(p.count):
        if gaps[i] <= limit:
            body = p.numbers[SLOT_SIZE * i :]
            add(body[CENTER:], body[RADIUS], body[ARM:], points[3 * count :])
            found[count], chosen[count] = i, 1
            count += 1
    if count > p.slots:
        spread(points, 3, count, p.slots, chosen, nearest)
    for k in range(count):
        if chosen[k]:
            for i in range(SLOT_SIZE):
                slots[SLOT_SIZE * slot + i] = p.numbers[SLOT_SIZE * found[k] + i]
            slot += 1
    return slot


def cluster_margin(p: ClusterOnFace, one: Array, other: Array, numbers: Array, spot: Array) -> float:
    """See `NarrowPhase`: a corner, ball or rim touches a plane for as long as it is not lifted."""
    for i in range(SPOT):
        spot[i] = 0.0
    return math.inf
