"""The gap of a slot between two convex bodies of which one is round, with corners, sides and faces that change.

With corners c, whose support functions are c·n + √(n·K n) (a point has K = 0, a rim ρ² (1 - a aᵀ), an ellipsoid
A D² Aᵀ), the gap along a unit normal n, which points from the second body to the first, is

    g(n) = n·(c_A - c_B) - √(n·K_A n) - √(n·K_B n) - r_A - r_B.

The normal of a face is fixed in its part. Two sides, with n·d_B = k_B and -n·d_A = k_A, determine it in closed form.
Otherwise g(n) is the largest of those normals that a side admits, or of all. That of a rounded point and a rim, a tip
or a side is in closed form as well; others are found by Newton steps from a hint among the numbers, which is renewed
after each step. Of a rim and a rounded edge, another rim, a round side or an ellipsoid, the direction from the center
of the rim is found so in place of the normal: see `rows.normal_searches`. The rate is the velocity along the normal of
the points that touch. A slot without features has zeros only; its gap is then the natural length.

The numbers of a slot are c_A and c_B (6) from the points at which the bodies are attached, in the axes of their parts;
the directions d of sides (6), zero for other features; the radii in m of circles (2), 1 for an ellipsoid and 0 for a
point; the cosines k (2); 1 for the way in which the normal is found, and 0 for the other three (4); which of two
normals two sides have, 1 or -1; 1 if the contact point is on the corner of the second body, and 0 if it is on that of
the first one, or where both sides cross; the normal or direction (3) in the axes of the second part, or of the first
one if it is fixed there; a direction across it (3) in the second part; the radii (2) of round ends that can be bent,
see below; 1 where a sharp edge crosses a rim; the normal (3) of the face on which an end lies, in the axes of the end,
when the narrow phase saw it last; the height in m at which a feature was found beneath an end that can be bent, see
below, or 0; and the key, by which the narrow phase knows what touches; 0 is not a key. Of an end that can be bent, the
normal of the face in the axes of its part is in place of the direction of a side; that of a line in such an end is
in place of the normal, in the axes of the end.

Where an edge p + s d crosses a rim with the radius ρ around c, seen along the axis a of this end, its normal is that of
the edge and the tangent of the rim. With r, the part of p + s d - c across a,

    |r| = ρ,   n = ± (a × r) × d / |(a × r) × d|,   g = (a·(p + s d - c) - b) n·a;

n has the sign opposite to that of the root s. The normal among the numbers is a then, in the part of the end.

A round end that lies nearly flat on a face rests on points that are fixed in its rim, on corners of the face, and where
edges of the face cross the rim; the lowest point of the rim, which runs around it ever faster, does not count below
`EXACT_TILT`. So that it is not below the face when it counts again, the end is bent toward the face. With the part t of
the normal of the face across the axis, and with the place x of what touches, from the center of the end, it is by

    b = B ρ w⁴ / (t·t + t₁²) (1 - t·t / t₀²)³,   w = max(0, -t·x / ρ),

and not bent if |t| > t₀, which is `FLAT_TILT`; t₁ is `LEVEL_TILT`. What takes the place of another one is at the same
place x, so that nothing jumps; and an end that tips over an edge is not bent there. At a crossing b is times
(1 - m²)³, where m is the sine of the tilt of n against the axis over `UNBENT`.

The arc of a rim between two of the fixed points is lower than these: up to 0.13 ρ |t|. An edge or a corner of the face
that arrives under an arc, or is found there as a point leaves the face, is therefore within the end already. It keeps
the height at which it was found: its gap begins at zero, and it does no work. It is closed as long as it bears, while
the end cannot sink deeper; as the end comes to lie flat, it opens, and touches at zero when it is found again. An edge
bears there a line that is fixed in the end: across the edge, through the place where this crossed the rim when it was
found. Its row is that of both as two sides, so that no force is along the edge. Once the crossing has run on from there
by a quarter of half of the chord, it is found again. Along n, which is steep while the chord is short, the edge would
strike the rim from the side; and since the crossing runs ever faster as the chord vanishes, one that keeps its height
would throw a tilted end up.

What rows do not use is known to the narrow phase alone: of a crossing, half of its last chord, or of the chord when its
edge was found within the end, among the cosines; of a rim on a face, the last direction from its center to the point
that touches, among the directions of sides; of two sides, the last place in the second part where they crossed, in
place of the normal.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca

from mbd_sim.dynamics.contact.rows.normal_searches import (
    TINY,
    EllipsoidAtRim,
    NormalSearch,
    RevolvedAtRim,
    RimSearch,
    RoundedSearch,
    farthest,
    unit,
)
from mbd_sim.dynamics.contact.shapes import BEND, FLAT_TILT, LEVEL_TILT, UNBENT, Touch
from mbd_sim.dynamics.kinematics.poses import SymbolicPose
from mbd_sim.dynamics.math.spatial import constant
from mbd_sim.mechanism.elements.contacts import Barrel, ConeBody, ContactBody, EllipsoidBody, Solid

SMOOTH_SIZE = 36  # numbers of a slot, of which the last one is the key
FOUND_AT = 34  # the number of a slot that is the height at which a feature beneath an end was found
LEAST = 1e-8  # of the radius of a rim, half of a chord below which this counts as it
FIXED_SECOND, FIXED_FIRST, TWO_SIDES, ITERATED = range(4)  # how the normal is found


def _root(body: ContactBody, frame: SymbolicPose, rim: ca.SX) -> ca.SX:
    """R of the corner of a body, whose K = Rᵀ R, in ground's axes, from its number among the `rims`."""
    match body:
        case EllipsoidBody():
            axes = ca.sparsify(frame.rotation @ constant(body.axes))
            return rim * (ca.diag(ca.vertcat(*body.radii)) @ axes.T)
        case Barrel() | ConeBody():
            axis = ca.sparsify(frame.rotation @ constant(body.axis))
            return rim * (ca.SX.eye(3) - axis @ axis.T)
        case _:
            return ca.SX(3, 3)


def smooth_touch(
    bodies: tuple[ContactBody, ContactBody],
    numbers: ca.SX,
    frames: tuple[SymbolicPose, SymbolicPose],
    length: float,
) -> Touch:
    """The geometry of a slot; the frames are at the points of both bodies, with the axes of their parts.

    :param length: the gap in m of a slot without features.
    """
    first, second = frames
    radii = [body.radius if isinstance(body, Solid) else 0.0 for body in bodies]
    c_a, c_b, d_a, d_b, hint, side = (numbers[k : k + 3] for k in (0, 3, 6, 9, 22, 25))
    k_a, k_b, on_b, on_a, two, free, sign, on_second = (numbers[k] for k in range(14, 22))
    at, other = first.position + first.rotation @ c_a, second.position + second.rotation @ c_b
    line, side = at - other, second.rotation @ side
    d_a, d_b = first.rotation @ d_a, second.rotation @ d_b
    end = _end_of_crossing(bodies)
    crossed = numbers[30] if end is not None else ca.SX(1, 1)
    beneath = ca.SX(1, 1)
    if end is not None:  # the direction of a line in this end is among the numbers in place of the normal
        beneath = two * (numbers[28 + end] > 0.0)
        d_a, d_b = _with_line((d_a, d_b), end, beneath, frames[end].rotation @ hint)
        k_a, k_b = (1.0 - beneath) * k_a, (1.0 - beneath) * k_b
    roots = [
        _root(body, frame, (1.0 - crossed) * numbers[12 + k])
        for k, (body, frame) in enumerate(zip(bodies, frames, strict=True))
    ]
    fixed = on_b * (second.rotation @ hint) + on_a * (first.rotation @ hint)
    fixed += two * _across_both(d_a, d_b, k_a, k_b, sign, 1.0 - two)
    crossing = None
    if end is not None:
        axis, edge = frames[end].rotation @ hint, (d_b, d_a)[end]
        crossing = _crossing(line if end else -line, edge, axis, numbers[12 + end], sign, crossed)
        fixed += crossed * (crossing.normal if end else -crossing.normal)
    normals = NormalSearch(line, roots, free * (d_a + d_b), free * (k_b - k_a), side, free)
    search: NormalSearch | RimSearch | RoundedSearch = normals
    if (rim := _rim(bodies)) is not None:
        search = _rim_search(normals, bodies, frames, rim, numbers)
    if (rounded := _rounded(bodies)) is not None:
        axis, radius = _axis(bodies[1 - rounded], frames[1 - rounded]), numbers[13 - rounded]
        sides = free * (d_a, d_b)[rounded], free * (d_b, d_a)[rounded]
        search = RoundedSearch(line, *sides, free * (k_b - k_a), axis, radius, free)
    iterated, normal, toward = search.found(fixed, second.rotation @ hint)
    arms = [farthest(root, direction)[0] for root, direction in zip(roots, toward, strict=True)]
    distance = ca.dot(normal, line) - ca.dot(normal, arms[0]) - ca.dot(normal, arms[1]) - sum(radii)
    used = on_b + on_a + two + free + crossed
    place, seen = at - arms[0] - radii[0] * normal, other + arms[1] + radii[1] * normal
    along = ca.SX(3, 1)
    if crossing is not None:
        along = crossed * (crossing.along * edge + ((other - at) if not end else ca.SX(3, 1)))
        distance -= crossed * ca.dot(normal, crossing.arm if end else -crossing.arm)
    on_other = on_second + (beneath if end else 0.0)
    spot = on_other * other + (1.0 - on_other) * at + along
    lift, cosine = _lift(bodies, frames, numbers, spot, crossing)
    own = place + two * _along(place - seen, d_a, d_b, normal, 1.0 - two) + along
    one = unit(ca.cross(side, normal))
    point = on_second * seen + (1.0 - on_second) * own
    gap = distance - cosine * lift + (1.0 - used) * length
    return Touch(gap, normal, point, (one, ca.cross(normal, one)), iterated, lift, cosine)


def _with_line(sides: tuple[ca.SX, ca.SX], end: int, beneath: ca.SX, line: ca.SX) -> tuple[ca.SX, ca.SX]:
    """The directions of both sides, of which that of the body with an end is a line if an edge is beneath it."""
    first, second = (d + (k == end) * beneath * (line - d) for k, d in enumerate(sides))
    return first, second


@dataclass(frozen=True, eq=False)
class _Crossing:
    """Where an edge crosses a rim: `along` the edge, on the `arm` (3,) of the rim; the `normal` (3,) leaves the end.

    Its `cosine` with the axis is 1 in slots without a crossing.
    """

    along: ca.SX
    arm: ca.SX
    normal: ca.SX
    cosine: ca.SX


def _axis(body: ContactBody, frame: SymbolicPose) -> ca.SX:
    """The axis of a round body."""
    assert isinstance(body, Barrel | ConeBody)
    return ca.sparsify(frame.rotation @ constant(body.axis))


def _rim(bodies: tuple[ContactBody, ContactBody]) -> int | None:
    """Which of two bodies, of which neither is a solid, has rims; the first one if both have."""
    if any(isinstance(body, Solid) for body in bodies):
        return None
    return next((k for k in (0, 1) if isinstance(bodies[k], Barrel | ConeBody)), None)


def _rim_search(
    search: NormalSearch,
    bodies: tuple[ContactBody, ContactBody],
    frames: tuple[SymbolicPose, SymbolicPose],
    rim: int,
    numbers: ca.SX,
) -> RimSearch:
    """The search of a body with rims and of another one, from that of their normals.

    :param rim: that body; of two, the first one, or that which has no side among the `numbers`.
    """
    is_second, body, axis = ca.SX(rim), bodies[1 - rim], _axis(bodies[rim], frames[rim])
    is_bound = search.used * (ca.dot(search.bound, search.bound) > 0.5)
    other: RevolvedAtRim | EllipsoidAtRim
    if isinstance(body, EllipsoidBody):
        used = (search.used - is_bound) * (numbers[12 + rim] > 0.0)
        radius = numbers[12 + rim]
        other = EllipsoidAtRim(ca.sparsify(frames[1 - rim].rotation @ constant(body.axes)), body.radii, used)
    else:
        is_second = is_bound * (ca.dot(numbers[6:9], numbers[6:9]) > 0.5)
        radius, width = (
            one + is_second * (other_one - one)
            for one, other_one in ((numbers[12], numbers[13]), (numbers[13], numbers[12]))
        )
        second = _axis(bodies[1], frames[1])
        used = search.used * (radius > 0.0) * (width > 0.0)
        other = RevolvedAtRim(
            second + is_second * (axis - second), width, is_bound * (numbers[14] + numbers[15]), is_bound
        )
        axis += is_second * (second - axis)
    sign = 1.0 - 2.0 * is_second
    return RimSearch(sign * search.line, axis, radius, sign, other, used, replace(search, used=search.used - used))


def _rounded(bodies: tuple[ContactBody, ContactBody]) -> int | None:
    """Which of two bodies has rounded corners, if the other one has rims."""
    for k in (0, 1):
        body = bodies[k]
        if isinstance(body, Solid) and body.radius != 0.0 and isinstance(bodies[1 - k], Barrel | ConeBody):
            return k
    return None


def _end_of_crossing(bodies: tuple[ContactBody, ContactBody]) -> int | None:
    """Which of two bodies has round ends that sharp edges of the other can cross."""
    for end in (0, 1):
        other = bodies[1 - end]
        if isinstance(bodies[end], Barrel | ConeBody) and isinstance(other, Solid) and other.edges and not other.radius:
            return end
    return None


def _crossing(line: ca.SX, edge: ca.SX, axis: ca.SX, radius: ca.SX, sign: ca.SX, used: ca.SX) -> _Crossing:
    """The crossing of an edge and a rim.

    :param line: from the center of the rim to the start of the edge.
    :param used: 1 if the slot has a crossing, else 0.
    """
    level, flat = edge - axis * ca.dot(axis, edge), line - axis * ca.dot(axis, line)
    square, half = used * ca.dot(level, level) + (1.0 - used), used * ca.dot(level, flat)
    rest = half * half - square * (used * (ca.dot(flat, flat) - radius * radius) - (1.0 - used))
    root = ca.sqrt(ca.fmax(rest, (LEAST * radius) ** 2 + TINY))
    along = (sign * root - half) / square
    arm = flat + along * level
    across = ca.cross(ca.cross(axis, arm), edge)
    normal = -sign * across / ca.sqrt(ca.dot(across, across) + TINY)
    return _Crossing(along, arm, normal, 1.0 + used * (ca.dot(normal, axis) - 1.0))


def _lift(
    bodies: tuple[ContactBody, ContactBody],
    frames: tuple[SymbolicPose, SymbolicPose],
    numbers: ca.SX,
    point: ca.SX,
    crossing: _Crossing | None,
) -> tuple[ca.SX, ca.SX]:
    """How far in m an end is bent at a point, and the cosine of the normal with the direction in which it is."""
    lift, cosine = ca.SX(1, 1), ca.SX(1)
    for k in (0, 1):
        normal = frames[1 - k].rotation @ numbers[6 + 3 * k : 9 + 3 * k]
        lift += _bend(bodies[k], frames[k], normal, point, numbers[28 + k], numbers[31:34])
    if crossing is not None:
        cosine = crossing.cosine
        lift *= ca.fmax(1.0 - (1.0 - cosine * cosine) / UNBENT**2, 0.0) ** 3
    return lift + numbers[FOUND_AT], cosine


def _bend(body: ContactBody, frame: SymbolicPose, normal: ca.SX, point: ca.SX, radius: ca.SX, known: ca.SX) -> ca.SX:
    """How far in m an end with a `radius` is bent at a point toward a face with a normal; 0 without a radius.

    :param known: this normal in the axes of the end's part when the narrow phase saw it last. It says whether the end
        is bent, so that the gap is smooth beyond the tilt at which a step ends for this.
    """
    if not isinstance(body, Barrel | ConeBody):
        return ca.SX(1, 1)
    own = constant(body.axis)
    axis, before = ca.sparsify(frame.rotation @ own), known - own * ca.dot(own, known)
    aside = normal - axis * ca.dot(axis, normal)
    square, low = ca.dot(aside, aside), ca.fmax(-ca.dot(aside, point - frame.position), 0.0) ** 2
    rest = (ca.dot(before, before) < FLAT_TILT**2) * (1.0 - square / FLAT_TILT**2)
    bend: ca.SX = BEND * radius * low * low / (radius**4 * (square + LEVEL_TILT**2) + TINY) * rest**3
    return bend


def _across_both(d_a: ca.SX, d_b: ca.SX, k_a: ca.SX, k_b: ca.SX, sign: ca.SX, unused: ca.SX) -> ca.SX:
    """The unit vector n with n·d_B = k_B and n·d_A = -k_A, on the side `sign` of both."""
    cosine, across = ca.dot(d_a, d_b), ca.cross(d_b, d_a)
    square = ca.dot(across, across) + unused
    alpha, beta = (k_b + k_a * cosine) / square, -(k_a + k_b * cosine) / square
    rest = 1.0 - (alpha * alpha + beta * beta + 2.0 * alpha * beta * cosine)
    return alpha * d_b + beta * d_a + sign * ca.sqrt((rest + unused) / square) * across


def _along(apart: ca.SX, d_a: ca.SX, d_b: ca.SX, normal: ca.SX, unused: ca.SX) -> ca.SX:
    """From a point of the first side to where the lines of both sides cross, seen along the normal."""
    one, other = (unit(d - normal * ca.dot(d, normal)) for d in (d_a, d_b))
    cosine = ca.dot(one, other)
    along = (cosine * ca.dot(other, apart) - ca.dot(one, apart)) / (1.0 - cosine * cosine + unused)
    return along * one
