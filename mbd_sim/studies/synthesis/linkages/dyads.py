"""Dyads that lead a body through given poses in the plane: Burmester's theory in complex numbers.

A point p of the body, given in the first pose, and a fixed point c are joined by a link if the distance of both is the
same in all poses. With the displacements z -> A z + B from the first pose, that is for each further pose

    |B|²/2 + Re(conj(B) A p) - Re(conj(c) B) - Re(conj(c) (A - 1) p) = 0,

which is linear in p and in c (Sandor & Erdman 1984, ch. 3; McCarthy & Soh 2011, ch. 5). Three poses give one circle
point p for each center c, and the reverse; four poses curves of both; five poses up to four pairs. Points at infinity
are sliders: a point of the body on a straight line ("PR"), and a line of the body through a fixed point ("RP").
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array

Complexes = NDArray[np.complex128]
Kind = Literal["RR", "PR", "RP"]

FAR = 1e5  # sizes of the problem, beyond which points count as infinite
REAL = 1e-6  # imaginary part of a root that is real to round-off, relative to its size
EXACT = 1e-9  # residual of a dyad, relative to the squared size
SAME = 1e-6  # distance of two solutions that are one, relative to the size
ITERATIONS = 20  # of Newton's method
RAYS = 180  # through the middle of the poles, on which the curves for four poses are searched
TINY = 1e-12


@dataclass(frozen=True)
class PlanePose:
    """A pose of a body: the position `x`, `y` of its origin in m, and its `angle` in rad."""

    x: float
    y: float
    angle: float

    @property
    def origin(self) -> complex:
        """Its origin in the complex plane."""
        return complex(self.x, self.y)

    @property
    def turn(self) -> complex:
        """The unit number of its angle."""
        return complex(np.exp(1j * self.angle))


@dataclass(frozen=True)
class Dyad:
    """A link or slider between ground and the body.

    - "RR": a link from the fixed pivot `center` to the body's point `point`, given where it is in the first pose.
    - "PR": the point `point` of the body moves along a fixed line in the `direction`; `center` is `point`.
    - "RP": a line of the body, with the `direction` in the first pose, passes through the fixed pivot `center`; `point`
      is `center`.
    """

    kind: Kind
    center: complex
    point: complex
    direction: complex = 0j

    @property
    def length(self) -> float:
        """The length of the link in m; 0 for sliders."""
        return abs(self.point - self.center)


@dataclass(frozen=True, eq=False)
class Displacements:
    """The displacements z -> turns z + shifts (n,) of a body from its first pose, which is the first of them."""

    turns: Complexes
    shifts: Complexes

    def of(self, point: complex) -> Complexes:
        """Where a point of the body is (n,), given where it is in the first pose."""
        return np.asarray(self.turns * point + self.shifts)

    @property
    def size(self) -> float:
        """A length of the problem: the largest shift, or that of a turn by one radian."""
        return float(np.max(np.abs(self.shifts))) or 1.0

    @property
    def inverse(self) -> Displacements:
        """Those of ground as seen from the body."""
        return Displacements(1.0 / self.turns, -self.shifts / self.turns)


def displacements_of(poses: Sequence[PlanePose]) -> Displacements:
    """The displacements from the first pose.

    :raises InputError: there are less than two poses, two are the same, or numbers are not finite.
    """
    if len(poses) < 2:
        raise InputError(f"{len(poses)} poses give no motion", "Give two to five.")
    for one in poses:
        if not np.all(np.isfinite([one.x, one.y, one.angle])):
            raise InputError(f"the pose {one} is not finite", "Give numbers.")
    turns = np.array([pose.turn / poses[0].turn for pose in poses])
    shifts = np.array([pose.origin for pose in poses]) - turns * poses[0].origin
    found = Displacements(turns, shifts)
    for index in range(len(poses)):
        for other in range(index):
            apart = abs(shifts[index] - shifts[other]) / found.size + abs(turns[index] - turns[other])
            if apart < SAME:
                raise InputError(f"poses {other + 1} and {index + 1} are the same", "Leave one of them out.")
    return found


def poles(motion: Displacements) -> dict[tuple[int, int], complex]:
    """The pole of each displacement between two poses, by their numbers from 1; translations have none."""
    found = {}
    for second in range(len(motion.turns)):
        for first in range(second):
            turn = motion.turns[second] / motion.turns[first]
            shift = motion.shifts[second] - turn * motion.shifts[first]
            if abs(1.0 - turn) > TINY:
                found[first + 1, second + 1] = complex(shift / (1.0 - turn))
    return found


def residual(motion: Displacements, dyad: Dyad) -> float:
    """The largest deviation in m of a dyad from its condition over all poses."""
    match dyad.kind:
        case "RR":
            return float(np.max(np.abs(np.abs(motion.of(dyad.point) - dyad.center) - dyad.length)))
        case "PR":
            return float(np.max(np.abs(np.imag((motion.of(dyad.point) - dyad.point) / dyad.direction))))
        case "RP":
            return float(
                np.max(np.abs(np.imag((dyad.center - motion.of(dyad.center)) / (motion.turns * dyad.direction))))
            )


def circle_point(motion: Displacements, center: complex) -> Dyad | None:
    """The link from a center for two or three poses; None if there is none, or only a slider.

    Of two poses, any point on a line would do: that next to the middle of the poses is taken.
    """
    rows, right = _rows_of_point(motion, center, 1.0)
    found = _solved(rows, right)
    return None if found is None or abs(found) > FAR * motion.size else _link(motion, center, found)


def center_point(motion: Displacements, point: complex) -> Dyad | None:
    """The link that guides a point of the body, given where it is in the first pose; a slider if it moves straight."""
    steps = motion.of(point)[1:] - point
    direction = steps[np.argmax(np.abs(steps))]
    if abs(direction) < SAME * motion.size:
        return None
    if np.max(np.abs(np.imag(steps / direction))) < EXACT * motion.size:
        return Dyad("PR", point, point, complex(direction / abs(direction)))
    mirrored = circle_point(motion.inverse, point)  # ground and the body change roles
    return None if mirrored is None else _link(motion, mirrored.point, point)


def straight_point(motion: Displacements, direction: complex) -> Dyad | None:
    """The point of the body that moves along a line in a given direction, for three poses."""
    rows, right = _rows_of_point(motion, direction / abs(direction) * 1j, 0.0)
    found = _solved(rows, right)
    if found is None or abs(found) > FAR * motion.size:
        return None
    return Dyad("PR", found, found, direction / abs(direction))


def passing_line(motion: Displacements, direction: complex) -> Dyad | None:
    """The fixed point through which a line of the body passes, given its direction in the first of three poses."""
    found = straight_point(motion.inverse, direction)
    return None if found is None else Dyad("RP", found.point, found.point, found.direction)


def dyads_of_four(motion: Displacements, rays: int = RAYS) -> list[Dyad]:
    """Links on the circle-point curve of four poses, with their centers, in the order of the angle of the rays.

    The determinant of the three conditions is a cubic in p. Its roots are found on rays through the middle of the
    poles. The two sliders, one of each kind, follow from the points at infinity.
    """
    found = list[Dyad]()
    near = np.array([*poles(motion).values(), 0j])
    middle = complex(np.median(near.real), np.median(near.imag))  # the curve winds around the poles
    for angle in (np.arange(rays) + 0.5) * np.pi / rays:
        ray = complex(np.exp(1j * angle)) * motion.size
        places = np.array([-1.5, -0.5, 0.5, 1.5])
        values = [np.linalg.det(_matrix_of_center(motion, middle + place * ray)) for place in places]
        cubic = np.linalg.solve(np.vander(places, 4), np.array(values))
        for root in _real_roots(cubic):
            point = middle + root * ray
            if abs(root) < FAR:
                found += _dyad_at(motion, point)
    return found + sliders_of_four(motion)


def sliders_of_four(motion: Displacements) -> list[Dyad]:
    """The point whose four positions are in line, and the fixed point that a line of the body meets in all poses."""
    found = list[Dyad]()
    for kind, moving in (("PR", motion), ("RP", motion.inverse)):
        point = _straight_of_four(moving)
        if point is None:
            continue
        steps = moving.of(point)[1:] - point
        direction = complex(steps[np.argmax(np.abs(steps))])
        if abs(direction) < SAME * motion.size:
            continue
        dyad = Dyad("PR" if kind == "PR" else "RP", point, point, direction / abs(direction))
        if residual(motion, dyad) < EXACT * motion.size:
            found.append(dyad)
    return found


def dyads_of_five(motion: Displacements) -> list[Dyad]:
    """All real dyads of five poses: up to four.

    The four conditions are linear in p, c, and the real and imaginary part of conj(c) p. Their solutions are a plane of
    homogeneous vectors, in which the products give two conics; these meet in up to four points. Sliders are those at
    infinity.
    """
    scale = motion.size
    scaled = Displacements(motion.turns, motion.shifts / scale)
    a, b = scaled.turns[1:], scaled.shifts[1:]
    of_point, turned = np.conj(b) * a, a - 1.0
    columns = [of_point.real, -of_point.imag, -b.real, -b.imag, -turned.real, turned.imag, 0.5 * np.abs(b) ** 2]
    _, values, right = np.linalg.svd(np.column_stack(columns))
    if values[-1] < TINY * values[0]:
        raise InputError("the five poses are special: they have more than four pairs of points", "Change one of them.")
    basis = right[4:].T @ _GENERIC  # (7, 3)
    px, py, cx, cy, s, t, one = basis
    real = _symmetric(one, s) - _symmetric(px, cx) - _symmetric(py, cy)
    imaginary = _symmetric(one, t) - _symmetric(cx, py) + _symmetric(cy, px)
    found = list[Dyad]()
    for vector in _common_points(real, imaginary):
        dyad = _dyad_of(scaled, basis @ vector)
        if dyad is not None:
            dyad = Dyad(dyad.kind, dyad.center * scale, dyad.point * scale, dyad.direction)
            if not any(_is_same(motion, dyad, other) for other in found):
                found.append(dyad)
    return found


_GENERIC = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]  # so that no point of conics is special


def _link(motion: Displacements, center: complex, point: complex) -> Dyad | None:
    """The link between two points; None where it has no length."""
    return None if abs(point - center) < SAME * motion.size else Dyad("RR", complex(center), complex(point))


def _rows_of_point(motion: Displacements, center: complex, weight: float) -> tuple[Array, Array]:
    """The conditions of the point (n - 1, 2) and their right sides, for a center, with weight 0 at infinity."""
    a, b = motion.turns[1:], motion.shifts[1:]
    factor = weight * np.conj(b) * a - np.conj(center) * (a - 1.0)
    right = np.real(np.conj(center) * b) - 0.5 * weight * np.abs(b) ** 2
    return np.column_stack([factor.real, -factor.imag]), right


def _solved(rows: Array, right: Array) -> complex | None:
    """The point of two linear conditions, or the nearest one of a single condition; None if they contradict."""
    norms = np.linalg.norm(rows, axis=1)
    if np.any(norms == 0.0):
        return None
    rows, right = rows / norms[:, None], right / norms
    if len(rows) > 1 and np.linalg.svd(rows, compute_uv=False)[-1] < TINY:
        return None
    x, y = np.linalg.lstsq(rows, right, rcond=None)[0]
    return complex(x, y)


def _matrix_of_center(motion: Displacements, point: complex) -> Array:
    """The conditions (n - 1, 3) of the homogeneous center of a point, scaled."""
    a, b, size = motion.turns[1:], motion.shifts[1:], motion.size
    step = (a - 1.0) * point + b
    constant = 0.5 * np.abs(b) ** 2 + np.real(np.conj(b) * a * point)
    return np.column_stack([-step.real / size, -step.imag / size, constant / size**2])


def _dyad_at(motion: Displacements, point: complex) -> list[Dyad]:
    """The link of a circle point of four poses."""
    _, _, right = np.linalg.svd(_matrix_of_center(motion, point))
    x, y, weight = right[-1]
    if abs(weight) * FAR < abs(complex(x, y)):
        return []
    center = complex(x, y) / weight * motion.size
    refined = _refined(motion, center, point)
    if refined is None:
        return []
    link = _link(motion, *refined)
    return [] if link is None or residual(motion, link) > EXACT * max(motion.size, link.length) else [link]


def _refined(motion: Displacements, center: complex, point: complex) -> tuple[complex, complex] | None:
    """Newton's method for center and point, with the least change; None if it does not converge."""
    for _ in range(ITERATIONS):
        a, b = motion.turns[1:], motion.shifts[1:]
        of_point = np.conj(b) * a - np.conj(center) * (a - 1.0)
        of_center = b + (a - 1.0) * point
        gap = 0.5 * np.abs(b) ** 2 + np.real(np.conj(b) * a * point) - np.real(np.conj(center) * of_center)
        slopes = np.column_stack([of_point.real, -of_point.imag, -of_center.real, -of_center.imag])
        step = np.linalg.lstsq(slopes, -gap, rcond=1e-14)[0]
        point, center = point + complex(step[0], step[1]), center + complex(step[2], step[3])
        if not np.isfinite(abs(point) + abs(center)):
            return None
        if np.max(np.abs(step)) < 1e-13 * (abs(point) + abs(center)):
            break
    return center, point


def _straight_of_four(motion: Displacements) -> complex | None:
    """The point with four positions in line: two circles of points in line for three poses meet in a pole and in it.

    The steps d_i = (A_i - 1) p + B_i are parallel: Im(conj(d_2) d_3) = Im(conj(d_2) d_4) = 0. Both are circles in p.
    Their difference is linear; on this line, one of the two common points is the pole of poses 1 and 2.
    """
    a, b = motion.turns[1:], motion.shifts[1:]
    rows = []
    for index in (1, 2):  # k |p|² + Re(conj(m) p) + n = 0
        k = np.imag(np.conj(a[0] - 1.0) * (a[index] - 1.0))
        m = 1j * (b[0] * np.conj(a[index] - 1.0) - np.conj(a[0] - 1.0) * b[index])
        n = np.imag(np.conj(b[0]) * b[index])
        rows.append((float(k), complex(m), float(n)))
    line, offset = rows[0][0] * rows[1][1] - rows[1][0] * rows[0][1], rows[0][0] * rows[1][2] - rows[1][0] * rows[0][2]
    if abs(line) < TINY * motion.size or abs(1.0 - motion.turns[1]) < TINY:
        return None
    k, m, n = max(rows, key=lambda row: abs(row[0]))
    foot, along = -offset * line / abs(line) ** 2, 1j * line / abs(line)
    quadratic = [k, 2.0 * k * np.real(np.conj(foot) * along) + np.real(np.conj(m) * along),
                 k * abs(foot) ** 2 + np.real(np.conj(m) * foot) + n]  # fmt: skip
    pole = motion.shifts[1] / (1.0 - motion.turns[1])
    roots = [foot + root * along for root in _real_roots(np.array(quadratic))]
    away = [one for one in roots if abs(one - pole) > SAME * motion.size]
    return complex(away[0]) if len(away) == 1 and len(roots) == 2 else None


def _symmetric(one: Array, other: Array) -> Array:
    """The matrix of a product of two linear forms."""
    return np.asarray(0.5 * (np.outer(one, other) + np.outer(other, one)))


def _common_points(first: Array, second: Array) -> list[Array]:
    """The real common points (3,) of two conics (3, 3), by the resultant of their quadratics in the second number."""

    def coefficients(conic: Array) -> tuple[Array, Array, Array]:  # of y², y and 1, as polynomials of x
        return (
            np.array([conic[1, 1]]),
            np.array([2.0 * conic[0, 1], 2.0 * conic[1, 2]]),
            np.array([conic[0, 0], 2.0 * conic[0, 2], conic[2, 2]]),
        )

    a1, b1, c1 = coefficients(first / np.max(np.abs(first)))
    a2, b2, c2 = coefficients(second / np.max(np.abs(second)))
    ac, ab, bc = _minor(a1, c2, a2, c1), _minor(a1, b2, a2, b1), _minor(b1, c2, b2, c1)
    found = []
    for x in _real_roots(_minor(ac, ac, ab, bc)):
        below = float(np.polyval(ab, x))
        if below != 0.0:
            vector = np.array([x, -np.polyval(ac, x) / below, 1.0])
            found.append(vector / np.linalg.norm(vector))
    return found


def _minor(a: Array, b: Array, c: Array, d: Array) -> Array:
    """The polynomial a b - c d."""
    one, other = np.convolve(a, b), np.convolve(c, d)
    result = np.zeros(max(len(one), len(other)))
    result[len(result) - len(one) :] += one
    result[len(result) - len(other) :] -= other
    return result


def _dyad_of(motion: Displacements, vector: Array) -> Dyad | None:
    """The dyad of a homogeneous solution (px, py, cx, cy, Re(conj(c) p), Im(conj(c) p), 1) of poses of unit size."""
    px, py, cx, cy, s, t, one = vector
    point, center, product = complex(px, py), complex(cx, cy), complex(s, t)
    small = 1e-7 * float(np.max(np.abs(vector)))
    if abs(one) > small:
        refined = _refined(motion, center / one, point / one)
        if refined is None or max(map(abs, refined)) > FAR:
            return None
        link = _link(motion, *refined)
        return None if link is None or residual(motion, link) > 1e-7 * max(1.0, link.length) else link
    if abs(point) < small < abs(center):  # the center is at infinity
        place = product / center.conjugate()
        dyad = Dyad("PR", place, place, 1j * center / abs(center))
    elif abs(center) < small < abs(point):
        place = (product / point).conjugate()
        dyad = Dyad("RP", place, place, 1j * point / abs(point))
    else:
        return None
    return dyad if residual(motion, dyad) < 1e-6 else None


def _is_same(motion: Displacements, one: Dyad, other: Dyad) -> bool:
    near = SAME * motion.size
    return one.kind == other.kind and abs(one.center - other.center) + abs(one.point - other.point) < near


def _real_roots(polynomial: Array) -> list[float]:
    """The real roots, without those that are infinite."""
    largest = float(np.max(np.abs(polynomial)))
    if largest == 0.0 or not np.isfinite(largest):
        return []
    roots = np.roots(np.where(np.abs(polynomial) < 1e-15 * largest, 0.0, polynomial))
    return sorted(float(root.real) for root in roots if abs(root.imag) <= REAL * max(1.0, abs(root)))
