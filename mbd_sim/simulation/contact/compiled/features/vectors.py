"""Vectors in space as three numbers of an array, and poses as `pack_poses` packs them.

All sums are written out: their bits do not depend on the processor.
"""

from __future__ import annotations

import math

from mbd_sim.compiler.ir.python_kinds import Array, Integers

TIE = 1e-9  # between parts of unit vectors that count as equal


def dot(a: Array, b: Array) -> float:
    """The dot product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def size_of(a: Array) -> float:
    """The length of a vector."""
    return math.sqrt(dot(a, a))


def cross(a: Array, b: Array, out: Array) -> None:
    """The cross product; `out` is another vector."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


def copy(a: Array, out: Array) -> None:
    """The same vector."""
    out[0], out[1], out[2] = a[0], a[1], a[2]


def add(a: Array, factor: float, b: Array, out: Array) -> None:
    """`out` = a + factor b."""
    for i in range(3):
        out[i] = a[i] + factor * b[i]


def subtract(a: Array, b: Array, out: Array) -> None:
    """`out` = a - b."""
    for i in range(3):
        out[i] = a[i] - b[i]


def scale(factor: float, a: Array, out: Array) -> None:
    """`out` = factor a."""
    for i in range(3):
        out[i] = factor * a[i]


def divide(a: Array, divisor: float) -> None:
    """Divide a vector."""
    for i in range(3):
        a[i] = a[i] / divisor


def distance_of(a: Array, b: Array) -> float:
    """The distance of two points."""
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return math.sqrt(x * x + y * y + z * z)


def turn(pose: Array, v: Array, out: Array) -> None:
    """A vector of a part in ground's axes; `out` is another vector."""
    for i in range(3):
        out[i] = v[0] * pose[3 + i] + v[1] * pose[6 + i] + v[2] * pose[9 + i]


def turn_back(pose: Array, v: Array, out: Array) -> None:
    """A vector in the axes of a part; `out` is another vector."""
    for j in range(3):
        out[j] = v[0] * pose[3 + 3 * j] + v[1] * pose[4 + 3 * j] + v[2] * pose[5 + 3 * j]


def place(pose: Array, point: Array, out: Array) -> None:
    """A point of a part in ground's axes."""
    turn(pose, point, out)
    for i in range(3):
        out[i] += pose[i]


def place_back(pose: Array, point: Array, out: Array) -> None:
    """A point in the frame of a part; `out` is another vector."""
    x, y, z = point[0] - pose[0], point[1] - pose[1], point[2] - pose[2]
    for j in range(3):
        out[j] = x * pose[3 + 3 * j] + y * pose[4 + 3 * j] + z * pose[5 + 3 * j]


def relative_pose(pose: Array, origin: Array, out: Array) -> None:
    """A pose with positions from an origin."""
    for i in range(3):
        out[i] = pose[i] - origin[i]
    for i in range(3, 12):
        out[i] = pose[i]


def least_axis(v: Array, out: Array) -> None:
    """The axis that is most across a unit vector; the first of several."""
    for i in range(3):
        out[i] = 0.0
    least = min(abs(v[0]), min(abs(v[1]), abs(v[2])))
    for i in range(3):
        if abs(v[i]) <= least + TIE:
            out[i] = 1.0
            return


def spread(points: Array, stride: int, n: int, count: int, chosen: Integers, nearest: Array) -> None:
    """Mark some of n points, each the farthest from those before it; the first one begins.

    :param nearest: memory (n,).
    """
    for i in range(n):
        chosen[i], nearest[i] = 0, math.inf
    latest = 0
    chosen[0] = 1
    for _ in range(1, count):
        farthest = 0
        for i in range(n):
            x = points[stride * i] - points[stride * latest]
            y = points[stride * i + 1] - points[stride * latest + 1]
            z = points[stride * i + 2] - points[stride * latest + 2]
            nearest[i] = min(nearest[i], x * x + y * y + z * z)
            if nearest[i] > nearest[farthest]:
                farthest = i
        latest = farthest
        chosen[latest] = 1
