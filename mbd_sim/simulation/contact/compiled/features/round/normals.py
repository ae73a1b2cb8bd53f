"""The normals at which two round bodies can meet: those of faces and of pairs of sides, and those that are iterated.

Along a unit normal n, the planes that support both bodies are s(n) = -h_A(-n) - h_B(n) apart. Of two corners, or of a
side and a corner, s(n) is largest at a normal that Newton's method finds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from mbd_sim.compiler.ir.python_kinds import Array, Integers, zeros
from mbd_sim.simulation.contact.compiled.features.round.bodies import (
    PlacedRound,
    RoundHull,
    add_bend,
    nearest_on_ellipsoid,
    offset,
    reach,
    tilt,
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

CORNER_FACE, FACE_CORNER, SIDE_SIDE, SIDE_CORNER = 0, 1, 2, 3
CORNER_SIDE, CORNER_CORNER, POINT_FACE, FACE_POINT = 4, 5, 6, 7
EDGE_RIM, RIM_EDGE = 8, 9  # an edge or a round side that crosses the rim of an end: see `crossings` and `rims`
PARALLEL = 1e-9  # sine of the angle below which directions count as parallel
ITERATIONS, HALVINGS = 15, 6
CONVERGED = 1e-9  # change of a normal, after which it is exact to round-off
LARGEST_STEP = 0.5  # rad
WORSE = 1e-14  # of a gap, by which it may be less after a step
MORE = 1e-12  # of the distance of two corners, by which a gap is larger along a better normal
AT_AXIS, BESIDE_AXIS = (
    1e-6,
    0.05,
)  # sines of the tilt against the axis of a rim, of a normal that is there, and beside it
STARTS = 26  # directions to the sides, edges and corners of a cube
KEY = 4  # numbers of a pair of features: its kind, both features, and the sign of one of two normals
KIND, FIRST, SECOND, SIGN = 0, 1, 2, 3


@dataclass(frozen=True)
class RoundBodies:
    """Two bodies. Points within `near` are one; `keys` are the pairs of features whose normal is iterated."""

    first: RoundHull
    second: RoundHull
    radius: float
    near: float
    reach: float
    slots: int
    count: int
    keys: Integers


@dataclass(frozen=True)
class Iteration:
    """Two corners and the side that bounds their normal, if there is one: `direction`, the `numbers` cosine and scale.

    The `line` is that from the corner of the second body to that of the first one.
    """

    a: PlacedRound
    b: PlacedRound
    corner_a: int
    corner_b: int
    line: Array
    direction: Array
    numbers: Array


def support(p: RoundBodies, a: PlacedRound, b: PlacedRound, normal: Array) -> float:
    """s(n)."""
    return -reach(a, normal, -1.0) - reach(b, normal, 1.0) - p.radius


def start_direction(number: int, out: Array) -> None:
    """A direction to a side, an edge or a corner of a cube."""
    place = number if number < STARTS // 2 else number + 1
    out[0], out[1], out[2] = place // 9 - 1.0, place // 3 % 3 - 1.0, place % 3 - 1.0
    divide(out, size_of(out))


def key_at(p: RoundBodies, index: int, key: Integers) -> None:
    """The pair of features with this index: faces of the second body and of the first, pairs of sides, others."""
    faces, all_faces = p.second.faces, p.second.faces + p.first.faces
    pairs = p.first.sides * p.second.sides
    key[FIRST], key[SECOND], key[SIGN] = -1, -1, 0
    if index < faces:
        key[KIND], key[SECOND] = CORNER_FACE, index
    elif index < all_faces:
        key[KIND], key[FIRST] = FACE_CORNER, index - faces
    elif index < all_faces + 2 * pairs:
        rest = index - all_faces
        key[KIND], key[SIGN] = SIDE_SIDE, -1 if rest < pairs else 1
        if rest >= pairs:
            rest -= pairs
        key[FIRST], key[SECOND] = rest // p.second.sides, rest % p.second.sides
    else:
        rest = index - all_faces - 2 * pairs
        for k in range(KEY):
            key[k] = p.keys[KEY * rest + k]


def simple_count(p: RoundBodies) -> int:
    """The number of pairs of features whose normal is not iterated."""
    return p.first.faces + p.second.faces + 2 * p.first.sides * p.second.sides


def simple_normal(a: PlacedRound, b: PlacedRound, key: Integers, out: Array) -> bool:
    """The normal of a face, or of two sides if they have one."""
    if key[KIND] in (CORNER_FACE, POINT_FACE):
        copy(b.normals[3 * key[SECOND] :], out)
        return True
    if key[KIND] in (FACE_CORNER, FACE_POINT):
        scale(-1.0, a.normals[3 * key[FIRST] :], out)
        return True
    return across_both(a, b, key, out)


def across_both(a: PlacedRound, b: PlacedRound, key: Integers, out: Array) -> bool:
    """The unit vector n with n·d_B = k_B and n·d_A = -k_A, and a sign; False where there is none."""
    i, j, across = key[FIRST], key[SECOND], zeros(3)
    d_a, d_b, k_a, k_b = a.directions[3 * i :], b.directions[3 * j :], a.hull.cosines[i], b.hull.cosines[j]
    cosine = dot(d_a, d_b)
    cross(d_b, d_a, across)
    square = dot(across, across)
    if not square > PARALLEL * PARALLEL:
        return False
    alpha, beta = (k_b + k_a * cosine) / square, -(k_a + k_b * cosine) / square
    rest = 1.0 - (alpha * alpha + beta * beta + 2.0 * alpha * beta * cosine)
    if not rest >= 0.0:
        return False
    size = key[SIGN] * math.sqrt(rest / square)
    for k in range(3):
        out[k] = alpha * d_b[k] + beta * d_a[k] + size * across[k]
    return True


def begin_iteration(m: Iteration, key: Integers) -> None:
    """Find the direction and the numbers of a pair of features."""
    cosine = 0.0
    for k in range(3):
        m.direction[k] = 0.0
    if key[KIND] == SIDE_CORNER:
        copy(m.a.directions[3 * key[FIRST] :], m.direction)
        cosine = -m.a.hull.cosines[key[FIRST]]
    if key[KIND] == CORNER_SIDE:
        copy(m.b.directions[3 * key[SECOND] :], m.direction)
        cosine = m.b.hull.cosines[key[SECOND]]
    m.numbers[0], m.numbers[1] = cosine, math.sqrt(1.0 - cosine * cosine)
    subtract(m.a.corners[3 * m.corner_a :], m.b.corners[3 * m.corner_b :], m.line)


def normal_from(m: Iteration, across: Array, out: Array) -> None:
    """The normal with its part across the direction of the side."""
    for k in range(3):
        out[k] = m.numbers[0] * m.direction[k] + m.numbers[1] * across[k]


def slope_at(m: Iteration, normal: Array, out: Array) -> None:
    """From the point of the second body that touches along a normal to that of the first one, without rounding."""
    arm, other = zeros(3), zeros(3)
    offset(m.a, m.corner_a, normal, arm)
    offset(m.b, m.corner_b, normal, other)
    for k in range(3):
        out[k] = m.line[k] - (arm[k] + other[k])


def value_at(m: Iteration, normal: Array) -> float:
    """The gap along a normal."""
    slope = zeros(3)
    slope_at(m, normal, slope)
    return dot(normal, slope)


def iterated_normal(a: PlacedRound, b: PlacedRound, key: Integers, start: Array, has_start: bool, out: Array) -> None:
    """The normal at which the gap of two features is largest, from a `start`, or from the best of some directions.

    Near the axis of a rim, steps from elsewhere lead past the normal; so what is toward the other corner is tried too.
    That of a point and a rim needs no steps.
    """
    corner_a = a.hull.ends[2 * key[FIRST]] if key[KIND] == SIDE_CORNER else key[FIRST]
    corner_b = b.hull.ends[2 * key[SECOND]] if key[KIND] == CORNER_SIDE else key[SECOND]
    m = Iteration(a, b, corner_a, corner_b, zeros(3), zeros(3), zeros(2))
    across, toward, best = zeros(3), zeros(3), zeros(1)
    begin_iteration(m, key)
    if key[KIND] == CORNER_CORNER and is_point_at_rim(a, corner_a, b, corner_b):
        nearest_normal(m, out)
        return
    if has_start:
        copy(start, across)
    else:
        best_start(m, across)
    add(across, -dot(m.direction, across), m.direction, across)
    divide(across, size_of(across))
    climb(m, across, best)
    slope_at(m, m.line, out)
    size = size_of(out)
    if size > 0.0:
        divide(out, size)
        admit(m, out, toward)
        climb_from(m, toward, across, best)
    if key[KIND] == CORNER_CORNER and normal_beside_ellipsoid(m, out):
        admit(m, out, toward)
        climb_from(m, toward, across, best)
    leave_axis(m, a, corner_a, b, corner_b, across, best)
    leave_axis(m, b, corner_b, a, corner_a, across, best)
    normal_from(m, across, out)


def normal_beside_ellipsoid(m: Iteration, out: Array) -> bool:
    """The normal of a point and an ellipsoid; False for other corners. From elsewhere steps miss that of a thin one."""
    arm, back = zeros(3), zeros(3)
    if m.a.hull.faces == 0 and m.a.hull.is_curved and not m.b.hull.curved[m.corner_b]:
        scale(-1.0, m.line, back)
        nearest_on_ellipsoid(m.a, m.corner_a, back, arm, back)
        scale(-1.0, back, out)
        return True
    if m.b.hull.faces == 0 and m.b.hull.is_curved and not m.a.hull.curved[m.corner_a]:
        nearest_on_ellipsoid(m.b, m.corner_b, m.line, arm, out)
        return True
    return False


def leave_axis(
    m: Iteration, body: PlacedRound, corner: int, other: PlacedRound, opposite: int, across: Array, best: Array
) -> None:
    """From the axis of a rim, where its support has a kink and steps stay, start anew beside it, toward the other body.

    :param opposite: the corner of the other body.
    """
    normal, arm, level, start, found = zeros(3), zeros(3), zeros(3), zeros(3), zeros(1)
    normal_from(m, across, normal)
    if body.hull.faces == 0 or not body.hull.curved[corner] or tilt(body, corner, normal) > AT_AXIS:
        return
    offset(other, opposite, normal, arm)
    subtract(m.line, arm, arm)
    add(arm, -dot(body.normals, arm), body.normals, level)
    size = size_of(level)
    if not size > body.hull.rims[corner]:  # the end is nearer
        return
    add(normal, BESIDE_AXIS / size, level, arm)
    admit(m, arm, start)
    climb(m, start, found)
    if found[0] > best[0]:
        copy(start, across)
        best[0] = found[0]


def climb_from(m: Iteration, start: Array, across: Array, best: Array) -> None:
    """Let another start take the place of what was found until now, if its gap is larger."""
    normal = zeros(3)
    normal_from(m, start, normal)
    if value_at(m, normal) > best[0] + MORE * size_of(m.line):
        copy(start, across)
        climb(m, across, best)


def is_point_at_rim(a: PlacedRound, corner_a: int, b: PlacedRound, corner_b: int) -> bool:
    """Whether one of two corners is a point, and the other one a rim."""
    if a.hull.curved[corner_a]:
        return a.hull.faces > 0 and not b.hull.curved[corner_b]
    return b.hull.faces > 0 and b.hull.curved[corner_b] != 0


def nearest_normal(m: Iteration, out: Array) -> None:
    """The normal of a point and a rim: from the nearest point of the rim, or that of its plane if this is within it."""
    arm, other, outward = zeros(3), zeros(3), zeros(3)
    offset(m.a, m.corner_a, m.line, arm)
    offset(m.b, m.corner_b, m.line, other)
    add(arm, 1.0, other, arm)
    radius = size_of(arm)
    scale(1.0 / radius if radius > 0.0 else 0.0, arm, outward)
    subtract(m.line, arm, out)
    if not dot(outward, m.line) > radius:
        add(m.line, -dot(outward, m.line), outward, out)
    if size_of(out) > 0.0:
        divide(out, size_of(out))
    elif m.b.hull.curved[m.corner_b]:
        copy(m.b.normals, out)
    else:
        scale(-1.0, m.a.normals, out)


def climb(m: Iteration, across: Array, best: Array) -> None:
    """Change the part of the normal across the side until the gap, which is the `best`, is largest."""
    normal = zeros(3)
    normal_from(m, across, normal)
    best[0] = value_at(m, normal)
    for _ in range(ITERATIONS):
        if improve(m, across, best) <= CONVERGED:
            break


def best_start(m: Iteration, out: Array) -> None:
    """The best of some directions across the side, as a part of the normal."""
    tried, across, normal, best = zeros(3), zeros(3), zeros(3), -math.inf
    size = size_of(m.line)
    for number in range(-1, STARTS):
        if number < 0 and size > 0.0:
            copy(m.line, tried)
            divide(tried, size)
        else:
            start_direction(max(number, 0), tried)
        admit(m, tried, across)
        normal_from(m, across, normal)
        found = value_at(m, normal)
        if found > best:
            best = found
            copy(normal, out)


def admit(m: Iteration, tried: Array, out: Array) -> None:
    """The part of a direction across that of the side; of one along it, any part across it."""
    spare, start = zeros(3), zeros(3)
    add(tried, -dot(tried, m.direction), m.direction, out)
    size = size_of(out)
    if size > PARALLEL:
        divide(out, size)
        return
    least_axis(m.direction, spare)
    cross(m.direction, spare, start)
    copy(start, out)
    divide(out, size_of(out))


def improve(m: Iteration, across: Array, best: Array) -> float:
    """Change the part of the normal across the side by a step of Newton's method, or a shorter one; its size."""
    bound, least, one, other = dot(m.direction, m.direction), zeros(3), zeros(3), zeros(3)
    normal, slope, gradient, step, tried, moved = zeros(3), zeros(3), zeros(2), zeros(2), zeros(3), zeros(3)
    if bound > 0.0:
        cross(m.direction, across, one)
    else:
        least_axis(across, least)
        cross(least, across, one)
    divide(one, size_of(one))
    cross(across, one, other)
    scale(1.0 if bound == 0.0 else 0.0, other, other)
    normal_from(m, across, normal)
    slope_at(m, normal, slope)
    gradient[0], gradient[1] = m.numbers[1] * dot(one, slope), m.numbers[1] * dot(other, slope)
    newton_step(m, normal, one, other, gradient, dot(across, slope), bound == 0.0, step)
    factor, value = 1.0, best[0]
    copy(across, moved)
    for _ in range(HALVINGS):
        for k in range(3):
            tried[k] = across[k] + factor * (step[0] * one[k] + step[1] * other[k])
        divide(tried, size_of(tried))
        normal_from(m, tried, normal)
        value = value_at(m, normal)
        if not value < best[0] - WORSE * abs(best[0]):
            copy(tried, moved)
            break
        factor *= 0.5
    change = 0.0
    for k in range(3):
        change = max(change, abs(moved[k] - across[k]))
    copy(moved, across)
    best[0] = max(value, best[0])
    return change


def newton_step(
    m: Iteration, normal: Array, one: Array, other: Array, gradient: Array, height: float, is_free: bool, step: Array
) -> None:
    """The step along two tangents; along the gradient where the Hessian is not negative definite."""
    bend, factor = zeros(9), m.numbers[1] * m.numbers[1]
    add_bend(m.a, m.corner_a, normal, bend)
    add_bend(m.b, m.corner_b, normal, bend)
    drop = m.numbers[1] * height
    h11, h12 = factor * curvature(bend, one, one) - drop, factor * curvature(bend, one, other)
    h22 = factor * curvature(bend, other, other) - drop if is_free else -1.0
    determinant = h11 * h22 - h12 * h12
    if h11 < 0.0 and determinant > 0.0:
        step[0] = (h12 * gradient[1] - h22 * gradient[0]) / determinant
        step[1] = (h12 * gradient[0] - h11 * gradient[1]) / determinant
        size = math.sqrt(step[0] * step[0] + step[1] * step[1])
        shorter = min(1.0, LARGEST_STEP / size) if size > 0.0 else 1.0
    else:
        size = math.sqrt(gradient[0] * gradient[0] + gradient[1] * gradient[1])
        step[0], step[1] = gradient[0], gradient[1]
        shorter = LARGEST_STEP / size if size > 0.0 else 1.0
    step[0], step[1] = step[0] * shorter, step[1] * shorter


def curvature(bend: Array, left: Array, right: Array) -> float:
    """left · bend right."""
    product = zeros(3)
    for row in range(3):
        product[row] = dot(bend[3 * row :], right)
    return dot(left, product)
