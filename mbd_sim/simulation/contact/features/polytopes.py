"""The narrow phase of convex polytopes, which may be rounded by a radius.

Sharp polytopes are as far apart as their faces and pairs of edges separate them (separating axes; Gottschalk, Lin &
Manocha 1996). Of rounded ones the cores do not touch, and their nearest features are the true ones.

All sums are written out: their bits do not depend on the processor.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.dynamics.contact.feature_rows import KEY, Features
from mbd_sim.mechanism.elements.contacts import Solid
from mbd_sim.simulation.contact.features.narrow_phase import Bounds

PARALLEL = 1e-9  # sine of the angle below which edges count as parallel
BORDER = 0.5  # of the tolerance, by which a point may be beside its face or edge
SUPPORT = 4.0  # times the tolerance, by which a body may reach beyond a plane that supports it
TURNED = 0.5  # sine of the angle between the normal and the stored direction across it, below which that is renewed
KINDS = VERTEX_FACE, FACE_VERTEX, EDGE_EDGE, VERTEX_EDGE, EDGE_VERTEX, VERTEX_VERTEX = range(6)
COUNT = 1 << 15  # features of a kind


class Polytope:
    """A solid with its faces and edges in the frame of its part."""

    def __init__(self, solid: Solid) -> None:
        self.vertices, self.radius = solid.vertices, solid.radius
        self.faces, self.edges = solid.faces, solid.edges
        self.normals = np.array([_normal(self.vertices[list(face)]) for face in solid.faces]).reshape(-1, 3)
        self.offsets = dots(self.normals, self.vertices[[face[0] for face in solid.faces]])
        ends = np.array(self.edges, dtype=int).reshape(-1, 2)
        lines = self.vertices[ends[:, 1]] - self.vertices[ends[:, 0]]
        self.lengths = np.sqrt(dots(lines, lines))
        self.starts, self.directions = self.vertices[ends[:, 0]], lines / self.lengths[:, None]
        self.axes = _without_parallel(self.directions)
        self.center = 0.5 * (self.vertices.max(axis=0) + self.vertices.min(axis=0))
        reach = self.vertices - self.center
        self.reach = float(np.sqrt(dots(reach, reach).max())) + self.radius

    @cached_property
    def borders(self) -> tuple[Array, Array]:
        """Of each face (m, k, 3), the corners, and the directions from its sides into it; the last ones may repeat."""
        most = max(map(len, self.faces))
        corners, inward = np.empty((2, len(self.faces), most, 3))
        for number, (face, normal) in enumerate(zip(self.faces, self.normals, strict=True)):
            loop = [*face, *[face[-1]] * (most - len(face))]
            ends = [*face[1:], *[face[0]] * (most - len(face) + 1)]
            sides = self.vertices[ends] - self.vertices[loop]
            corners[number] = self.vertices[loop]
            inward[number] = cross(normal, sides) / np.sqrt(dots(sides, sides))[:, None]
        return corners, inward

    @cached_property
    def beside_edges(self) -> list[list[Array]]:
        """Of each edge, the directions (3,) from it into the faces that it bounds."""
        found: list[list[Array]] = [[] for _ in self.edges]
        index = {edge: number for number, edge in enumerate(self.edges)}
        for face, inward in zip(self.faces, self.borders[1] if self.faces else (), strict=True):
            for k, vertex in enumerate(face):
                following = face[(k + 1) % len(face)]
                found[index[min(vertex, following), max(vertex, following)]].append(inward[k])
        return found

    @cached_property
    def from_vertices(self) -> list[list[Array]]:
        """Of each vertex, the directions (3,) of the edges that leave it."""
        found: list[list[Array]] = [[] for _ in self.vertices]
        for (one, other), direction in zip(self.edges, self.directions, strict=True):
            found[one].append(direction)
            found[other].append(-direction)
        return found

    @cached_property
    def segments(self) -> tuple[Array, Array, Array]:
        """The starts, directions and lengths of the edges; a point is an edge without a length."""
        if len(self.edges):
            return self.starts, self.directions, self.lengths
        return self.vertices, np.zeros((1, 3)), np.zeros(1)


class Polygon(Polytope):
    """The cross-section of a prism along the axis `still`, counterclockwise about it; its sides are faces."""

    def __init__(self, solid: Solid, still: int) -> None:
        super().__init__(replace(solid, faces=()))
        self.faces, count = solid.faces, len(solid.faces)
        ends = np.array(solid.faces, dtype=int).reshape(-1, 2)
        sides = self.vertices[ends[:, 1]] - self.vertices[ends[:, 0]]
        self._sides = sides / np.sqrt(dots(sides, sides))[:, None]
        self.normals = cross(self._sides, np.broadcast_to(np.eye(3)[still], (count, 3)))
        self.offsets = dots(self.normals, self.vertices[ends[:, 0]])
        self.edges, self.axes = (), np.zeros((0, 3))

    @cached_property
    def borders(self) -> tuple[Array, Array]:
        """See `Polytope`; those of a side are its ends."""
        return self.vertices[np.array(self.faces, dtype=int)], np.stack([self._sides, -self._sides], axis=1)

    @cached_property
    def from_vertices(self) -> list[list[Array]]:
        """See `Polytope`; along the sides."""
        found: list[list[Array]] = [[] for _ in self.vertices]
        for (one, other), side in zip(self.faces, self._sides, strict=True):
            found[one].append(side)
            found[other].append(-side)
        return found

    @cached_property
    def segments(self) -> tuple[Array, Array, Array]:
        """See `Polytope`; the corners."""
        return self.vertices, np.zeros_like(self.vertices), np.zeros(len(self.vertices))


def _without_parallel(directions: Array) -> Array:
    """The first of all directions (n, 3) that are parallel."""
    kept: list[Array] = []
    for direction in directions:
        if all(float(dots(across, across)) > PARALLEL**2 for across in (cross(direction, other) for other in kept)):
            kept.append(direction)
    return np.array(kept).reshape(-1, 3)


def _normal(corners: Array) -> Array:
    """The unit normal (3,) of a loop of corners (n, 3)."""
    across = cross(corners - corners[0], np.roll(corners, -1, axis=0) - corners[0])
    total = across.sum(axis=0)
    return np.asarray(total / np.sqrt(dots(total, total)))


def dots(one: Array, other: Array) -> Array:
    """Dot products along the last axis, of length 3."""
    return np.asarray(one[..., 0] * other[..., 0] + one[..., 1] * other[..., 1] + one[..., 2] * other[..., 2])


def cross(one: Array, other: Array) -> Array:
    """Cross products along the last axis."""
    x, y, z = (one[..., i] for i in range(3))
    a, b, c = (other[..., i] for i in range(3))
    return np.stack([y * c - z * b, z * a - x * c, x * b - y * a], axis=-1)


def turned(rotation: Array, vectors: Array) -> Array:
    """Vectors (..., 3) of a part in ground's axes."""
    x, y, z = (vectors[..., i : i + 1] for i in range(3))
    return np.asarray(x * rotation[:, 0] + y * rotation[:, 1] + z * rotation[:, 2])


class _Placed:
    """A polytope at a pose, in ground's axes, with positions relative to an `origin` (3,)."""

    def __init__(self, body: Polytope, pose: Pose, origin: Array) -> None:
        self.body, self.rotation, self.position = body, pose.rotation, pose.position - origin
        self.vertices = turned(pose.rotation, body.vertices) + self.position

    def heights(self, points: Array) -> Array:
        """Of points (n, 3) above the planes of the faces (n, m)."""
        own = turned(self.rotation.T, points - self.position)
        return np.asarray(dots(own[:, None], self.body.normals) - self.body.offsets)

    def depths(self, points: Array, face: int | slice = slice(None)) -> Array:
        """How far inside the borders of some faces (n, m) points (n, 3) are, seen along the normals."""
        own, (corners, inward) = turned(self.rotation.T, points - self.position), self.body.borders
        return np.asarray(dots(own[:, None, None] - corners[face], inward[face]).min(axis=-1))

    def segments(self) -> tuple[Array, Array, Array]:
        """The starts, directions and lengths of the edges, see `Polytope.segments`."""
        starts, directions, lengths = self.body.segments
        return turned(self.rotation, starts) + self.position, turned(self.rotation, directions), lengths


def _separation(a: _Placed, b: _Placed) -> float:
    """How far faces and pairs of edges separate two cores; negative by the depth of penetration."""
    found = [-np.inf]
    if b.body.faces:
        found.append(float(b.heights(a.vertices).min(axis=0).max()))
    if a.body.faces:
        found.append(float(a.heights(b.vertices).min(axis=0).max()))
    axes = cross(turned(a.rotation, a.body.axes)[:, None], turned(b.rotation, b.body.axes)).reshape(-1, 3)
    sizes = np.sqrt(dots(axes, axes))
    axes = axes[sizes > PARALLEL] / sizes[sizes > PARALLEL][:, None]
    if len(axes):
        one, other = dots(a.vertices[:, None], axes), dots(b.vertices[:, None], axes)
        found.append(float(np.maximum(one.min(0) - other.max(0), other.min(0) - one.max(0)).max()))
    return max(found)


def _distance(a: _Placed, b: _Placed) -> float:
    """The distance of two cores that do not meet."""
    found = [float(_edge_distances(a, b).min())]
    for one, other in ((a, b), (b, a)):
        if other.body.faces:
            heights, depths = other.heights(one.vertices), other.depths(one.vertices)
            found.append(float(np.where((heights >= 0.0) & (depths >= 0.0), heights, np.inf).min()))
    return min(found)


def _edge_distances(a: _Placed, b: _Placed) -> Array:
    """The distances of all edges of one core from all of the other (Ericson, *Real-Time Collision Detection*)."""
    (start, direction, length), (other_start, other_direction, other_length) = a.segments(), b.segments()
    line = start[:, None] - other_start
    cosine = dots(direction[:, None], other_direction)
    along, other_along = dots(direction[:, None], line), dots(other_direction, line)
    square = 1.0 - cosine * cosine
    s = np.where(square > PARALLEL**2, (cosine * other_along - along) / np.where(square > 0.0, square, 1.0), 0.0)
    s = np.clip(s, 0.0, length[:, None])
    t = np.clip(cosine * s + other_along, 0.0, other_length)
    s = np.clip(cosine * t - along, 0.0, length[:, None])
    apart = line + s[..., None] * direction[:, None] - t[..., None] * other_direction
    return np.sqrt(dots(apart, apart))


@dataclass(frozen=True, eq=False)
class _Meeting:
    """Two features that meet, or could.

    Of them are the unit `normal` (3,), their `gap`, their `margin` (see `NarrowPhase`), and the `point` (3,) at which
    they meet. Points and directions are those of `Features`, in ground's axes.
    """

    normal: Array
    gap: float
    margin: float
    point: Array
    points: tuple[Array, Array]
    directions: tuple[Array, Array]
    coefficients: tuple[float, float, float]
    on_second: bool = False


ZERO = np.zeros(3)
ON_FACE, ACROSS, APART = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


class PolytopePair:
    """Two polytopes: see `NarrowPhase`."""

    iterates = False

    def __init__(self, first: Solid, second: Solid, slots: int, still: int | None) -> None:
        """:param still: the axis of ground across which both are polygons; None in space."""
        self._first, self._second = (
            Polytope(each) if still is None else Polygon(each, still) for each in (first, second)
        )
        self._slots = slots
        self._radius = first.radius + second.radius
        self._solid = bool(first.faces or second.faces)
        self._last: tuple[Pose, Pose, tuple[_Placed, _Placed]] | None = None
        bodies = self._first, self._second
        self.bounds = Bounds(bodies[0].center, bodies[0].reach), Bounds(bodies[1].center, bodies[1].reach)

    def _placed(self, one: Pose, other: Pose) -> tuple[_Placed, _Placed]:
        """Both bodies; those of the last poses are kept, for all threads together."""
        last = self._last
        if last is None or last[0] is not one or last[1] is not other:
            placed = _Placed(self._first, one, other.position), _Placed(self._second, other, other.position)
            last = self._last = one, other, placed
        return last[2]

    def distance(self, one: Pose, other: Pose) -> float:
        """See `NarrowPhase`."""
        return self._gap(*self._placed(one, other))

    def _gap(self, a: _Placed, b: _Placed) -> float:
        apart = _separation(a, b) if self._solid or not self._radius else np.inf
        if self._radius and apart > 0.0:
            apart = _distance(a, b)
        return apart - self._radius

    def margin(self, one: Pose, other: Pose, numbers: Array) -> float:
        """See `NarrowPhase`."""
        a, b = self._placed(one, other)
        code = int(numbers[KEY]) - 1
        found = self._meeting(a, b, code // COUNT**2, code // COUNT % COUNT, code % COUNT)
        side = cross(turned(b.rotation, numbers[KEY - 3 : KEY]), found.normal)
        return min(found.margin, float(np.sqrt(dots(side, side))) - TURNED)

    def renewed(self, one: Pose, other: Pose, numbers: Array) -> Array:
        """See `NarrowPhase`."""
        return numbers

    def touching(self, one: Pose, other: Pose, tolerance: float) -> list[Features]:
        """See `NarrowPhase`."""
        a, b = self._placed(one, other)
        lowest = min(self._gap(a, b), 0.0) - SUPPORT * tolerance
        found: list[tuple[int, _Meeting]] = []
        for key in self._candidates(a, b, lowest, tolerance):
            meeting = self._meeting(a, b, *key)
            if not (lowest <= meeting.gap <= tolerance and meeting.margin >= -BORDER * tolerance):
                continue
            if self._support(a, b, meeting.normal) < lowest or _is_known(meeting, found, SUPPORT * tolerance):
                continue
            found.append((1 + (key[0] * COUNT + key[1]) * COUNT + key[2], meeting))
        if len(found) > self._slots:
            points = np.array([meeting.point for _, meeting in found])
            found = [found[index] for index in spread(points, self._slots)]
        return [self._features(a, b, *each) for each in found]

    def _support(self, a: _Placed, b: _Placed, normal: Array) -> float:
        """How far the planes across a normal that support both bodies are apart."""
        return float(dots(a.vertices, normal).min() - dots(b.vertices, normal).max()) - self._radius

    def _candidates(self, a: _Placed, b: _Placed, lowest: float, highest: float) -> Iterator[tuple[int, int, int]]:
        """The kinds and indices of pairs of features whose gaps are in a range, in a fixed order."""

        def within(distances: Array) -> list[tuple[int, int]]:
            gaps = distances - self._radius
            return [(i, j) for i, j in np.argwhere((gaps >= lowest) & (gaps <= highest)).tolist()]

        if b.body.faces:
            yield from ((VERTEX_FACE, vertex, face) for vertex, face in within(b.heights(a.vertices)))
        if a.body.faces:
            yield from ((FACE_VERTEX, face, vertex) for vertex, face in within(a.heights(b.vertices)))
        if self._radius:
            apart = a.vertices[:, None] - b.vertices
            yield from ((VERTEX_VERTEX, i, j) for i, j in within(np.sqrt(dots(apart, apart))))
            yield from ((VERTEX_EDGE, vertex, edge) for vertex, edge in within(_line_distances(a.vertices, b)))
            yield from ((EDGE_VERTEX, edge, vertex) for vertex, edge in within(_line_distances(b.vertices, a)))
        if len(a.body.edges) and len(b.body.edges):
            (start, direction, _), (other_start, other_direction, _) = a.segments(), b.segments()
            across = cross(direction[:, None], other_direction)
            size = np.sqrt(dots(across, across))
            between = np.abs(dots(across, start[:, None] - other_start)) / np.where(size > PARALLEL, size, 1.0)
            if not self._radius:  # of which the sign is not known yet
                between = np.where(between <= -lowest, 0.0, between)
            yield from ((EDGE_EDGE, i, j) for i, j in within(np.where(size > PARALLEL, between, np.inf)))

    def _meeting(self, a: _Placed, b: _Placed, kind: int, i: int, j: int) -> _Meeting:
        """The features of a kind with these indices."""
        match kind:
            case 0:  # VERTEX_FACE
                return self._on_face(a, b, i, j, first=True)
            case 1:  # FACE_VERTEX
                return self._on_face(b, a, j, i, first=False)
            case 2:  # EDGE_EDGE
                return self._edges(a, b, i, j)
            case 3:  # VERTEX_EDGE
                return self._at_edge(a, b, i, j, first=True)
            case 4:  # EDGE_VERTEX
                return self._at_edge(b, a, j, i, first=False)
            case _:  # VERTEX_VERTEX
                return self._at_vertex(a, b, i, j)

    def _on_face(self, one: _Placed, other: _Placed, vertex: int, face: int, *, first: bool) -> _Meeting:
        """A vertex of one body on a face of the other; `first`: the vertex is that of the first body."""
        point, normal = one.vertices[vertex], turned(other.rotation, other.body.normals[face])
        corner = other.vertices[other.body.faces[face][0]]
        gap = float(dots(point - corner, normal)) - self._radius
        margin = float(other.depths(point[None], face).min())
        if self._radius:
            margin = min(margin, self._lowest(one, vertex, normal))
        if first:
            return _Meeting(normal, gap, margin, point, (point, corner), (ZERO, normal), ON_FACE)
        return _Meeting(-normal, gap, margin, point, (corner, point), (-normal, ZERO), ON_FACE, True)

    def _lowest(self, one: _Placed, vertex: int, normal: Array) -> float:
        """How far a vertex is from where one of its edges comes nearer; `normal` points to its body."""
        edges = [turned(one.rotation, edge) for edge in one.body.from_vertices[vertex]]
        return self._radius * min((float(dots(edge, normal)) for edge in edges), default=1.0)

    def _edges(self, a: _Placed, b: _Placed, i: int, j: int) -> _Meeting:
        start, direction = a.vertices[a.body.edges[i][0]], turned(a.rotation, a.body.directions[i])
        other_start, other_direction = b.vertices[b.body.edges[j][0]], turned(b.rotation, b.body.directions[j])
        across, line = cross(direction, other_direction), start - other_start
        square = max(float(dots(across, across)), PARALLEL**2)
        cosine, along, beside = (
            float(dots(*pair)) for pair in ((direction, other_direction), (direction, line), (other_direction, line))
        )
        s, t = (cosine * beside - along) / square, (beside - cosine * along) / square
        point = start + s * direction
        apart = point - other_start - t * other_direction
        normal = across / np.sqrt(square)
        sign = self._sign(a, b, normal, float(dots(apart, normal)))
        normal, gap = sign * normal, sign * float(dots(apart, normal)) - self._radius
        lengths = float(a.body.lengths[i]), float(b.body.lengths[j])
        margin = min(s, lengths[0] - s, t, lengths[1] - t) if square > PARALLEL**2 else -1.0
        if self._radius:
            margin = min(margin, _outside(b, j, apart), _outside(a, i, -apart))
        directions = sign * direction, other_direction
        return _Meeting(normal, gap, margin, point, (start, other_start), directions, ACROSS)

    def _sign(self, a: _Placed, b: _Placed, normal: Array, apart: float) -> float:
        """Of the normal of two edges: it points to the first body."""
        if self._radius:
            return 1.0 if apart >= 0.0 else -1.0
        return 1.0 if self._support(a, b, normal) >= self._support(a, b, -normal) else -1.0

    def _at_edge(self, one: _Placed, other: _Placed, vertex: int, edge: int, *, first: bool) -> _Meeting:
        point, start = one.vertices[vertex], other.vertices[other.body.edges[edge][0]]
        direction = turned(other.rotation, other.body.directions[edge])
        line = point - start
        along = float(dots(direction, line))
        apart = line - along * direction
        size = float(np.sqrt(dots(apart, apart)))
        normal = apart / max(size, 1e-300)
        lowest = self._lowest(one, vertex, normal)
        margin = min(along, float(other.body.lengths[edge]) - along, lowest, _outside(other, edge, apart))
        gap = size - self._radius
        if first:
            return _Meeting(normal, gap, margin, point, (point, start), (ZERO, direction), APART)
        return _Meeting(-normal, gap, margin, point, (start, point), (direction, ZERO), APART, True)

    def _at_vertex(self, a: _Placed, b: _Placed, i: int, j: int) -> _Meeting:
        point, other = a.vertices[i], b.vertices[j]
        apart = point - other
        size = float(np.sqrt(dots(apart, apart)))
        normal = apart / max(size, 1e-300)
        margin = min(self._lowest(a, i, normal), self._lowest(b, j, -normal))
        return _Meeting(normal, size - self._radius, margin, point, (point, other), (ZERO, ZERO), APART)

    def _features(self, a: _Placed, b: _Placed, key: int, meeting: _Meeting) -> Features:
        """In the frames of the parts; the direction across the normal is the axis that is most across it."""
        points = [turned(body.rotation.T, p - body.position) for body, p in zip((a, b), meeting.points, strict=True)]
        directions = [turned(body.rotation.T, m) for body, m in zip((a, b), meeting.directions, strict=True)]
        own = np.abs(turned(b.rotation.T, meeting.normal))
        side = np.eye(3)[int(np.argmin(np.round(own, 9)))]
        radii = self._first.radius, self._second.radius
        return Features(
            key,
            (points[0], points[1]),
            (directions[0], directions[1]),
            meeting.coefficients,
            radii,
            meeting.on_second,
            side,
        )


def spread(points: Array, count: int) -> list[int]:
    """The places of so many points (n, 3), each the farthest from those before it; in order."""
    chosen = [0]
    nearest = np.full(len(points), np.inf)
    while len(chosen) < count:
        line = points - points[chosen[-1]]
        nearest = np.minimum(nearest, dots(line, line))
        chosen.append(int(np.argmax(nearest)))
    return sorted(chosen)


def _outside(body: _Placed, edge: int, line: Array) -> float:
    """How far a line (3,) from an edge leads away from the faces beside it."""
    inward = (turned(body.rotation, each) for each in body.body.beside_edges[edge])
    return min((-float(dots(line, each)) for each in inward), default=np.inf)


def _line_distances(points: Array, body: _Placed) -> Array:
    """The distances of points (n, 3) from the lines of edges (n, k); none where bodies have no edges."""
    starts, directions = (each[: len(body.body.edges)] for each in body.segments()[:2])
    line = points[:, None] - starts
    apart = line - dots(line, directions)[..., None] * directions
    return np.sqrt(dots(apart, apart))


def _is_known(meeting: _Meeting, found: list[tuple[int, _Meeting]], near: float) -> bool:
    """Whether a point at a vertex has been found at the same place."""
    for _, other in found:
        apart = meeting.point - other.point
        if other.coefficients != ACROSS and float(np.sqrt(dots(apart, apart))) <= near:
            return True
    return False
