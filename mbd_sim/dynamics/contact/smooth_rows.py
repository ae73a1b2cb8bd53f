"""The gap of a slot between two convex bodies of which one is round, with corners, sides and faces that change.

With corners c, whose support functions are c·n + √(n·K n) (a point has K = 0, a rim ρ² (1 - a aᵀ), an ellipsoid
A D² Aᵀ), the gap along a unit normal n, which points from the second body to the first, is

    g(n) = n·(c_A - c_B) - √(n·K_A n) - √(n·K_B n) - r_A - r_B.

The normal of a face is fixed in its part. Two sides, with n·d_B = k_B and -n·d_A = k_A, determine it in closed form.
Otherwise g(n) is the largest of those normals that a side admits, or of all. That of a rounded point and a rim, a tip
or a side is in closed form as well; others are found by Newton steps from a hint among the numbers, which is renewed
after each step. Of a rim and a rounded edge, another rim or an ellipsoid, the direction from the center of the rim is
found so in place of the normal: see `rounded_edges` and `rims` in `simulation/contact/compiled/features/round`. The rate is the velocity along the normal of
the points that touch. A slot without features has zeros only; its gap is then the natural length.

The numbers of a slot are c_A and c_B (6) from the points at which the bodies are attached, in the axes of their parts;
the directions d of sides (6), zero for other features; the radii in m of circles (2), 1 for an ellipsoid and 0 for a
point; the cosines k (2); 1 for the way in which the normal is found, and 0 for the other three (4); which of two
normals two sides have, 1 or -1; 1 if the contact point is on the corner of the second body, and 0 if it is on that of
the first one, or where both sides cross; the normal or direction (3) in the axes of the second part, or of the first
one if it is fixed there; a direction across it (3) in the second part; the radii (2) of rims that lie flat, of which
points protrude (see `shapes`); 1 where a sharp edge crosses a rim; and the key, by which the narrow phase knows what
touches; 0 is not a key.

Where an edge p + s d crosses a rim with the radius ρ around c, seen along the axis a of this end, its normal is that of
the edge and the tangent of the rim. With r, the part of p + s d - c across a,

    |r| = ρ,   n = ± (a × r) × d / |(a × r) × d|,   g = a·(p + s d - c) n·a;

n has the sign opposite to that of the root s. The normal among the numbers is a then, in the part of the end.

What rows do not use is known to the narrow phase alone: of a crossing, half of its last chord, among the cosines; of a
rim on a face, the last direction from its center to the point that touches, among the directions of sides.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca

from mbd_sim.dynamics.constraints.rows import IteratedNormal
from mbd_sim.dynamics.contact.shapes import Touch, protrusion
from mbd_sim.dynamics.kinematics.poses import SymbolicPose
from mbd_sim.dynamics.math.spatial import constant
from mbd_sim.mechanism.elements.contacts import Barrel, ConeBody, ContactBody, EllipsoidBody, Solid

SMOOTH_SIZE = 32  # numbers of a slot, of which the last one is the key
NEWTON_STEPS = 3
TINY = 1e-60
FEET = 2  # steps to the nearest point of an ellipsoid, which is all but there
LEAST = 1e-8  # of the radius of a rim, half of a chord below which this counts as it
FIXED_SECOND, FIXED_FIRST, TWO_SIDES, ITERATED = range(4)  # how the normal is found
_Found = tuple[IteratedNormal, ca.SX, tuple[ca.SX, ca.SX]]


def _gram(body: ContactBody, frame: SymbolicPose, rim: ca.SX) -> ca.SX:
    """K of the corner of a body, in ground's axes, from its number among the `rims`."""
    match body:
        case EllipsoidBody():
            axes = ca.sparsify(frame.rotation @ constant(body.axes)) @ ca.diag(ca.vertcat(*body.radii))
            return rim * (axes @ axes.T)
        case Barrel() | ConeBody():
            axis = ca.sparsify(frame.rotation @ constant(body.axis))
            return rim * rim * (ca.SX.eye(3) - axis @ axis.T)
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
    grams = [
        _gram(body, frame, (1.0 - crossed) * numbers[12 + k])
        for k, (body, frame) in enumerate(zip(bodies, frames, strict=True))
    ]
    fixed = on_b * (second.rotation @ hint) + on_a * (first.rotation @ hint)
    fixed += two * _across_both(d_a, d_b, k_a, k_b, sign, 1.0 - two)
    crossing = None
    if end is not None:
        axis, edge = frames[end].rotation @ hint, (d_b, d_a)[end]
        crossing = _crossing(line if end else -line, edge, axis, numbers[12 + end], sign, crossed)
        fixed += crossed * (crossing.normal if end else -crossing.normal)
    normals = _Search(line, grams, free * (d_a + d_b), free * (k_b - k_a), side, free)
    search: _Search | _RimSearch | _RoundedSearch = normals
    if (rim := _rim(bodies)) is not None:
        search = _rim_search(normals, bodies, frames, rim, numbers[12 + rim], numbers[13 - rim])
    if (rounded := _rounded(bodies)) is not None:
        axis, radius = _axis(bodies[1 - rounded], frames[1 - rounded]), numbers[13 - rounded]
        sides = free * (d_a, d_b)[rounded], free * (d_b, d_a)[rounded]
        search = _RoundedSearch(line, *sides, free * (k_b - k_a), axis, radius, free)
    iterated, normal, toward = search.found(fixed, second.rotation @ hint)
    arms = [_arm(gram, direction) for gram, direction in zip(grams, toward, strict=True)]
    distance = ca.dot(normal, line) - ca.dot(normal, arms[0]) - ca.dot(normal, arms[1]) - sum(radii)
    used = on_b + on_a + two + free + crossed
    lifts = [
        _lift(body, frame, fixed, numbers[28 + k]) for k, (body, frame) in enumerate(zip(bodies, frames, strict=True))
    ]
    lift = lifts[0] + lifts[1]
    place, seen = at - arms[0] - radii[0] * normal, other + arms[1] + radii[1] * normal
    own = place + two * _along(place - seen, d_a, d_b, normal, 1.0 - two)
    if crossing is not None:
        assert end is not None
        own += crossed * (crossing.along * edge + ((other - at) if not end else ca.SX(3, 1)))
        distance -= crossed * ca.dot(normal, crossing.arm if end else -crossing.arm)
    one = ca.cross(side, normal)
    one /= ca.sqrt(ca.dot(one, one) + TINY)
    point = on_second * seen + (1.0 - on_second) * own
    gap = distance - lift + (1.0 - used) * length
    return Touch(gap, normal, point, (one, ca.cross(normal, one)), iterated, lift)


@dataclass(frozen=True, eq=False)
class _Search:
    """The search of the normal of two corners, with their `grams` and the `line` between them, which a side can bound.

    It is `used` if it is 1, and 0 if the normal is fixed.
    """

    line: ca.SX
    grams: list[ca.SX]
    bound: ca.SX
    cosine: ca.SX
    side: ca.SX
    used: ca.SX

    def found(self, fixed: ca.SX, hint: ca.SX) -> _Found:
        """What is iterated, the normal, and the directions in which both corners touch."""
        symbols, value = ca.SX.sym("normal", 3), fixed + self.used * hint
        for _ in range(NEWTON_STEPS):
            value = self.following(fixed, value)
        return IteratedNormal(symbols, value, self.following(fixed, symbols)), symbols, (symbols, symbols)

    def following(self, fixed: ca.SX, given: ca.SX) -> ca.SX:
        """The normal after one step from a given one."""
        step = _newton_step(given, self.bound, self.cosine, self.line, self.grams, self.side, self.used)
        return fixed + self.used * step


@dataclass(frozen=True, eq=False)
class _RimSearch:
    """The search where one of the bodies has rims, and the other one rims or the surface of an ellipsoid.

    Of two corners, of which one is a rim, the direction w from its center is iterated, as in
    `simulation/contact/compiled/features/round/rims.py`, times -1 if it is of the first body. It is `used` if it is 1;
    everything else is found by the search of normals, `others`.

    :param line: from the center of the other corner to that of the rim, with an `axis` and a `radius`.
    :param sign: 1 if the rim is of the first body, and -1 if it is of the second one.
    """

    line: ca.SX
    axis: ca.SX
    radius: ca.SX
    sign: float
    other: _OtherRim | _Ellipsoid
    used: ca.SX
    others: _Search

    def found(self, fixed: ca.SX, hint: ca.SX) -> _Found:
        """See `_Search`."""
        symbols, value = ca.SX.sym("direction", 3), fixed + (1.0 - self.used) * self.others.used * hint
        value += self.used * hint
        for _ in range(NEWTON_STEPS):
            value = self._following(fixed, value)
        iterated = IteratedNormal(symbols, value, self._following(fixed, symbols))
        at = self._at(symbols)
        normal = (1.0 - self.used) * symbols + self.used * self.sign * at.normal
        own, opposite = symbols, (1.0 - self.used) * symbols + self.used * self.sign * at.toward
        return iterated, normal, ((own, opposite) if self.sign > 0.0 else (opposite, own))

    def _at(self, given: ca.SX) -> _AtRim:
        """What a direction of the rim leads to."""
        outward = _unit(-self.sign * (given - self.axis * ca.dot(self.axis, given)))
        tangent = ca.cross(self.axis, outward)
        return self.other.near(self.line + self.radius * outward, outward, tangent, self.radius, self.line)

    def _following(self, fixed: ca.SX, given: ca.SX) -> ca.SX:
        """The direction, or normal, after one of Newton's steps."""
        at = self._at(given)
        step = self.used * at.slope / (self.used * at.firm + 1.0 - self.used)
        return self.others.following(fixed, given) + self.used * -self.sign * _unit(at.outward - step * at.tangent)


@dataclass(frozen=True, eq=False)
class _AtRim:
    """A point of a rim, in the direction `outward` and with its `tangent`, and the other corner.

    The `slope` along the tangent is zero where both touch; `firm` is its derivative by the angle. There the `normal`
    leads to the rim, and `toward` is a direction along which the other corner reaches farthest at the same point.
    """

    outward: ca.SX
    tangent: ca.SX
    slope: ca.SX
    firm: ca.SX
    normal: ca.SX
    toward: ca.SX


@dataclass(frozen=True, eq=False)
class _OtherRim:
    """Another rim, which a rim touches."""

    axis: ca.SX
    radius: ca.SX

    def near(self, place: ca.SX, outward: ca.SX, tangent: ca.SX, radius: ca.SX, line: ca.SX) -> _AtRim:
        """See `_AtRim`.

        :param place: the point of the rim, which has a `radius`, from the center of this one.
        :param line: the center of that rim from that of this one.
        """
        level = place - self.axis * ca.dot(self.axis, place)
        size = ca.sqrt(ca.dot(level, level) + TINY)
        toward = level / size
        other, apart = ca.cross(self.axis, toward), place - self.radius * toward
        along = ca.dot(tangent, other)
        firm = radius * (1.0 - along * along * self.radius / size) - ca.dot(outward, apart)
        normal = _unit(ca.cross(tangent, other))
        normal *= ca.if_else(ca.dot(normal, line) > 0.0, 1.0, -1.0)
        return _AtRim(outward, tangent, ca.dot(tangent, apart), firm, normal, toward)


@dataclass(frozen=True, eq=False)
class _Ellipsoid:
    """An ellipsoid, which a rim touches, with its `axes` (3, 3) in ground's axes and its `radii`."""

    axes: ca.SX
    radii: tuple[float, float, float]
    used: ca.SX

    def near(self, place: ca.SX, outward: ca.SX, tangent: ca.SX, radius: ca.SX, line: ca.SX) -> _AtRim:
        """See `_OtherRim.near`; the nearest point has the parts r² z / (r² + λ) of the parts z of the place."""
        squares = ca.vertcat(*self.radii) ** 2
        own = self.used * (self.axes.T @ place) + (1.0 - self.used) * ca.vertcat(*self.radii)
        far = ca.SX(1, 1)
        for _ in range(FEET):
            shares = own * own * squares / (squares + far) ** 2
            far += 0.5 * (ca.sum1(shares) - 1.0) / ca.sum1(shares / (squares + far))
        gradient = own / (squares + far)
        size = ca.sqrt(ca.dot(gradient, gradient) + TINY)
        normal, along = self.axes @ (gradient / size), self.axes.T @ tangent
        firm = radius * ca.sum1(along * along / squares) / size - ca.dot(outward, normal)
        return _AtRim(outward, tangent, ca.dot(tangent, normal), firm, normal, normal)


@dataclass(frozen=True, eq=False)
class _RoundedSearch:
    """The search where one of the bodies is a rounded point or edge, and the other one has rims with this `axis`.

    Only the place of an edge at a rim is iterated: as the direction w from the center of the rim, which is smooth where
    the normal passes through the axis, and g(n) has a kink. With v, the line from the rim to the edge and across it, it
    is where (axis × w)·v = 0. All others are in closed form.
    """

    line: ca.SX
    edge: ca.SX
    side: ca.SX
    cosine: ca.SX
    axis: ca.SX
    radius: ca.SX
    used: ca.SX

    def found(self, fixed: ca.SX, hint: ca.SX) -> _Found:
        """See `_Search`."""
        on_edge = self.used * (ca.dot(self.edge, self.edge) > 0.5)
        on_side = self.used * (ca.dot(self.side, self.side) > 0.5)
        at_rim = on_edge * (self.radius > 0.0)
        symbols, value = ca.SX.sym("direction", 3), at_rim * hint
        for _ in range(NEWTON_STEPS):
            value = self._following(value, at_rim)
        iterated = IteratedNormal(symbols, value, self._following(symbols, at_rim))
        outward = _unit(self.line - self.axis * ca.dot(self.axis, self.line))
        toward = at_rim * symbols + (self.used - at_rim) * outward
        normal = fixed + (self.used - on_side) * _unit(self._across(self.line - self.radius * toward))
        normal += on_side * (self.cosine * self.side + ca.sqrt(1.0 - self.cosine * self.cosine) * outward)
        toward += (1.0 - self.used) * fixed
        return iterated, normal, (toward, toward)

    def _following(self, given: ca.SX, at_rim: ca.SX) -> ca.SX:
        """The direction after one of Newton's steps."""
        toward = _unit(given - self.axis * ca.dot(self.axis, given))
        tangent, apart = ca.cross(self.axis, toward), self._across(self.line - self.radius * toward)
        along = ca.dot(self.edge, tangent)
        firm = ca.dot(toward, apart) + self.radius * (1.0 - along * along)
        return _unit(toward + at_rim * ca.dot(tangent, apart) / (at_rim * firm + 1.0 - at_rim) * tangent)

    def _across(self, vector: ca.SX) -> ca.SX:
        return vector - self.edge * ca.dot(self.edge, vector)


@dataclass(frozen=True, eq=False)
class _Crossing:
    """Where an edge crosses a rim: `along` the edge, on the `arm` (3,) of the rim; the `normal` (3,) leaves the end."""

    along: ca.SX
    arm: ca.SX
    normal: ca.SX


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
    search: _Search,
    bodies: tuple[ContactBody, ContactBody],
    frames: tuple[SymbolicPose, SymbolicPose],
    rim: int,
    radius: ca.SX,
    width: ca.SX,
) -> _RimSearch:
    """The search of a body with rims and of another one, from that of their normals.

    :param width: the radius of the other corner, 1 for an ellipsoid and 0 for a point.
    """
    sign = 1.0 if rim == 0 else -1.0
    used = search.used * (ca.dot(search.bound, search.bound) < 0.5) * (radius > 0.0) * (width > 0.0)
    body, frame = bodies[1 - rim], frames[1 - rim]
    other = (
        _Ellipsoid(ca.sparsify(frame.rotation @ constant(body.axes)), body.radii, used)
        if isinstance(body, EllipsoidBody)
        else _OtherRim(_axis(body, frame), width)
    )
    axis = _axis(bodies[rim], frames[rim])
    others = replace(search, used=search.used * (1.0 - used))
    return _RimSearch(sign * search.line, axis, radius, sign, other, used, others)


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
    return _Crossing(along, arm, -sign * across / ca.sqrt(ca.dot(across, across) + TINY))


def _lift(body: ContactBody, frame: SymbolicPose, normal: ca.SX, radius: ca.SX) -> ca.SX:
    """How far in m a point of a rim of a `radius` protrudes; 0 for other points."""
    if not isinstance(body, Barrel | ConeBody):
        return ca.SX(1, 1)
    axis = ca.sparsify(frame.rotation @ constant(body.axis))
    aside = normal - axis * ca.dot(axis, normal)
    lift: ca.SX = protrusion(1.0, ca.dot(aside, aside)) * radius
    return lift


def _arm(gram: ca.SX, normal: ca.SX) -> ca.SX:
    """From a corner to its farthest point along the normal."""
    found = gram @ normal
    return found / ca.sqrt(ca.dot(normal, found) + TINY)


def _across_both(d_a: ca.SX, d_b: ca.SX, k_a: ca.SX, k_b: ca.SX, sign: ca.SX, unused: ca.SX) -> ca.SX:
    """The unit vector n with n·d_B = k_B and n·d_A = -k_A, on the side `sign` of both."""
    cosine, across = ca.dot(d_a, d_b), ca.cross(d_b, d_a)
    square = ca.dot(across, across) + unused
    alpha, beta = (k_b + k_a * cosine) / square, -(k_a + k_b * cosine) / square
    rest = 1.0 - (alpha * alpha + beta * beta + 2.0 * alpha * beta * cosine)
    return alpha * d_b + beta * d_a + sign * ca.sqrt((rest + unused) / square) * across


def _newton_step(
    given: ca.SX, direction: ca.SX, cosine: ca.SX, line: ca.SX, grams: list[ca.SX], side: ca.SX, used: ca.SX
) -> ca.SX:
    """A step of n = k d + √(1 - k²) m toward the normal at which the gap is largest; d is zero where none is given."""
    bound, scale = ca.dot(direction, direction), ca.sqrt(1.0 - cosine * cosine)
    m = _unit(given - direction * ca.dot(direction, given))
    one = _unit(bound * ca.cross(direction, m) + (1.0 - bound) * ca.cross(side, m))
    other = (1.0 - bound) * ca.cross(m, one)
    normal = cosine * direction + scale * m
    slope, bend = line, ca.SX(3, 3)
    for gram in grams:
        found = gram @ normal
        size = ca.sqrt(ca.dot(normal, found) + TINY)
        arm = found / size
        slope, bend = slope - arm, bend - (gram - arm @ arm.T) / size
    tangents = ca.horzcat(one, other)
    gradient = used * scale * (tangents.T @ slope)
    hessian = scale * scale * (tangents.T @ bend @ tangents) - scale * ca.dot(m, slope) * ca.SX.eye(2)
    hessian = used * hessian - (1.0 - used) * ca.SX.eye(2)
    hessian[1, 1] -= bound  # a side admits one direction only
    determinant = hessian[0, 0] * hessian[1, 1] - hessian[0, 1] * hessian[1, 0]
    first = (hessian[0, 1] * gradient[1] - hessian[1, 1] * gradient[0]) / determinant
    second = (hessian[1, 0] * gradient[0] - hessian[0, 0] * gradient[1]) / determinant
    return cosine * direction + scale * _unit(m + first * one + second * other)


def _along(apart: ca.SX, d_a: ca.SX, d_b: ca.SX, normal: ca.SX, unused: ca.SX) -> ca.SX:
    """From a point of the first side to where the lines of both sides cross, seen along the normal."""
    one, other = (_unit(d - normal * ca.dot(d, normal)) for d in (d_a, d_b))
    cosine = ca.dot(one, other)
    along = (cosine * ca.dot(other, apart) - ca.dot(one, apart)) / (1.0 - cosine * cosine + unused)
    return along * one


def _unit(vector: ca.SX) -> ca.SX:
    return vector / ca.sqrt(ca.dot(vector, vector) + TINY)
