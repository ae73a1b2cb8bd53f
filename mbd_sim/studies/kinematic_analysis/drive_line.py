"""A straight line through the space of the drives, and points of the curve of configurations above it.

Where a function along the line is least is found by Brent's method.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.math.rank import RANK
from mbd_sim.studies.kinematic_analysis.system import ITERATIONS, SETTLED, KinematicSystem, in_natural_units


@dataclass(frozen=True, eq=False)
class CurvePoint:
    """A configuration q (nq,) at the place s on the line of the drives.

    `tangent` (nv + 1,) is the direction of the curve in scaled coordinates and s, of unit length. `margin` is the
    smallest singular value of the equations, which vanishes at a change point, with its singular vectors `left` and
    `right`.
    """

    q: Array
    s: float
    tangent: Array
    margin: float
    left: Array
    right: Array

    @property
    def pace(self) -> float:
        """How fast the drives advance along the curve; zero at a dead point."""
        return float(self.tangent[-1])


class DriveLine:
    """The drives `start` + s (`stop` - `start`), (n,) each, and the curve of configurations above them.

    The curve is Φ(q) = 0, S q = c(s). Its equations G δ = 0, S δ - c' ds = 0 are used with coordinates divided by the
    scale of the system, s multiplied by the scaled `length` of the line, and the rows by their natural sizes.
    """

    def __init__(self, system: KinematicSystem, start: Array, stop: Array) -> None:
        self.system, self.start, self.stop = system, start, stop
        direction = (stop - start) / system.scale[system.u_driven]
        self.length = float(np.linalg.norm(direction))
        self._column = np.zeros(0) if self.length == 0.0 else -direction / self.length

    def drives(self, s: float) -> Array:
        """The drives (n,) at s, exactly those at both ends."""
        if s == 1.0:
            return self.stop
        return self.start + s * (self.stop - self.start)

    def described(self, s: float) -> str:
        """The drives at s, for messages."""
        return ", ".join(
            f"{name} = {value:.6g}" for name, value in zip(self.system.drives, self.drives(s), strict=True)
        )

    def point(self, q: Array, s: float, along: Array) -> CurvePoint:
        """The point of the curve at a configuration on it.

        :param along: a direction (nv + 1,) with which its tangent makes an acute angle.
        """
        left, values, right = np.linalg.svd(self._matrix(q))
        tangent = right[-1] if right[-1] @ along >= 0.0 else -right[-1]
        last = self.system.layout.nv - 1
        return CurvePoint(q, s, tangent, float(values[last] / values[0]), left[:, last], right[last])

    def forward(self, q: Array, s: float, sign: float) -> CurvePoint:
        """The point from which the drives advance (`sign` 1) or go back (-1) along the curve."""
        along = np.zeros(self.system.layout.nv + 1)
        along[-1] = sign
        return self.point(q, s, along)

    def beyond(self, point: CurvePoint, distance: float) -> CurvePoint | None:
        """The point of the curve in the plane across its tangent at a distance; None if Newton's method fails."""
        system, tangent = self.system, point.tangent
        step = distance * tangent
        q, s = system.displaced(point.q, system.scale * step[:-1]), point.s + step[-1] / self.length
        moved = 0.0
        for _ in range(ITERATIONS):
            matrix = np.vstack([self._matrix(q), tangent])
            right = np.concatenate([-self._residual(q, s), [0.0]])
            if not (np.all(np.isfinite(matrix)) and np.all(np.isfinite(right))):
                return None
            found = np.linalg.lstsq(matrix, right, rcond=RANK)[0]
            size = float(np.max(np.abs(found)))
            moved += size
            if moved > 0.5 * abs(distance):
                return None
            q, s = system.displaced(q, system.scale * found[:-1]), s + found[-1] / self.length
            if size <= SETTLED:  # the next step is round-off
                break
        return self.point(q, s, tangent) if system.is_closed(q) else None

    def _matrix(self, q: Array) -> Array:
        """(m + n, nv + 1)."""
        system = self.system
        gradient = system.constraints.scaled_gradient(0.0, q)
        selection = np.eye(system.layout.nv)[system.u_driven]
        upper = np.column_stack([gradient, np.zeros(len(gradient))])
        return np.vstack([upper, np.column_stack([selection, self._column])])

    def _residual(self, q: Array, s: float) -> Array:
        system = self.system
        gaps, sizes = system.constraints.position(0.0, q), system.constraints.row_sizes(0.0, q)
        along = (q[system.q_driven] - self.drives(s)) / system.scale[system.u_driven]
        return np.concatenate([in_natural_units(gaps, sizes), along])


SHORTER = 0.5 * (3.0 - math.sqrt(5.0))  # part of a golden section
ROUND_OFF = 1e-14  # rad or relative to 1: values at three places that differ by less are round-off


def least_place(
    function: Callable[[float], float], low: float, high: float, tolerance: float, middle: float | None = None
) -> float:
    """The place between two others, in any order, at which a function with one minimum there is least, by Brent's method.

    Steps to the minimum of the parabola through the three lowest points alternate with golden sections, which also find
    a minimum at a kink. See Brent (1973), chapter 5.

    :param tolerance: of the place, relative to the interval.
    :param middle: where to begin.
    """
    low, high = sorted((float(low), float(high)))
    tolerance *= high - low
    best = low + SHORTER * (high - low) if middle is None else middle
    at_best = float(function(best))
    second, at_second, third, at_third = best, at_best, best, at_best
    step = before = 0.0  # the last step, and the one before it
    while max(best - low, high - best) > 2.0 * tolerance:
        if len({best, second, third}) == 3 and max(at_second, at_third) - at_best <= ROUND_OFF:
            break
        across, along = (best - second) * (at_best - at_third), (best - third) * (at_best - at_second)
        above, below = (best - third) * along - (best - second) * across, 2.0 * (across - along)
        longest, before = before, step
        # Accepted are steps inside, of less than half of the one before the last; nan fails every comparison.
        if below and abs(above / below) < 0.5 * abs(longest) and low < best + above / below < high:
            step = above / below
        else:
            before = (high if best < 0.5 * (low + high) else low) - best
            step = SHORTER * before
        place = best + (step if abs(step) >= tolerance else math.copysign(tolerance, step))
        found = float(function(place))
        if found <= at_best:
            low, high = (best, high) if place >= best else (low, best)
            third, at_third, second, at_second = second, at_second, best, at_best
            best, at_best = place, found
            continue
        low, high = (low, place) if place >= best else (place, high)
        if found <= at_second or second == best:
            third, at_third, second, at_second = second, at_second, place, found
        elif found <= at_third or third in (best, second):
            third, at_third = place, found
    return best
