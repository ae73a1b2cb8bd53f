"""The narrow phase of convex polytopes, which may be rounded by a radius: which of their features touch, and where.

See `polytope_distances` for how far they are apart.
"""

from __future__ import annotations

import math

from mbd_sim.compiler.ir.python_kinds import Array, Integers, integers, zeros
from mbd_sim.dynamics.contact.feature_rows import KEY, SLOT_SIZE
from mbd_sim.simulation.contact.compiled.features.polytope_distances import (
    PARALLEL,
    PlacedHull,
    Polytopes,
    depth,
    gap_of,
    highest,
    into_frame,
    lowest,
    put,
)
from mbd_sim.simulation.contact.compiled.features.vectors import (
    add,
    copy,
    cross,
    distance_of,
    divide,
    dot,
    least_axis,
    place_back,
    scale,
    size_of,
    spread,
    subtract,
    turn,
    turn_back,
)

BORDER = 0.5  # of the tolerance, by which a point may be beside its face or edge
SUPPORT = 4.0  # times the tolerance, by which a body may reach beyond a plane that supports it
WITHIN = 10.0  # times the tolerance, by which features that touch may be within each other by round-off
TURNED = 0.5  # sine of the angle between the normal and the stored direction across it, below which that is renewed
SLANTED, PASSED = 0.5, 0.1  # sine of the angle below which the crossing of edges can run, and how far of them in a step
TINY = 1e-300
VERTEX_FACE, FACE_VERTEX, EDGE_EDGE, VERTEX_EDGE, EDGE_VERTEX, VERTEX_VERTEX = 0, 1, 2, 3, 4, 5
COUNT = 1 << 15  # features of a kind
ON_FACE, ACROSS, APART = 0, 1, 2  # how a normal is found: see `feature_rows`
# Two features that meet, or could: their unit normal, their gap, their margin (see `NarrowPhase`) and the point at
# which they meet, in ground's axes; then points and directions of the slot, how the normal is found, whether the point
# is on the second body, and the key.
NORMAL, GAP, MARGIN, POINT, POINTS, DIRECTIONS, FORM, ON_SECOND, OWN_KEY = 0, 3, 4, 5, 8, 14, 20, 21, 22
MEETING = 23


def polytope_margin(p: Polytopes, one: Array, other: Array, numbers: Array, spot: Array) -> float:
    """See `NarrowPhase`, and `SPOT` in `pairs`."""
    a = PlacedHull(p.first, zeros(12), zeros(3 * p.first.count))
    b = PlacedHull(p.second, zeros(12), zeros(3 * p.second.count))
    found, stored, side = zeros(MEETING), zeros(3), zeros(3)
    put(a, one, other)
    put(b, other, other)
    code = int(numbers[KEY]) - 1
    meet(p, a, b, code // (COUNT * COUNT), code // COUNT % COUNT, code % COUNT, found)
    turn(b.pose, numbers[KEY - 3 :], stored)
    cross(stored, found[NORMAL:], side)
    copy(found[POINT:], spot)
    copy(found[NORMAL:], spot[3:])
    spot[6] = found[GAP]
    return min(min(found[MARGIN], size_of(side) - TURNED), room_along(a, b, code, numbers, found))


def room_along(a: PlacedHull, b: PlacedHull, code: int, numbers: Array, meeting: Array) -> float:
    """How far in m the crossing of two edges may still run along them before the step ends.

    It runs the faster, with the larger forces, the nearer to parallel they are.
    """
    own, across, i, j = zeros(3), zeros(3), code // COUNT % COUNT, code % COUNT
    if code // (COUNT * COUNT) != EDGE_EDGE:
        return math.inf
    cross(meeting[DIRECTIONS:], meeting[DIRECTIONS + 3 :], across)
    if size_of(across) > SLANTED:
        return math.inf
    place_back(a.pose, meeting[POINTS:], own)
    found = PASSED * a.hull.lengths[i] - distance_of(own, numbers)
    place_back(b.pose, meeting[POINTS + 3 :], own)
    return min(found, PASSED * b.hull.lengths[j] - distance_of(own, numbers[3:]))


def polytope_touching(p: Polytopes, one: Array, other: Array, tolerance: float, slots: Array) -> int:
    """See `NarrowPhase`."""
    a = PlacedHull(p.first, zeros(12), zeros(3 * p.first.count))
    b = PlacedHull(p.second, zeros(12), zeros(3 * p.second.count))
    put(a, one, other)
    put(b, other, other)
    most = 4 * (p.first.count + p.second.count)
    meetings, chosen, nearest, count = zeros(MEETING * (most + 1)), integers(most + 1), zeros(most + 1), integers(1)
    bottom = min(gap_of(p, a, b), 0.0) - SUPPORT * tolerance
    find_corners(p, a, b, bottom, tolerance, meetings, count, most)
    if p.radius != 0.0:
        find_apart(p, a, b, bottom, tolerance, meetings, count, most)
    find_crossings(p, a, b, bottom, tolerance, meetings, count, most)
    if count[0] > p.slots:
        spread(meetings[POINT:], MEETING, count[0], p.slots, chosen, nearest)
    found = 0
    for k in range(count[0]):
        if count[0] <= p.slots or chosen[k]:
            write_slot(p, a, b, meetings[MEETING * k :], slots[SLOT_SIZE * found :])
            found += 1
    return found


def find_corners(
    p: Polytopes, a: PlacedHull, b: PlacedHull, bottom: float, top: float, meetings: Array, count: Integers, most: int
) -> None:  # fmt: skip
    """Find the vertices on faces."""
    own, other = zeros(3 * a.hull.count), zeros(3 * b.hull.count)
    into_frame(a, b, own)
    into_frame(b, a, other)
    for i in range(a.hull.count):
        for face in range(b.hull.faces):
            apart = dot(own[3 * i :], b.hull.normals[3 * face :]) - b.hull.offsets[face] - p.radius
            if bottom <= apart <= top:
                consider(p, a, b, VERTEX_FACE, i, face, bottom, top, meetings, count, most)
    for i in range(b.hull.count):
        for face in range(a.hull.faces):
            apart = dot(other[3 * i :], a.hull.normals[3 * face :]) - a.hull.offsets[face] - p.radius
            if bottom <= apart <= top:
                consider(p, a, b, FACE_VERTEX, face, i, bottom, top, meetings, count, most)


def find_apart(
    p: Polytopes, a: PlacedHull, b: PlacedHull, bottom: float, top: float, meetings: Array, count: Integers, most: int
) -> None:  # fmt: skip
    """Find vertices near vertices and edges, of rounded bodies."""
    for i in range(a.hull.count):
        for j in range(b.hull.count):
            if bottom <= distance_of(a.vertices[3 * i :], b.vertices[3 * j :]) - p.radius <= top:
                consider(p, a, b, VERTEX_VERTEX, i, j, bottom, top, meetings, count, most)
    for i in range(a.hull.count):
        for edge in range(b.hull.edges):
            if bottom <= line_distance(a.vertices[3 * i :], b, edge) - p.radius <= top:
                consider(p, a, b, VERTEX_EDGE, i, edge, bottom, top, meetings, count, most)
    for i in range(b.hull.count):
        for edge in range(a.hull.edges):
            if bottom <= line_distance(b.vertices[3 * i :], a, edge) - p.radius <= top:
                consider(p, a, b, EDGE_VERTEX, edge, i, bottom, top, meetings, count, most)


def find_crossings(
    p: Polytopes, a: PlacedHull, b: PlacedHull, bottom: float, top: float, meetings: Array, count: Integers, most: int
) -> None:  # fmt: skip
    """Find edges that cross."""
    direction, other, across, line = zeros(3), zeros(3), zeros(3), zeros(3)
    for i in range(a.hull.edges):
        turn(a.pose, a.hull.directions[3 * i :], direction)
        for j in range(b.hull.edges):
            turn(b.pose, b.hull.directions[3 * j :], other)
            cross(direction, other, across)
            size = size_of(across)
            if size > PARALLEL:
                subtract(a.vertices[3 * a.hull.ends[2 * i] :], b.vertices[3 * b.hull.ends[2 * j] :], line)
                apart = abs(dot(across, line)) / size
                if p.radius == 0.0 and apart <= -bottom:  # of which the sign is not known yet
                    apart = 0.0
                if bottom <= apart - p.radius <= top:
                    consider(p, a, b, EDGE_EDGE, i, j, bottom, top, meetings, count, most)


def consider(
    p: Polytopes, a: PlacedHull, b: PlacedHull, kind: int, i: int, j: int, bottom: float, top: float,
    meetings: Array, count: Integers, most: int,
) -> None:  # fmt: skip
    """Add two features that meet, unless a vertex has been found at this place."""
    found = meetings[MEETING * count[0] :]
    meet(p, a, b, kind, i, j, found)
    if not (bottom <= found[GAP] <= top and found[MARGIN] >= -BORDER * top) or count[0] == most:
        return
    if support(p, a, b, found[NORMAL:]) < bottom:
        return
    for k in range(count[0]):
        known = meetings[MEETING * k :]
        if known[FORM] != ACROSS and distance_of(found[POINT:], known[POINT:]) <= SUPPORT * top:
            return
    count[0] += 1


def support(p: Polytopes, a: PlacedHull, b: PlacedHull, normal: Array) -> float:
    """How far the planes across a normal that support both bodies are apart."""
    return lowest(a, normal) - highest(b, normal) - p.radius


def line_distance(point: Array, body: PlacedHull, edge: int) -> float:
    """The distance of a point from the line of an edge."""
    direction, line = zeros(3), zeros(3)
    turn(body.pose, body.hull.directions[3 * edge :], direction)
    subtract(point, body.vertices[3 * body.hull.ends[2 * edge] :], line)
    add(line, -dot(line, direction), direction, line)
    return size_of(line)


def meet(p: Polytopes, a: PlacedHull, b: PlacedHull, kind: int, i: int, j: int, out: Array) -> None:
    """The features of a kind with these indices; see `MEETING`."""
    for k in range(MEETING):
        out[k] = 0.0
    out[OWN_KEY] = 1 + (kind * COUNT + i) * COUNT + j
    if kind == VERTEX_FACE:
        meet_face(p, a, b, i, j, 1.0, out)
    elif kind == FACE_VERTEX:
        meet_face(p, b, a, j, i, -1.0, out)
    elif kind == EDGE_EDGE:
        meet_edges(p, a, b, i, j, out)
    elif kind == VERTEX_EDGE:
        meet_edge(p, a, b, i, j, 1.0, out)
    elif kind == EDGE_VERTEX:
        meet_edge(p, b, a, j, i, -1.0, out)
    else:
        meet_vertices(p, a, b, i, j, out)


def write_points(sign: float, point: Array, other: Array, direction: Array, out: Array) -> None:
    """Write a point of one body, and a point and a direction of the other, which is the second one if `sign` is 1."""
    own = 0 if sign > 0.0 else 3
    copy(point, out[POINT:])
    copy(point, out[POINTS + own :])
    copy(other, out[POINTS + 3 - own :])
    copy(direction, out[DIRECTIONS + 3 - own :])
    out[ON_SECOND] = 0.0 if sign > 0.0 else 1.0


def meet_face(p: Polytopes, one: PlacedHull, other: PlacedHull, i: int, face: int, sign: float, out: Array) -> None:
    """A vertex of one body on a face of the other; `sign` is 1 if the vertex is that of the first body."""
    normal, own, line = zeros(3), zeros(3), zeros(3)
    point, corner = one.vertices[3 * i :], other.vertices[3 * other.hull.firsts[face] :]
    turn(other.pose, other.hull.normals[3 * face :], normal)
    subtract(point, corner, line)
    out[GAP] = dot(line, normal) - p.radius
    place_back(other.pose, point, own)
    out[MARGIN] = depth(other.hull, face, own)
    if p.radius != 0.0:
        out[MARGIN] = min(out[MARGIN], lowest_edge(p, one, i, normal, 1.0))
    scale(sign, normal, out[NORMAL:])
    write_points(sign, point, corner, out[NORMAL:], out)
    out[FORM] = ON_FACE


def lowest_edge(p: Polytopes, one: PlacedHull, vertex: int, normal: Array, sign: float) -> float:
    """How far a vertex is from where one of its edges comes nearer; the normal times `sign` points to its body."""
    found, edge, hull = math.inf, zeros(3), one.hull
    for k in range(hull.leaving_first[vertex], hull.leaving_first[vertex + 1]):
        turn(one.pose, hull.leaving[3 * k :], edge)
        found = min(found, sign * dot(edge, normal))
    return p.radius * (found if found < math.inf else 1.0)


def outside(body: PlacedHull, edge: int, line: Array, sign: float) -> float:
    """How far a line from an edge, times `sign`, leads away from the faces beside it."""
    found, inward, hull = math.inf, zeros(3), body.hull
    for k in range(hull.beside_first[edge], hull.beside_first[edge + 1]):
        turn(body.pose, hull.beside[3 * k :], inward)
        found = min(found, -sign * dot(line, inward))
    return found


def meet_edges(p: Polytopes, a: PlacedHull, b: PlacedHull, i: int, j: int, out: Array) -> None:
    """Two edges that cross."""
    start, other_start = a.vertices[3 * a.hull.ends[2 * i] :], b.vertices[3 * b.hull.ends[2 * j] :]
    direction, other, across, line, apart = zeros(3), zeros(3), zeros(3), zeros(3), zeros(3)
    turn(a.pose, a.hull.directions[3 * i :], direction)
    turn(b.pose, b.hull.directions[3 * j :], other)
    cross(direction, other, across)
    subtract(start, other_start, line)
    square = max(dot(across, across), PARALLEL * PARALLEL)
    cosine, along, beside = dot(direction, other), dot(direction, line), dot(other, line)
    s, t = (cosine * beside - along) / square, (beside - cosine * along) / square
    add(start, s, direction, out[POINT:])
    for k in range(3):
        apart[k] = out[POINT + k] - other_start[k] - t * other[k]
    divide(across, math.sqrt(square))
    height = dot(apart, across)
    sign = sign_of(p, a, b, across, height)
    scale(sign, across, out[NORMAL:])
    out[GAP] = sign * height - p.radius
    out[MARGIN] = -1.0
    if square > PARALLEL * PARALLEL:
        out[MARGIN] = min(min(s, a.hull.lengths[i] - s), min(t, b.hull.lengths[j] - t))
    if p.radius != 0.0:
        out[MARGIN] = min(out[MARGIN], min(outside(b, j, apart, 1.0), outside(a, i, apart, -1.0)))
    copy(out[POINT:], out[POINTS:])
    add(other_start, t, other, out[POINTS + 3 :])
    scale(sign, direction, out[DIRECTIONS:])
    copy(other, out[DIRECTIONS + 3 :])
    out[FORM] = ACROSS


def sign_of(p: Polytopes, a: PlacedHull, b: PlacedHull, normal: Array, height: float) -> float:
    """Of the normal of two edges: it points to the first body."""
    reverse = zeros(3)
    if p.radius != 0.0:
        return 1.0 if height >= 0.0 else -1.0
    scale(-1.0, normal, reverse)
    return 1.0 if support(p, a, b, normal) >= support(p, a, b, reverse) else -1.0


def meet_edge(p: Polytopes, one: PlacedHull, other: PlacedHull, i: int, edge: int, sign: float, out: Array) -> None:
    """A vertex of one body near an edge of the other; `sign` is 1 if the vertex is that of the first body."""
    direction, apart, normal = zeros(3), zeros(3), zeros(3)
    point, start = one.vertices[3 * i :], other.vertices[3 * other.hull.ends[2 * edge] :]
    turn(other.pose, other.hull.directions[3 * edge :], direction)
    subtract(point, start, apart)
    along = dot(direction, apart)
    add(apart, -along, direction, apart)
    size = size_of(apart)
    copy(apart, normal)
    divide(normal, max(size, TINY))
    out[GAP] = size - p.radius
    out[MARGIN] = min(
        min(along, other.hull.lengths[edge] - along),
        min(lowest_edge(p, one, i, normal, 1.0), outside(other, edge, apart, 1.0)),
    )
    scale(sign, normal, out[NORMAL:])
    write_points(sign, point, start, direction, out)
    out[FORM] = APART


def meet_vertices(p: Polytopes, a: PlacedHull, b: PlacedHull, i: int, j: int, out: Array) -> None:
    """Two vertices near each other."""
    point, other, normal = a.vertices[3 * i :], b.vertices[3 * j :], out[NORMAL:]
    subtract(point, other, normal)
    size = size_of(normal)
    divide(normal, max(size, TINY))
    out[GAP] = size - p.radius
    out[MARGIN] = min(lowest_edge(p, a, i, normal, 1.0), lowest_edge(p, b, j, normal, -1.0))
    copy(point, out[POINT:])
    copy(point, out[POINTS:])
    copy(other, out[POINTS + 3 :])
    out[FORM] = APART


def write_slot(p: Polytopes, a: PlacedHull, b: PlacedHull, meeting: Array, slot: Array) -> None:
    """The numbers of a slot: see `mbd_sim.dynamics.contact.feature_rows`."""
    own = zeros(3)
    place_back(a.pose, meeting[POINTS:], slot)
    place_back(b.pose, meeting[POINTS + 3 :], slot[3:])
    turn_back(a.pose, meeting[DIRECTIONS:], slot[6:])
    turn_back(b.pose, meeting[DIRECTIONS + 3 :], slot[9:])
    for k in range(3):
        slot[12 + k] = 1.0 if meeting[FORM] == k else 0.0
    slot[15], slot[16], slot[17] = p.radii[0], p.radii[1], meeting[ON_SECOND]
    turn_back(b.pose, meeting[NORMAL:], own)
    least_axis(own, slot[18:])
    slot[KEY] = meeting[OWN_KEY]
