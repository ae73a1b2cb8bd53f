"""The narrow phase of two convex bodies of which at least one is round.

Along every unit normal n, the planes that support both bodies are s(n) = -h_A(-n) - h_B(n) apart, and the bodies by
the largest s(n). It is found among the normals of faces, those of pairs of sides, and those at which s(n) of two
corners, or of a side and a corner, is largest; the latter by Newton's method.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.dynamics.constraints.rows import perpendiculars
from mbd_sim.dynamics.contact.shapes import EXACT_TILT, FLAT_TILT, POINTS, protrusion
from mbd_sim.dynamics.contact.smooth_rows import (
    FIXED_FIRST,
    FIXED_SECOND,
    ITERATED,
    TWO_SIDES,
    SmoothFeatures,
)
from mbd_sim.mechanism.elements.contacts import Curved, EllipsoidBody, Solid
from mbd_sim.simulation.contact.features.narrow_phase import Bounds
from mbd_sim.simulation.contact.compiled.features.polytopes import BORDER, SUPPORT, TURNED
from mbd_sim.simulation.contact.features.polytopes import cross, dots, turned
from mbd_sim.simulation.contact.features.round_bodies import PlacedBody, RoundBody, round_body, times

KINDS = CORNER_FACE, FACE_CORNER, SIDE_SIDE, SIDE_CORNER, CORNER_SIDE, CORNER_CORNER, POINT_FACE, FACE_POINT = range(8)
COUNT = 1 << 15  # features of a kind
PARALLEL = 1e-9  # sine of the angle below which directions count as parallel
ITERATIONS, HALVINGS = 15, 6
CONVERGED = 1e-9  # change of a normal, after which it is exact to round-off
LARGEST_STEP = 0.5  # rad
HINT = 0.1  # rad by which a normal may turn from its hint
NEAR = 1e-7  # of the size of both bodies, within which two points of contact are one
ROUND_OFF = 1e-6  # of this: a distance that is not less is at least the one found first
STARTS = np.array([v for v in product((-1.0, 0.0, 1.0), repeat=3) if any(v)])
STARTS /= np.sqrt((STARTS * STARTS).sum(axis=1))[:, None]
ANGLES = np.arange(16) * (2.0 * np.pi / 16)
NONE = -1
FLAT = 1e-6  # sine of the angle below which an edge lies on a face
CODES = POINTS + 2  # numbers of points of a rim, and of an edge
CIRCLE = np.array([[np.cos(angle), np.sin(angle)] for angle in np.arange(POINTS) * (2.0 * np.pi / POINTS)])
CHORD = 0.98  # of the chord of an edge across a disc, the part that carries this

Key = tuple[int, int, int, int]  # kind, both features, and the sign of one of two normals


MODES = {
    CORNER_FACE: FIXED_SECOND,
    POINT_FACE: FIXED_SECOND,
    FACE_CORNER: FIXED_FIRST,
    FACE_POINT: FIXED_FIRST,
    SIDE_SIDE: TWO_SIDES,
}


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Pairs of features by their `keys`, with their `corners` (k, 2): of a side one of both.

    The `directions` (k, 3) and `cosines` (k,) of n are those of a side.
    """

    keys: list[Key]
    corners: NDArray[np.intp]
    directions: Array
    cosines: Array


@dataclass(frozen=True, eq=False)
class _Encounter:
    """Two features that meet, or could: the unit `normal` (3,), their `gap` and `margin`, and their `point` (3,)."""

    normal: Array
    gap: float
    margin: float
    point: Array


class SmoothPair:
    """Two convex bodies of which at least one is round: see `NarrowPhase`."""

    iterates = True

    def __init__(self, first: Curved | Solid, second: Curved | Solid, slots: int) -> None:
        self._records, self._slots = (first, second), slots
        self._first, self._second = round_body(first), round_body(second)
        bodies = self._first, self._second
        self._radius = self._first.radius + self._second.radius
        self.bounds = Bounds(bodies[0].center, bodies[0].reach), Bounds(bodies[1].center, bodies[1].reach)
        self._reach = bodies[0].reach + bodies[1].reach
        self._near = NEAR * self._reach
        rounded = self._radius > 0.0
        self._keys = [
            (CORNER_CORNER, i, j, 0)
            for i, j in product(range(len(bodies[0].corners)), range(len(bodies[1].corners)))
            if rounded or _can_meet(bodies[0], i, bodies[1], j)
        ]
        self._keys += [(SIDE_CORNER, i, j, 0) for i, j in _side_corners(bodies[0], bodies[1], rounded)]
        self._keys += [(CORNER_SIDE, i, j, 0) for j, i in _side_corners(bodies[1], bodies[0], rounded)]

    def _placed(self, one: Pose, other: Pose) -> tuple[PlacedBody, PlacedBody]:
        return PlacedBody(self._first, one, other.position), PlacedBody(self._second, other, other.position)

    def distance(self, one: Pose, other: Pose) -> float:
        """See `NarrowPhase`."""
        a, b = self._placed(one, other)
        simple = np.vstack([_faces(a, b)[1], _across_sides(a, b)[1], turned(b.rotation, STARTS)])
        apart = self._separation(a, b, simple)
        known = apart > ROUND_OFF * self._near or self._is_on_face(a, b, apart)
        if self._keys and not known:
            pairs = _pairs(self._keys, a, b)
            apart = max(apart, self._separation(a, b, _iterated(a, b, pairs, _starts(a, b, pairs))))
        return self._with_flat_rims(a, b, apart)

    def _with_flat_rims(self, a: PlacedBody, b: PlacedBody, apart: float) -> float:
        """The distance where rims that lie nearly flat on a face protrude, from that of the bodies without this.

        Below `EXACT_TILT` the gaps of the points that carry them take its place: a rim is lower between its points.
        """
        gaps, flat = [apart], False
        for kind, body, other in ((POINT_FACE, a, b), (FACE_POINT, b, a)):
            if not (body.body.faces and body.body.curved.any() and len(other.normals)):
                continue
            sign = 1.0 if kind == POINT_FACE else -1.0
            near = self._supports(a, b, sign * other.normals) >= apart - FLAT_TILT * body.body.reach
            for face in np.flatnonzero(near).tolist():
                normal = other.normals[face]
                for code, place in _lying(body, other, face, normal):
                    if code % CODES < POINTS and other.inside(face, place) >= 0.0:
                        key = (kind, code, face, 0) if kind == POINT_FACE else (kind, face, code, 0)
                        gaps.append(self._meeting(a, b, key, sign * normal, place).gap)
                        flat |= _tilt(body, code // CODES, normal)[1] < EXACT_TILT
                if flat:
                    gaps += self._beneath(a, b, kind, normal)
        return min(gaps[1:] if flat else gaps)

    def _is_on_face(self, a: PlacedBody, b: PlacedBody, apart: float) -> bool:
        """Whether a corner is within the border of a face that it touches, up to round-off."""
        if abs(apart) > ROUND_OFF * self._near:
            return False
        return any(
            place is None and (found := self._meeting(a, b, each, normal)).margin >= 0.0 and found.gap <= apart
            for key, normal in zip(*_faces(a, b), strict=True)
            for each, place in self._members(a, b, key, normal)
        )

    def _beneath(self, a: PlacedBody, b: PlacedBody, kind: int, normal: Array) -> list[float]:
        """The gaps of corners and edges of the other body that are beneath the end of a body that lies flat."""
        body, other, sign = (a, b, 1.0) if kind == POINT_FACE else (b, a, -1.0)
        face = int(np.argmin(dots(body.normals, normal)))
        back = (FACE_POINT, CORNER_FACE + 1) if kind == POINT_FACE else (POINT_FACE, CORNER_FACE)
        outward, found = -sign * body.normals[face], []
        points = [
            (code, place) for code, place in _lying(other, body, face, body.normals[face]) if code % CODES >= POINTS
        ]
        for code, place in points:
            key = (back[0], face, code, 0) if kind == POINT_FACE else (back[0], code, face, 0)
            found.append(self._meeting(a, b, key, outward, place).gap)
        for corner in np.flatnonzero(~other.body.curved).tolist():
            key = (back[1], face, corner, 0) if kind == POINT_FACE else (back[1], corner, face, 0)
            meeting = self._meeting(a, b, key, outward)
            if meeting.margin >= 0.0:
                found.append(meeting.gap)
        return found

    def _separation(self, a: PlacedBody, b: PlacedBody, normals: Array) -> float:
        return float(self._supports(a, b, normals).max())

    def _supports(self, a: PlacedBody, b: PlacedBody, normals: Array) -> Array:
        """s(n) of normals (k, 3)."""
        return np.asarray(-a.heights(-normals).max(axis=1) - b.heights(normals).max(axis=1) - self._radius)

    def _stationary(self, a: PlacedBody, b: PlacedBody) -> Iterator[tuple[list[Key], Array]]:
        """The keys (kind, i, j, sign) of pairs of features, and their normals (k, 3)."""
        yield _faces(a, b)
        yield _across_sides(a, b)
        if self._keys:
            pairs = _pairs(self._keys, a, b)
            yield self._keys, _iterated(a, b, pairs, _starts(a, b, pairs))

    def touching(self, one: Pose, other: Pose, tolerance: float) -> list[SmoothFeatures]:
        """See `NarrowPhase`."""
        a, b = self._placed(one, other)
        found = [*self._stationary(a, b)]
        apart = self._separation(a, b, np.vstack([normals for _, normals in found]))
        lowest = min(self._with_flat_rims(a, b, apart), 0.0) - SUPPORT * tolerance
        meetings: list[tuple[Key, _Encounter]] = []
        for keys, normals in found:
            supports = self._supports(a, b, normals) if len(normals) else ()
            for key, normal, support in zip(keys, normals, supports, strict=True):
                if support < lowest - (FLAT_TILT * self._reach if key[0] in (CORNER_FACE, FACE_CORNER) else 0.0):
                    continue
                for each, place in self._members(a, b, key, normal):
                    meeting = self._meeting(a, b, each, normal, place)
                    fits = lowest <= meeting.gap <= tolerance and meeting.margin >= -BORDER * tolerance
                    if fits and not self._is_known(meeting, [known for _, known in meetings]):
                        meetings.append((each, meeting))
        return [self._features(a, b, *each) for each in meetings[: self._slots]]

    def _members(self, a: PlacedBody, b: PlacedBody, key: Key, normal: Array) -> Iterator[tuple[Key, Array | None]]:
        """The pairs of features with one normal: all corners at a face, and points fixed in what lies on it."""
        kind, i, j, sign = key
        match kind:
            case 0:  # CORNER_FACE
                yield from (((kind, corner, j, sign), None) for corner in range(len(a.corners)))
                yield from (((POINT_FACE, code, j, sign), place) for code, place in _lying(a, b, j, normal))
            case 1:  # FACE_CORNER
                yield from (((kind, i, corner, sign), None) for corner in range(len(b.corners)))
                yield from (((FACE_POINT, i, code, sign), place) for code, place in _lying(b, a, i, normal))
            case _:
                yield key, None

    def _is_known(self, meeting: _Encounter, known: list[_Encounter]) -> bool:
        apart = [meeting.point - other.point for other in known]
        return any(float(np.sqrt(dots(line, line))) <= self._near for line in apart)

    def _meeting(self, a: PlacedBody, b: PlacedBody, key: Key, normal: Array, place: Array | None = None) -> _Encounter:
        """Two features with a normal: points of sides and of faces are those of the other feature's corner.

        :param place: (3,) of a point that is fixed in one of the bodies.
        """
        kind, i, j, _ = key
        if place is not None:
            body, face, sign = (b, j, 1.0) if kind == POINT_FACE else (a, i, -1.0)
            gap = sign * float(dots(normal, place - _middle(body, face))) - self._radius
            gap -= _protrusion(*((a, i) if kind == POINT_FACE else (b, j)), normal)
            return _Encounter(normal, gap, body.inside(face, place), place)
        on_first, on_second = kind in (CORNER_FACE, CORNER_SIDE, CORNER_CORNER), kind in (FACE_CORNER, SIDE_CORNER)
        corner_a = i if on_first else 0 if kind == FACE_CORNER else int(a.body.sides[i][0])
        corner_b = j if on_second or kind == CORNER_CORNER else 0 if kind == CORNER_FACE else int(b.body.sides[j][0])
        at, other = _farthest(a, corner_a, -normal), _farthest(b, corner_b, normal)
        if kind == CORNER_FACE:
            other = _middle(b, j)
            margin = min(b.inside(j, at), _tilted(a, i, normal))
        elif kind == FACE_CORNER:
            at = _middle(a, i)
            margin = min(a.inside(i, other), _tilted(b, j, normal))
        gap, point = float(dots(normal, at - other)) - self._radius, other if on_second else at
        if kind in (CORNER_FACE, FACE_CORNER):
            return _Encounter(normal, gap, margin, point)
        margin = np.inf
        if kind == SIDE_SIDE:
            point = _crossing(a, i, b, j, normal, at, other)
        for body, feature, sign, is_side in (
            (a, i, -1.0, kind in (SIDE_SIDE, SIDE_CORNER)),
            (b, j, 1.0, kind in (SIDE_SIDE, CORNER_SIDE)),
        ):
            if is_side:
                ends = body.body.sides[feature].tolist()
                margin = min(margin, _within(body, ends, sign * normal, point), body.lead(ends, sign * normal))
            else:
                margin = min(margin, body.lead([feature], sign * normal))
        return _Encounter(normal, gap, margin, point)

    def _features(self, a: PlacedBody, b: PlacedBody, key: Key, meeting: _Encounter) -> SmoothFeatures:
        kind, i, j, sign = key
        corners, rims, directions, cosines, flat = [], [], [], [], []
        sides = (kind in (SIDE_SIDE, SIDE_CORNER), kind in (SIDE_SIDE, CORNER_SIDE))
        faces = (kind in (FACE_CORNER, FACE_POINT), kind in (CORNER_FACE, POINT_FACE))
        for body, record, feature, is_side, is_face in zip((a, b), self._records, (i, j), sides, faces, strict=True):
            shape, is_point = body.body, kind in (POINT_FACE, FACE_POINT) and not is_face
            corner = int(shape.sides[feature][0]) if is_side else feature
            if is_point:
                place = turned(body.rotation.T, meeting.point - body.position)
            else:
                place = shape.faces[feature].center if is_face else shape.corners[corner]
            corners.append(place - record.at.point)
            rims.append(0.0 if is_face or is_point or not shape.curved[corner] else _rim(shape, corner, record))
            on_rim = is_point and feature % CODES < POINTS
            flat.append(float(np.sqrt(shape.grams[feature // CODES].trace() / 2.0)) if on_rim else 0.0)
            directions.append(shape.directions[feature] if is_side else np.zeros(3))
            cosines.append(float(shape.cosines[feature]) if is_side else 0.0)
        mode = MODES.get(kind, ITERATED)
        own = turned((a if mode == FIXED_FIRST else b).rotation.T, meeting.normal)
        in_second = turned(b.rotation.T, meeting.normal)
        return SmoothFeatures(
            _key(key),
            (corners[0], corners[1]),
            (rims[0], rims[1]),
            (directions[0], directions[1]),
            (cosines[0], cosines[1]),
            mode,
            own,
            float(sign),
            kind in (FACE_CORNER, FACE_POINT, SIDE_CORNER),
            np.eye(3)[int(np.argmin(np.round(np.abs(in_second), 9)))],
            (flat[0], flat[1]),
        )

    def margin(self, one: Pose, other: Pose, numbers: Array) -> float:
        """See `NarrowPhase`."""
        a, b = self._placed(one, other)
        key = _decoded(int(numbers[-1]))
        normal = self._normal(a, b, key, numbers)
        side = cross(turned(b.rotation, numbers[25:28]), normal)
        place = None
        if key[0] in (POINT_FACE, FACE_POINT):
            own, body = (0, a) if key[0] == POINT_FACE else (1, b)
            point = numbers[3 * own : 3 * own + 3] + self._records[own].at.point
            place = turned(body.rotation, point) + body.position
        margin = min(self._meeting(a, b, key, normal, place).margin, float(np.sqrt(dots(side, side))) - TURNED)
        if key[0] in (SIDE_CORNER, CORNER_SIDE, CORNER_CORNER):
            turn = normal - turned(b.rotation, numbers[22:25])
            margin = min(margin, HINT - float(np.sqrt(dots(turn, turn))))
        return margin

    def renewed(self, one: Pose, other: Pose, numbers: Array) -> Array:
        """See `NarrowPhase`."""
        key = _decoded(int(numbers[-1]))
        if key[0] not in (SIDE_CORNER, CORNER_SIDE, CORNER_CORNER):
            return numbers
        a, b = self._placed(one, other)
        found = numbers.copy()
        found[22:25] = turned(b.rotation.T, self._normal(a, b, key, numbers))
        return found

    def _normal(self, a: PlacedBody, b: PlacedBody, key: Key, numbers: Array) -> Array:
        """The normal of a pair of features, from the hint among the numbers of its slot."""
        kind, i, j, sign = key
        if kind in (CORNER_FACE, POINT_FACE):
            return np.asarray(b.normals[j])
        if kind in (FACE_CORNER, FACE_POINT):
            return np.asarray(-a.normals[i])
        if kind == SIDE_SIDE:
            return np.asarray(_across_both(a, b, np.array([i]), np.array([j]), float(sign))[0])
        return np.asarray(_iterated(a, b, _pairs([key], a, b), turned(b.rotation, numbers[None, 22:25]))[0])


def _middle(body: PlacedBody, face: int) -> Array:
    """A point (3,) of a face."""
    return np.asarray(turned(body.rotation, body.body.faces[face].center) + body.position)


def _tilted(body: PlacedBody, corner: int, normal: Array) -> float:
    """In m, negative where a rim lies so flat on a face with this normal that it rests on points; large for others."""
    if not body.body.curved[corner]:
        return np.inf
    radius, tilt = _tilt(body, corner, normal)
    return (tilt - EXACT_TILT) * radius


def _protrusion(body: PlacedBody, code: int, normal: Array) -> float:
    """How far in m the point with this number protrudes, if it is one of a rim."""
    if code % CODES >= POINTS:
        return 0.0
    radius, tilt = _tilt(body, code // CODES, normal)
    return float(protrusion(radius, tilt * tilt))


def _tilt(body: PlacedBody, corner: int, normal: Array) -> tuple[float, float]:
    """The radius in m of a rim, and the sine of its tilt against a face with a normal; 1 for an ellipsoid."""
    gram, own = body.body.grams[corner], turned(body.rotation.T, normal)
    radius = float(np.sqrt(gram.trace() / 2.0))
    if not body.body.faces:
        return radius, 1.0
    return radius, float(np.sqrt(max(0.0, float(dots(own, times(gram, own)))))) / radius


def _lying(one: PlacedBody, other: PlacedBody, face: int, normal: Array) -> Iterator[tuple[int, Array]]:
    """Points (3,) of one body that are fixed in it and lie on a face of another: of rims, and of edges across a disc.

    Each has a number of its own.
    """
    shape, disc = one.body, other.body.faces[face]
    for corner in range(len(shape.corners)) if shape.curved.any() else ():
        radius, tilt = _tilt(one, corner, normal) if shape.curved[corner] else (0.0, 1.0)
        if tilt <= FLAT_TILT and one.lead([corner], -other.normals[face]) >= 0.0:
            first, second = perpendiculars(shape.directions[0] if len(shape.directions) else shape.faces[-1].normal)
            for number, (x, y) in enumerate(CIRCLE.tolist()):
                arm = turned(one.rotation, radius * (x * first + y * second))
                yield CODES * corner + number, one.corners[corner] + arm
    for side in np.flatnonzero(~shape.ruled).tolist() if disc.radius else ():
        direction = one.directions[side]
        if abs(float(dots(direction, normal))) > FLAT:
            continue
        start, stop = one.corners[shape.sides[side]]
        line = start - _middle(other, face)
        along = float(dots(direction, line))
        chord = disc.radius**2 - float(dots(line, line)) + along * along
        if chord > 0.0:
            half = CHORD * float(np.sqrt(chord))
            length = float(np.sqrt(dots(stop - start, stop - start)))
            for number, end in enumerate((-along - half, -along + half)):
                if 0.0 < end < length:
                    yield CODES * side + POINTS + number, start + end * direction


def _rim(shape: RoundBody, corner: int, record: Curved | Solid) -> float:
    """The radius of a rim; 1 for an ellipsoid."""
    return 1.0 if isinstance(record, EllipsoidBody) else float(np.sqrt(shape.grams[corner].trace() / 2.0))


def _can_meet(one: RoundBody, i: int, other: RoundBody, j: int) -> bool:
    """Whether sharp corners can meet at a smooth place: not a point with a point or with a rim."""
    smooth = (
        one.curved[i] and len(one.corners) == 1 and not one.faces,
        other.curved[j] and len(other.corners) == 1 and not other.faces,
    )
    return bool((one.curved[i] and other.curved[j]) or any(smooth))


def _side_corners(one: RoundBody, other: RoundBody, rounded: bool) -> list[tuple[int, int]]:
    """The sides of one body and the corners of another that can meet at a smooth place."""
    return [
        (i, j)
        for i, j in product(range(len(one.sides)), range(len(other.corners)))
        if rounded or one.ruled[i] or other.curved[j]
    ]


def _pairs(keys: list[Key], a: PlacedBody, b: PlacedBody) -> _Pairs:
    """Pairs of two corners, or of a side and a corner."""
    corners = np.array([key[1:3] for key in keys], dtype=np.intp)
    directions, cosines = np.zeros((len(keys), 3)), np.zeros(len(keys))
    for place, (kind, *features, _) in enumerate(keys):
        if kind != CORNER_CORNER:
            own = 0 if kind == SIDE_CORNER else 1
            body, side = (a, b)[own], features[own]
            corners[place, own] = body.body.sides[side, 0]
            directions[place] = body.directions[side]
            cosines[place] = (-1.0, 1.0)[own] * body.body.cosines[side]
    return _Pairs(keys, corners, directions, cosines)


def _faces(a: PlacedBody, b: PlacedBody) -> tuple[list[Key], Array]:
    """The normals of the faces of both."""
    keys = [(CORNER_FACE, NONE, j, 0) for j in range(len(b.normals))]
    keys += [(FACE_CORNER, i, NONE, 0) for i in range(len(a.normals))]
    return keys, np.vstack([b.normals, -a.normals])


def _across_sides(a: PlacedBody, b: PlacedBody) -> tuple[list[Key], Array]:
    """Both normals of each pair of sides that are not parallel."""
    firsts, seconds = len(a.directions), len(b.directions)
    i, j = np.repeat(np.arange(firsts), seconds), np.tile(np.arange(seconds), firsts)
    keys: list[Key] = []
    found = []
    for sign in (-1, 1):
        normals = _across_both(a, b, i, j, float(sign))
        fits = np.isfinite(normals).all(axis=1)
        keys += [(SIDE_SIDE, *pair, sign) for pair in zip(i[fits].tolist(), j[fits].tolist(), strict=True)]
        found.append(normals[fits])
    return keys, np.vstack(found)


def _across_both(a: PlacedBody, b: PlacedBody, i: NDArray[np.intp], j: NDArray[np.intp], sign: float) -> Array:
    """The unit vectors n (k, 3) with n·d_B = k_B and n·d_A = -k_A; not finite where there are none."""
    d_a, d_b, k_a, k_b = a.directions[i], b.directions[j], a.body.cosines[i], b.body.cosines[j]
    cosine, across = dots(d_a, d_b), cross(d_b, d_a)
    square = dots(across, across)
    square = np.where(square > PARALLEL**2, square, np.nan)
    alpha, beta = (k_b + k_a * cosine) / square, -(k_a + k_b * cosine) / square
    rest = 1.0 - (alpha * alpha + beta * beta + 2.0 * alpha * beta * cosine)
    size = sign * np.sqrt(np.where(rest >= 0.0, rest, np.nan) / square)
    return np.asarray(alpha[:, None] * d_b + beta[:, None] * d_a + size[:, None] * across)


def _starts(a: PlacedBody, b: PlacedBody, pairs: _Pairs) -> Array:
    """Of each pair, the best of some normals, from which Newton's method starts."""
    line = a.corners[pairs.corners[:, 0]] - b.corners[pairs.corners[:, 1]]
    size = np.sqrt(dots(line, line))[:, None]
    toward = np.where(size > 0.0, line / np.where(size > 0.0, size, 1.0), STARTS[0])
    tries = np.concatenate([toward[:, None], np.broadcast_to(STARTS, (len(line), *STARTS.shape))], axis=1)
    tries = _admitted(pairs, tries)
    flat = tries.reshape(-1, 3)
    repeats = np.repeat(pairs.corners, tries.shape[1], axis=0)
    values = _values(a, b, repeats, flat).reshape(tries.shape[:2])
    return np.asarray(tries[np.arange(len(line)), np.argmax(values, axis=1)])


def _admitted(pairs: _Pairs, normals: Array) -> Array:
    """Normals (k, n, 3) moved to those with the cosines of the sides."""
    directions, cosines = pairs.directions[:, None], pairs.cosines[:, None, None]
    aside = normals - directions * dots(normals, directions)[..., None]
    size = np.sqrt(dots(aside, aside))[..., None]
    spare = np.stack([directions[..., 1], directions[..., 2], directions[..., 0]], axis=-1)
    spare = cross(directions, spare + STARTS[5])
    length = np.sqrt(dots(spare, spare))[..., None]
    aside = np.where(
        size > PARALLEL, aside / np.where(size > PARALLEL, size, 1.0), spare / np.where(length, length, 1.0)
    )
    return np.asarray(directions * cosines + np.sqrt(1.0 - cosines * cosines) * aside)


def _values(a: PlacedBody, b: PlacedBody, corners: NDArray[np.intp], normals: Array) -> Array:
    """The gaps (k,) of pairs of corners along normals (k, 3), without rounding."""
    line = a.corners[corners[:, 0]] - b.corners[corners[:, 1]]
    arms = a.offsets(corners[:, 0], normals) + b.offsets(corners[:, 1], normals)
    return dots(normals, line - arms)


def _iterated(a: PlacedBody, b: PlacedBody, pairs: _Pairs, start: Array) -> Array:
    """The normals (k, 3) at which the gaps of pairs of features are largest, by Newton's method with shorter steps."""
    corners, directions, cosines = pairs.corners, pairs.directions, pairs.cosines[:, None]
    line, scale = a.corners[corners[:, 0]] - b.corners[corners[:, 1]], np.sqrt(1.0 - cosines * cosines)
    bound = dots(directions, directions)[:, None]
    m = start - directions * dots(directions, start)[:, None]
    m = m / np.sqrt(dots(m, m))[:, None]
    best = _values(a, b, corners, cosines * directions + scale * m)
    for _ in range(ITERATIONS):
        least = np.eye(3)[np.argmin(np.abs(m), axis=1)]
        one = np.where(bound > 0.0, cross(directions, m), cross(least, m))
        one = one / np.sqrt(dots(one, one))[:, None]
        other = cross(m, one) * (1.0 - bound)
        normals = cosines * directions + scale * m
        slope = line - a.offsets(corners[:, 0], normals) - b.offsets(corners[:, 1], normals)
        bend = -a.bends(corners[:, 0], normals) - b.bends(corners[:, 1], normals)
        gradient = scale * np.stack([dots(one, slope), dots(other, slope)], axis=-1)
        step = _newton_step(one, other, gradient, bend, scale, dots(m, slope))
        size = np.sqrt(step[:, 0] ** 2 + step[:, 1] ** 2)[:, None]
        step = step * np.minimum(1.0, LARGEST_STEP / np.where(size > 0.0, size, 1.0))
        moved, values = m, best
        factor = np.ones_like(scale)
        for _ in range(HALVINGS):
            tried = m + factor * (step[:, :1] * one + step[:, 1:] * other)
            tried = tried / np.sqrt(dots(tried, tried))[:, None]
            values = _values(a, b, corners, cosines * directions + scale * tried)
            worse = values < best - 1e-14 * np.abs(best)
            moved = np.where(worse[:, None], moved, tried)
            if not worse.any():
                break
            factor = np.where(worse[:, None], 0.5 * factor, factor)
        change = np.abs(moved - m).max(initial=0.0)
        m, best = moved, np.maximum(values, best)
        if change <= CONVERGED:
            break
    return np.asarray(cosines * directions + scale * m)


def _newton_step(one: Array, other: Array, gradient: Array, bend: Array, scale: Array, height: Array) -> Array:
    """The step (k, 2) along two tangents; along the gradient where the Hessian is not negative definite."""

    def curvature(left: Array, right: Array) -> Array:
        product = np.stack([dots(bend[:, row], right) for row in range(3)], axis=-1)
        return np.asarray((scale * scale)[:, 0] * dots(left, product))

    drop = scale[:, 0] * height
    h11, h12 = curvature(one, one) - drop, curvature(one, other)
    h22 = np.where(dots(other, other) > 0.5, curvature(other, other) - drop, -1.0)
    determinant = h11 * h22 - h12 * h12
    good = (h11 < 0.0) & (determinant > 0.0)
    safe = np.where(good, determinant, 1.0)
    first = (h12 * gradient[:, 1] - h22 * gradient[:, 0]) / safe
    second = (h12 * gradient[:, 0] - h11 * gradient[:, 1]) / safe
    size = np.sqrt(gradient[:, 0] ** 2 + gradient[:, 1] ** 2)
    ascent = LARGEST_STEP * gradient / np.where(size > 0.0, size, 1.0)[:, None]
    return np.where(good[:, None], np.stack([first, second], axis=-1), ascent)


def _farthest(body: PlacedBody, corner: int, normal: Array) -> Array:
    """The farthest point (3,) of a corner along a normal, without rounding."""
    return np.asarray(body.corners[corner] + body.offsets(np.array([corner]), normal[None])[0])


def _ruling(body: PlacedBody, ends: list[int], normal: Array) -> tuple[Array, Array]:
    """Both ends (3,) of the line of a side that reaches farthest along a normal."""
    return _farthest(body, ends[0], normal), _farthest(body, ends[1], normal)


def _within(body: PlacedBody, ends: list[int], normal: Array, point: Array) -> float:
    """How far in m a point is from the ends of a side, seen along it."""
    start, stop = _ruling(body, ends, normal)
    line = stop - start
    length = float(np.sqrt(dots(line, line)))
    along = float(dots(point - start, line)) / length
    return min(along, length - along)


def _crossing(a: PlacedBody, i: int, b: PlacedBody, j: int, normal: Array, at: Array, other: Array) -> Array:
    """The point (3,) of the first of two sides where both cross, seen along their normal."""
    lines = []
    for body, side, sign in ((a, i, -1.0), (b, j, 1.0)):
        start, stop = _ruling(body, body.body.sides[side].tolist(), sign * normal)
        lines.append((stop - start) / np.sqrt(dots(stop - start, stop - start)))
    one, two = lines
    apart, cosine = at - other, float(dots(one, two))
    along = (cosine * float(dots(two, apart)) - float(dots(one, apart))) / (1.0 - cosine * cosine)
    return np.asarray(at + along * one)


def _key(key: Key) -> int:
    kind, i, j, sign = key
    return 1 + ((kind * COUNT + i) * COUNT + j) * 2 + (sign > 0)


def _decoded(key: int) -> Key:
    rest, sign = divmod(key - 1, 2)
    rest, j = divmod(rest, COUNT)
    kind, i = divmod(rest, COUNT)
    return kind, i, j, 2 * sign - 1 if kind == SIDE_SIDE else 0
