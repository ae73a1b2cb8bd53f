"""A rim that touches another rim, a round side or an ellipsoid: the direction from its center in which they touch.

With the center c, the axis a and the radius ρ of the rim, it is the unit vector w across a at which the line from the
nearest point y of the other one to x = c + ρ w is across the tangent of the rim:

    (a × w)·(x - y) = 0.

Where both meet, the normal is that of both tangents, or that of the side or the ellipsoid at y. It may pass through the
axis, near which the support of the rim has a kink and steps from the last normal lead past the next one; w is smooth
there. Beyond the axis, the end of the rim takes its place.

As normals do, the directions that others see lead from the second body to the first one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from mbd_sim.compiler.ir.python_kinds import Array, Integers, zeros
from mbd_sim.dynamics.contact.shapes import POINTS
from mbd_sim.simulation.contact.compiled.features.round.bodies import (
    LEAST,
    PlacedRound,
    farthest,
    folded,
    is_rim,
    nearest_on_ellipsoid,
)
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
    CORNER_CORNER,
    CORNER_SIDE,
    EDGE_RIM,
    FIRST,
    ITERATIONS,
    KIND,
    LARGEST_STEP,
    RIM_EDGE,
    SECOND,
    SIDE_CORNER,
)
from mbd_sim.simulation.contact.compiled.features.vectors import (
    add,
    copy,
    cross,
    divide,
    dot,
    scale,
    size_of,
    subtract,
    turn,
    turn_back,
)

SAMPLES = 2 * POINTS  # directions around a rim; the search begins where it is nearer to the other one than beside them
IN_PLANES, STARTS = 4, 6  # of two rims: points in both planes, and with those where they cross, seen along their axes
OVERLAP = 1e-6  # of the radius: beyond it there may be several stationary directions, and more starts are tried
SINKING = 8  # steps to where a rim is deepest in a body, which may be too thin for the samples
SLOPE, FIRM, BEND = 0, 1, 2
NUMBERS = 3


@dataclass(frozen=True)
class RimContact:
    """A rim, and what it touches: the corner `opposite` of the other body, a rim or an ellipsoid, or a side.

    The `side` is -1 if it touches a corner; else `opposite` is where the side begins. `center` (3,) is that of the rim
    from that of the corner, and `axis` (3,) its axis.
    """

    rim: PlacedRound
    corner: int
    other: PlacedRound
    opposite: int
    side: int
    center: Array
    axis: Array


@dataclass(frozen=True)
class PointOfRim:
    """A point of the rim in the direction `outward` (3,), with its `tangent` (3,), and the nearest one of the other.

    The `line` (3,) leads from that to this point, and `arm` (3,) from the center of the other one to its point; the
    unit vector `normal` (3,) leads from the other one to the rim. `numbers` are the `SLOPE` along the tangent that is
    zero where both touch, its derivative by the angle, `FIRM`, and about how fast this changes, `BEND`.
    """

    outward: Array
    tangent: Array
    line: Array
    arm: Array
    normal: Array
    numbers: Array


def is_rim_contact(a: PlacedRound, b: PlacedRound, key: Integers) -> bool:
    """Whether the features of a key are two rims, or a rim and a round side or an ellipsoid."""
    if key[KIND] in (SIDE_CORNER, EDGE_RIM):
        return a.hull.ruled[key[FIRST]] != 0 and is_rim(b, key[SECOND])
    if key[KIND] in (CORNER_SIDE, RIM_EDGE):
        return b.hull.ruled[key[SECOND]] != 0 and is_rim(a, key[FIRST])
    if key[KIND] != CORNER_CORNER or not (a.hull.curved[key[FIRST]] and b.hull.curved[key[SECOND]]):
        return False
    return is_rim(a, key[FIRST]) or is_rim(b, key[SECOND])


def nearest_of_rim(a: PlacedRound, b: PlacedRound, key: Integers, toward: Array, normal: Array) -> None:
    """The direction in which a rim touches another one, a side or an ellipsoid, and the normal: the best ones found."""
    rim, other, corner, opposite, sign, side = a, b, key[FIRST], key[SECOND], 1.0, -1
    if key[KIND] in (SIDE_CORNER, EDGE_RIM) or not is_rim(a, key[FIRST]):
        rim, other, corner, opposite, sign = b, a, key[SECOND], key[FIRST], -1.0
    if key[KIND] != CORNER_CORNER:
        side, opposite = opposite, other.hull.ends[2 * opposite]
    m = RimContact(rim, corner, other, opposite, side, zeros(3), zeros(3))
    at = PointOfRim(zeros(3), zeros(3), zeros(3), zeros(3), zeros(3), zeros(NUMBERS))
    best, apart = zeros(1), zeros(SAMPLES)
    place_rim(m)
    best[0] = -math.inf
    for k in range(SAMPLES):
        sample(m, k, at.outward)
        look(m, at)
        apart[k] = size_of(at.line) if touches_rim(m) else dot(at.normal, at.line)
    for k in range(SAMPLES):
        if apart[k] <= min(apart[(k + 1) % SAMPLES], apart[(k + SAMPLES - 1) % SAMPLES]):
            sample(m, k, at.outward)
            keep_better(m, at, best, toward, normal)
    for k in range(STARTS if touches_rim(m) else 0):
        if start_of_rims(m, k, at.outward):
            keep_better(m, at, best, toward, normal)
    for k in range(2 if m.side >= 0 else 0):  # beside each other if the chord is short
        if start_of_side(m, 2 * k - 1, at.tangent, at.outward):
            keep_better(m, at, best, toward, normal)
    for k in range(SAMPLES if best[0] < -OVERLAP * m.rim.hull.rims[m.corner] else 0):
        sample(m, k, at.outward)
        sink(m, at)
        keep_better(m, at, best, toward, normal)
    scale(-sign, toward, at.outward)
    copy(at.outward, toward)
    scale(sign, normal, at.normal)
    copy(at.normal, normal)


def meet_rim(a: PlacedRound, b: PlacedRound, key: Integers, start: Array, out: Array) -> None:
    """A rim that touches another one, a side or an ellipsoid near a direction, with the margin to their ends."""
    rim, other, corner, opposite, sign, side = a, b, key[FIRST], key[SECOND], 1.0, -1
    if key[KIND] in (SIDE_CORNER, EDGE_RIM) or not is_rim(a, key[FIRST]):
        rim, other, corner, opposite, sign = b, a, key[SECOND], key[FIRST], -1.0
    if key[KIND] != CORNER_CORNER:
        side, opposite = opposite, other.hull.ends[2 * opposite]
    m = RimContact(rim, corner, other, opposite, side, zeros(3), zeros(3))
    at = PointOfRim(zeros(3), zeros(3), zeros(3), zeros(3), zeros(3), zeros(NUMBERS))
    radius = rim.hull.rims[corner]
    place_rim(m)
    scale(-sign, start, at.outward)
    follow(m, at)
    scale(sign, at.normal, out[NORMAL:])
    scale(-sign, at.outward, out[TOWARD:])
    out[GAP], out[MARGIN] = dot(at.normal, at.line), -radius * dot(at.normal, at.outward)
    if touches_rim(m):
        out[MARGIN] = min(out[MARGIN], dot(at.normal, at.arm))
    if sign > 0.0 or side >= 0:
        add(rim.corners[3 * corner :], radius, at.outward, out[POINT:])
    else:
        add(other.corners[3 * opposite :], 1.0, at.arm, out[POINT:])
    out[FREE] = HINT
    if at.numbers[BEND] > 0.0:
        out[FREE] = HINT * min(1.0, max(at.numbers[FIRM], 0.0) / at.numbers[BEND])


def touches_rim(m: RimContact) -> bool:
    """Whether the rim touches another one."""
    return m.side < 0 and is_rim(m.other, m.opposite)


def place_rim(m: RimContact) -> None:
    """Place the rim beside the other one."""
    subtract(m.rim.corners[3 * m.corner :], m.other.corners[3 * m.opposite :], m.center)
    copy(m.rim.normals, m.axis)


def sample(m: RimContact, number: int, out: Array) -> None:
    """One of the directions around the rim: to its points, and between those."""
    own, one, other = zeros(3), number // 2, (number + 1) // 2 % POINTS
    add(m.rim.hull.arms[3 * one :], 1.0, m.rim.hull.arms[3 * other :], own)
    divide(own, size_of(own))
    turn(m.rim.pose, own, out)


def start_of_rims(m: RimContact, number: int, out: Array) -> bool:
    """A direction in which two rims may touch: near the axis of one of them, these are close to each other."""
    radius, width = m.rim.hull.rims[m.corner], m.other.hull.rims[m.opposite]
    found, side, other_axis, sign = zeros(3), zeros(3), m.other.normals, 2.0 * (number % 2) - 1.0
    if number < 2:  # where the rim is in the plane of the other one
        return in_plane(m.axis, other_axis, -dot(m.center, other_axis) / radius, sign, out)
    if number < IN_PLANES:  # where the other one is in the plane of the rim
        if not in_plane(other_axis, m.axis, dot(m.center, m.axis) / width, sign, found):
            return False
        scale(width, found, side)
        subtract(side, m.center, found)
    else:
        add(m.axis, 1.0 if dot(m.axis, other_axis) > 0.0 else -1.0, other_axis, side)
        divide(side, size_of(side))
        if not where_circles_cross(m, side, sign, found):
            return False
    add(found, -dot(m.axis, found), m.axis, out)
    if not size_of(out) > 0.0:
        return False
    divide(out, size_of(out))
    return True


def start_of_side(m: RimContact, sign: int, level: Array, out: Array) -> bool:
    """A direction near one of the ends of the chord of a side that is nearly level, and the level part of this side."""
    start, line, side, radius = zeros(3), zeros(3), m.side, m.rim.hull.rims[m.corner]
    above = -1.0 if dot(m.axis, m.center) < 0.0 else 1.0
    farthest(m.other, m.other.hull.ends[2 * side], m.axis, above, start)
    farthest(m.other, m.other.hull.ends[2 * side + 1], m.axis, above, level)
    subtract(level, start, level)
    rise = dot(level, m.axis)
    if abs(rise) > CROSSING * size_of(level):
        return False
    add(level, -rise, m.axis, level)
    divide(level, size_of(level))
    subtract(start, m.rim.corners[3 * m.corner :], line)
    add(line, -dot(m.axis, line), m.axis, line)
    add(line, -dot(level, line), level, line)
    square = radius * radius - dot(line, line)
    if not square > 0.0:
        return False
    add(line, sign * math.sqrt(square), level, out)
    divide(out, size_of(out))
    return True


def in_plane(axis: Array, other: Array, cosine: float, sign: float, out: Array) -> bool:
    """One of the unit vectors across an axis that have a cosine with another axis."""
    aside, level = zeros(3), zeros(3)
    cross(axis, other, aside)
    cross(aside, axis, level)
    square = dot(aside, aside)
    rest = square - cosine * cosine
    if not rest > 0.0:
        return False
    scale(cosine / square, level, out)
    add(out, sign * math.sqrt(rest) / square, aside, out)
    return True


def where_circles_cross(m: RimContact, mean: Array, sign: float, out: Array) -> bool:
    """From the center of the rim to one of the points where both rims cross, as circles in a plane across an axis."""
    level, side = zeros(3), zeros(3)
    narrow, wide = m.rim.hull.rims[m.corner], m.other.hull.rims[m.opposite]
    add(m.center, -dot(mean, m.center), mean, level)
    apart = size_of(level)
    if not abs(wide - narrow) < apart < wide + narrow:
        return False
    cross(mean, level, side)
    along = -0.5 * (apart * apart + narrow * narrow - wide * wide) / (apart * apart)
    scale(along, level, out)
    add(out, sign * math.sqrt(max(0.0, narrow * narrow / (apart * apart) - along * along)), side, out)
    return True


def keep_better(m: RimContact, at: PointOfRim, best: Array, outward: Array, normal: Array) -> None:
    """Let what is found from a point take the place of the best until now, if both are farther apart along it."""
    follow(m, at)
    apart = dot(at.normal, m.center) - spread(m.rim, m.corner, at.normal) - spread(m.other, m.opposite, at.normal)
    if apart > best[0]:
        best[0] = apart
        copy(at.outward, outward)
        copy(at.normal, normal)


def spread(body: PlacedRound, corner: int, normal: Array) -> float:
    """How far in m a corner reaches beyond its center along a normal."""
    own, fold = zeros(3), zeros(3)
    turn_back(body.pose, normal, own)
    return folded(body, corner, own, fold)


def sink(m: RimContact, at: PointOfRim) -> None:
    """Turn the direction to where the rim is nearest to the axis of a side, or deepest in an ellipsoid.

    Along the rim these are minima of a quadratic form x·Q x, which has two at most, however thin the other one is.
    """
    line, bent, twisted, radius = zeros(3), zeros(3), zeros(3), m.rim.hull.rims[m.corner]
    for _ in range(0 if touches_rim(m) else SINKING):
        cross(m.axis, at.outward, at.tangent)
        add(m.center, radius, at.outward, line)
        form(m, line, bent)
        form(m, at.tangent, twisted)
        turn_against(m, at, dot(at.tangent, bent), radius * dot(at.tangent, twisted) - dot(at.outward, bent))


def form(m: RimContact, line: Array, out: Array) -> None:
    """Q x of the squared distance from the axis of a side, or of an ellipsoid."""
    own, arm = zeros(3), zeros(3)
    if m.side >= 0:
        axis = m.other.directions[3 * m.side :]
        add(line, -dot(axis, line), axis, out)
        return
    turn_back(m.other.pose, line, own)
    for i in range(3):
        root = m.other.hull.roots[9 * m.opposite + 3 * i :]
        add(arm, dot(root, own) / (dot(root, root) * dot(root, root)), root, arm)
    turn(m.other.pose, arm, out)


def follow(m: RimContact, at: PointOfRim) -> None:
    """Change the direction by Newton's method to that in which both touch."""
    for _ in range(ITERATIONS):
        look(m, at)
        if abs(turn_against(m, at, at.numbers[SLOPE], at.numbers[FIRM])) <= CONVERGED:
            break
    look(m, at)


def turn_against(m: RimContact, at: PointOfRim, slope: float, firm: float) -> float:
    """Turn the direction by a step of Newton's method against a slope with this derivative; the angle that it takes."""
    step = slope / firm if firm > abs(slope) / LARGEST_STEP else LARGEST_STEP if slope > 0.0 else -LARGEST_STEP
    add(at.outward, -step, at.tangent, at.outward)
    add(at.outward, -dot(m.axis, at.outward), m.axis, at.outward)
    divide(at.outward, size_of(at.outward))
    return step


def look(m: RimContact, at: PointOfRim) -> None:
    """Find all numbers of the point in the direction outward."""
    cross(m.axis, at.outward, at.tangent)
    add(m.center, m.rim.hull.rims[m.corner], at.outward, at.line)
    if m.side >= 0:
        look_at_side(m, at)
    elif is_rim(m.other, m.opposite):
        look_at_rim(m, at)
    else:
        look_at_ellipsoid(m, at)


def look_at_rim(m: RimContact, at: PointOfRim) -> None:
    """Find the nearest point of the other rim."""
    radius, width, axis = m.rim.hull.rims[m.corner], m.other.hull.rims[m.opposite], m.other.normals
    level, tangent = zeros(3), zeros(3)
    add(at.line, -dot(axis, at.line), axis, level)
    size = max(size_of(level), LEAST)
    divide(level, size)
    cross(axis, level, tangent)
    scale(width, level, at.arm)
    add(at.line, -1.0, at.arm, at.line)
    along = dot(at.tangent, tangent)
    at.numbers[SLOPE] = dot(at.tangent, at.line)
    at.numbers[FIRM] = radius * (1.0 - along * along * width / size) - dot(at.outward, at.line)
    turned = abs(dot(at.outward, tangent)) + radius / width * abs(along * dot(at.tangent, level))
    at.numbers[BEND] = 3.0 * radius * abs(along) * turned
    cross(at.tangent, tangent, at.normal)
    if size_of(at.line) > radius * size_of(at.normal):
        copy(at.line, at.normal)
    size = size_of(at.normal)
    if size > 0.0:
        divide(at.normal, size if dot(at.normal, m.center) > 0.0 else -size)
    else:
        copy(m.axis, at.normal)


def look_at_side(m: RimContact, at: PointOfRim) -> None:
    """Find the nearest point of the side of a cylinder or a cone, which is prolonged."""
    radius, axis = m.rim.hull.rims[m.corner], m.other.directions[3 * m.side :]
    level, tangent, cosine = zeros(3), zeros(3), m.other.hull.cosines[m.side]
    sine = math.sqrt(1.0 - cosine * cosine)
    add(at.line, -dot(axis, at.line), axis, level)
    size = max(size_of(level), LEAST)
    divide(level, size)
    cross(axis, level, tangent)
    scale(cosine, axis, at.normal)
    add(at.normal, sine, level, at.normal)
    apart = dot(at.normal, at.line) - sine * m.other.hull.rims[m.opposite]
    add(at.line, -apart, at.normal, at.arm)
    scale(apart, at.normal, at.line)
    along = dot(at.tangent, tangent)
    at.numbers[SLOPE] = dot(at.tangent, at.normal)
    at.numbers[FIRM] = radius * sine * along * along / size - dot(at.outward, at.normal)
    at.numbers[BEND] = 3.0 * radius * sine * abs(along * dot(at.outward, tangent)) / size


def look_at_ellipsoid(m: RimContact, at: PointOfRim) -> None:
    """Find the nearest point of the ellipsoid."""
    radius, roots = m.rim.hull.rims[m.corner], m.other.hull.roots[9 * m.opposite :]
    tangent, outward = zeros(3), zeros(3)
    size = nearest_on_ellipsoid(m.other, m.opposite, at.line, at.arm, at.normal)
    add(at.line, -1.0, at.arm, at.line)
    turn_back(m.other.pose, at.tangent, tangent)
    turn_back(m.other.pose, at.outward, outward)
    bent, twisted = 0.0, 0.0
    for i in range(3):
        square = dot(roots[3 * i :], roots[3 * i :])
        along = dot(roots[3 * i :], tangent) / (square * square * size)
        bent += along * dot(roots[3 * i :], tangent)
        twisted += along * dot(roots[3 * i :], outward)
    at.numbers[SLOPE] = dot(at.tangent, at.normal)
    at.numbers[FIRM] = radius * bent - dot(at.outward, at.normal)
    at.numbers[BEND] = 3.0 * radius * abs(twisted)
