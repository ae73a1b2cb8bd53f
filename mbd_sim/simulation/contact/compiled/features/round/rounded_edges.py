"""A rounded edge at the rim of a round end: the direction from the center of the rim in which they touch.

The normal of both leads from a point c + ρ w of the rim straight to the edge. With the axis a of the rim, a point p and
the direction d of the edge, and the projection P across d, w is where |P (p - c - ρ w)| is least or stationary among
the unit vectors across a:

    (a × w)·v = 0,   v = P (p - c - ρ w),   n = v / |v|.

Seen along the edge, the rim is an ellipse, and n leads from its nearest point to that of the edge. Where the edge comes
to lie on the end, n becomes the axis, near which the support of the rim has a kink and steps from the last normal lead
past the next one; w is smooth there. The edge then lies on two points of the rim, the ends of its chord.

As normals do, the directions that others see lead from the second body to the first one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from mbd_sim.compiler.ir.python_kinds import Array, Integers, zeros
from mbd_sim.simulation.contact.compiled.features.round.bodies import CROSSED, PlacedRound, is_rim
from mbd_sim.simulation.contact.compiled.features.round.crossings import (
    CROSSING,
    FREE,
    GAP,
    HINT,
    MARGIN,
    NORMAL,
    POINT,
    TOWARD,
)
from mbd_sim.simulation.contact.compiled.features.round.normals import (
    CONVERGED,
    CORNER_SIDE,
    EDGE_RIM,
    FIRST,
    ITERATIONS,
    KIND,
    LARGEST_STEP,
    PARALLEL,
    RIM_EDGE,
    SECOND,
    SIDE_CORNER,
    SIGN,
    RoundBodies,
)
from mbd_sim.simulation.contact.compiled.features.vectors import (
    add,
    copy,
    cross,
    divide,
    dot,
    least_axis,
    scale,
    size_of,
    subtract,
)

TRIALS, EXACT = 80, 1e-15  # of the search of the nearest point of an ellipse, and the part of it that is not sought


@dataclass(frozen=True)
class EdgeAtRim:
    """A rounded edge with its `direction` (3,), and a rim with its `axis` (3,) and its `radius[0]`.

    The `line` (3,) leads from the center of the rim to the start of the edge. `sign[0]` is 1 if the edge is of the
    first body, and -1 if it is of the second one.
    """

    direction: Array
    axis: Array
    line: Array
    radius: Array
    sign: Array


def put_edge(m: EdgeAtRim, a: PlacedRound, b: PlacedRound, key: Integers) -> None:
    """Place the edge and the rim of a key."""
    edge, end, side, corner, is_first = a, b, key[FIRST], key[SECOND], key[KIND] in (SIDE_CORNER, EDGE_RIM)
    if not is_first:
        edge, end, side, corner = b, a, key[SECOND], key[FIRST]
    copy(edge.directions[3 * side :], m.direction)
    copy(end.normals, m.axis)
    subtract(edge.corners[3 * edge.hull.ends[2 * side] :], end.corners[3 * corner :], m.line)
    m.radius[0], m.sign[0] = end.hull.rims[corner], 1.0 if is_first else -1.0


def is_at_rim(p: RoundBodies, a: PlacedRound, b: PlacedRound, key: Integers) -> bool:
    """Whether the features of a key are a rounded edge and a rim."""
    if p.radius == 0.0:
        return False
    if key[KIND] in (SIDE_CORNER, EDGE_RIM):
        return not a.hull.ruled[key[FIRST]] and is_rim(b, key[SECOND])
    if key[KIND] in (CORNER_SIDE, RIM_EDGE):
        return not b.hull.ruled[key[SECOND]] and is_rim(a, key[FIRST])
    return False


def nearest_at_rim(a: PlacedRound, b: PlacedRound, key: Integers, toward: Array, normal: Array) -> None:
    """The direction in which a rim is nearest to an edge, and the normal there."""
    m = EdgeAtRim(zeros(3), zeros(3), zeros(3), zeros(1), zeros(1))
    put_edge(m, a, b, key)
    nearest_direction(m, toward)
    follow(m, toward)
    from_rim(m, toward, normal)
    if size_of(normal) > 0.0:
        divide(normal, size_of(normal))
    else:  # the edge passes through the rim, in its plane
        copy(m.axis, normal)


def end_of_chord(a: PlacedRound, b: PlacedRound, key: Integers, toward: Array) -> bool:
    """The direction of the crossing of a key, at one end of the chord; False where there is none."""
    m = EdgeAtRim(zeros(3), zeros(3), zeros(3), zeros(1), zeros(1))
    along = zeros(3)
    put_edge(m, a, b, key)
    nearest_direction(m, toward)
    if key[SIGN] * m.sign[0] * dot(m.direction, toward) < 0.0:  # the other end is nearer
        add(m.direction, -dot(m.axis, m.direction), m.axis, along)
        divide(along, size_of(along))
        add(toward, -2.0 * dot(along, toward), along, toward)
    follow(m, toward)
    return key[SIGN] * m.sign[0] * share_of(m, toward) > CROSSED


def meet_at_rim(p: RoundBodies, a: PlacedRound, b: PlacedRound, key: Integers, start: Array, out: Array) -> None:
    """A rounded edge and a rim that touch near a direction; the margin is only that between the ways to find this."""
    m = EdgeAtRim(zeros(3), zeros(3), zeros(3), zeros(1), zeros(1))
    normal, toward = out[NORMAL:], out[TOWARD:]
    put_edge(m, a, b, key)
    copy(start, toward)
    out[FREE] = follow(m, toward)
    from_rim(m, toward, normal)
    apart = size_of(normal)
    if apart > 0.0:
        divide(normal, apart)
    else:
        copy(m.axis, normal)
    if m.sign[0] > 0.0:
        add(b.corners[3 * key[SECOND] :], m.radius[0], toward, out[POINT:])
    else:
        add(a.corners[3 * key[FIRST] :], -m.radius[0], toward, out[POINT:])
    out[GAP], out[MARGIN] = apart - p.radius, math.inf
    if key[KIND] in (EDGE_RIM, RIM_EDGE):
        share = key[SIGN] * m.sign[0] * share_of(m, toward)
        out[MARGIN] = min(share - CROSSED, CROSSING * share - dot(normal, toward)) * m.radius[0]


def tilt_at_rim(
    a: PlacedRound, b: PlacedRound, key: Integers, normal: Array, toward: Array, limit: float, crossed: float
) -> float:  # fmt: skip
    """How far in m the normal is tilted against the axis of the rim beyond a `limit`, a sine: see `flat_sides.level`.

    :param crossed: the limit for an edge with a chord, of half of this over the radius.
    """
    m = EdgeAtRim(zeros(3), zeros(3), zeros(3), zeros(1), zeros(1))
    put_edge(m, a, b, key)
    share = abs(share_of(m, toward))
    if share > CROSSED:
        limit = crossed * share
    return (dot(normal, toward) - limit) * m.radius[0]


def has_long_chord(a: PlacedRound, b: PlacedRound, key: Integers, toward: Array) -> bool:
    """Whether the edge and the rim of a key have a chord both of whose ends can carry the edge."""
    m = EdgeAtRim(zeros(3), zeros(3), zeros(3), zeros(1), zeros(1))
    put_edge(m, a, b, key)
    return abs(share_of(m, toward)) > CROSSED


def share_of(m: EdgeAtRim, toward: Array) -> float:
    """The part of a direction along the edge, seen along the axis: at an end of a chord, half of it over the radius."""
    rise = dot(m.direction, m.axis)
    level = 1.0 - rise * rise
    return dot(m.direction, toward) / math.sqrt(level) if level > PARALLEL * PARALLEL else 0.0


def from_rim(m: EdgeAtRim, toward: Array, out: Array) -> None:
    """From the point of the second body that touches to that of the first one, without rounding."""
    line = zeros(3)
    add(m.line, -m.sign[0] * m.radius[0], toward, line)
    add(line, -dot(m.direction, line), m.direction, out)
    scale(m.sign[0], out, line)
    copy(line, out)


def follow(m: EdgeAtRim, toward: Array) -> float:
    """Change a direction by Newton's method to that in which both touch; how far a row may iterate it, in rad.

    Near the end of a chord that is short, the steps of a row lead past it from farther away than that.
    """
    tangent, line, firm, step, free = zeros(3), zeros(3), 0.0, 0.0, HINT
    for _ in range(ITERATIONS):
        add(toward, -dot(m.axis, toward), m.axis, toward)
        divide(toward, size_of(toward))
        cross(m.axis, toward, tangent)
        from_rim(m, toward, line)
        across = dot(m.direction, tangent)
        firm = dot(toward, line) + m.radius[0] * (1.0 - across * across)
        step = dot(tangent, line)
        bend = 3.0 * m.radius[0] * abs(across * dot(m.direction, toward))
        free = HINT * min(1.0, max(firm, 0.0) / bend) if bend > 0.0 else HINT
        step = step / firm if firm > abs(step) / LARGEST_STEP else LARGEST_STEP if step > 0.0 else -LARGEST_STEP
        add(toward, step, tangent, toward)
        if abs(step) <= CONVERGED:
            break
    divide(toward, size_of(toward))
    return free


def nearest_direction(m: EdgeAtRim, out: Array) -> None:
    """The direction to the point of the rim that is nearest to the edge, which passes it outside.

    Seen along the edge, the rim is an ellipse: D. Eberly, Distance from a point to an ellipse.
    """
    aside, up, level = zeros(3), zeros(3), zeros(3)
    cross(m.direction, m.axis, aside)
    if not size_of(aside) > PARALLEL:
        least_axis(m.axis, up)
        cross(m.axis, up, aside)
    divide(aside, size_of(aside))
    cross(m.direction, aside, up)
    cross(m.axis, aside, level)
    slope, beside, above = dot(up, level), dot(aside, m.line) / m.radius[0], dot(up, m.line) / m.radius[0]
    share = nearest_share(abs(slope), abs(beside), abs(above))
    rest = math.sqrt(max(0.0, 1.0 - share * share))
    scale(m.sign[0] * (rest if beside >= 0.0 else -rest), aside, out)
    add(out, m.sign[0] * (share if above * slope >= 0.0 else -share), level, out)


def nearest_share(flatness: float, x: float, y: float) -> float:
    """Of the point of an ellipse with the half axes 1 and `flatness` that is nearest to a point, the second part.

    Its parts are those of a unit vector; x and y are not negative.
    """
    p, q, low, high = flatness * y, 1.0 - flatness * flatness, 0.0, 1.0
    if p == 0.0:  # a line: its nearest point, or one of the two that are equally near
        first = min(1.0, x / q) if q > 0.0 else 0.0
        return math.sqrt(1.0 - first * first)
    share = 1.0
    for _ in range(TRIALS):
        first = x * share / (p + q * share)
        excess = share * share + first * first - 1.0
        if excess > 0.0:
            high = share
        else:
            low = share
        share -= excess / (2.0 * (share + first * x * p / ((p + q * share) * (p + q * share))))
        if not low < share < high:
            share = 0.5 * (low + high)
        if high - low <= EXACT * high:
            break
    return share
