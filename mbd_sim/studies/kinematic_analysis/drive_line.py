"""A straight line through the space of the drives, and points of the curve of configurations above it.

Where a function along the line is least is found by golden section.
"""

from __future__ import annotations

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


GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


def least_place(function: Callable[[float], float], low: float, high: float, sections: int) -> float:
    """The place between two others at which a function with one minimum there is least, by golden section.

    :param sections: each of which leaves 0.618 of the interval.
    """
    one, other = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    at_one, at_other = function(one), function(other)
    for _ in range(sections):
        if at_one < at_other:
            high, other, at_other = other, one, at_one
            one = high - GOLDEN * (high - low)
            at_one = function(one)
        else:
            low, one, at_one = one, other, at_other
            other = low + GOLDEN * (high - low)
            at_other = function(other)
    return 0.5 * (low + high)
