"""The least largest deviation, and the least squares of deviations, of unknowns between bounds under conditions.

Linear programs in a trust region minimize the largest deviation: each step minimizes the largest of the linearized
deviations within bounds and a box (Madsen 1975). This converges quadratically where as many deviations are equally
large as unknowns determine, and linearly elsewhere. Violated conditions add a penalty, which is exact once it is large
enough. Least squares keep conditions by an augmented Lagrangian.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.geometry.pose import Array
from mbd_sim.studies.synthesis.conditions import MET, Excess

FIRST = 0.1  # size of the first box, relative to the scales of the unknowns
SMALLEST, GAIN = 1e-11, 1e-11  # of the box, and of the predicted gain relative to the deviation, at which it ends
ACCEPTED, GOOD = 0.05, 0.7  # ratio of actual and predicted gain, from which a step is taken and the box grows
WEIGHTS = (10.0, 1e3, 1e5)  # of violations, in deviations at the start for a violation as large as the value itself
TOLERANCE = 1e-13  # relative change of unknowns and of the sum of squares, at which least squares end
ROUGH, NEARLY = 1e-6, 1e-4  # that of rounds of the augmented Lagrangian, until no condition is violated by more
ROUNDS = 30  # of the augmented Lagrangian, at most
STIFFER, SLOW = 10.0, 0.25  # its weight grows by that where the violation does not fall to that part
STUCK, PATIENCE = 0.95, 3  # rounds in which it does not even fall to that part, after which there is no hope
SETTLED = 1e-10  # relative violation at which its rounds end

Bounds = tuple[Array, Array]


def least_peak(
    deviations: Callable[[Array], Array], jacobian: Callable[[Array], Array], start: Array, bounds: Bounds,
    scales: Array, most_steps: int, *, excess: Excess | None = None, equal: NDArray[np.bool_] | None = None,
) -> tuple[Array, int, bool]:  # fmt: skip
    """The unknowns that minimize the largest |deviation|, the number of steps, and whether it converged.

    :param deviations: of unknowns; inf where they are undefined.
    :param bounds: of the unknowns, between which the start lies.
    :param scales: typical sizes of the unknowns.
    :param excess: how far conditions are exceeded; its derivatives are wanted where those of deviations were.
    :param equal: which of them are equations.
    """
    size = float(np.max(np.abs(deviations(start)))) or 1.0
    conditions = _Conditions(excess or _none, np.zeros(0, dtype=bool) if equal is None else equal)
    x, steps, converged = start, 0, False
    for weight in WEIGHTS if excess is not None else (0.0,):
        descent = _PeakDescent(deviations, jacobian, conditions, weight * size)
        x, more, converged = descent.descend(x, bounds, scales, most_steps - steps)
        steps += more
        if float(np.max(conditions.violations(excess(x)[0]) if excess else 0.0, initial=0.0)) <= MET:
            break
    return x, steps, converged


def _none(x: Array) -> tuple[Array, Array]:
    return np.zeros(0), np.zeros((0, len(x)))


class _Conditions:
    """Conditions, of which some are equations."""

    def __init__(self, excess: Excess, equal: NDArray[np.bool_]) -> None:
        self.excess, self.equal = excess, equal

    def violations(self, excesses: Array) -> Array:
        """How far each is from being met."""
        return np.where(self.equal, np.abs(excesses), np.maximum(excesses, 0.0))


class _PeakDescent:
    """Steps by linear programs to the least sum of the largest |deviation| and the weighted violations."""

    def __init__(
        self,
        deviations: Callable[[Array], Array],
        jacobian: Callable[[Array], Array],
        conditions: _Conditions,
        weight: float,
    ) -> None:
        self._deviations, self._jacobian, self._conditions, self._weight = deviations, jacobian, conditions, weight

    def descend(self, start: Array, bounds: Bounds, scales: Array, most_steps: int) -> tuple[Array, int, bool]:
        """The unknowns, the number of steps, and whether it converged."""
        x, box = start.copy(), FIRST
        values = self._deviations(x)
        slopes = self._jacobian(x)
        excesses, gradients = self._conditions.excess(x)
        merit = self._merit(values, excesses)
        for count in range(most_steps):
            step, predicted = self._step(
                (values, slopes), (excesses, gradients), box * scales, (bounds[0] - x, bounds[1] - x)
            )
            if merit - predicted <= GAIN * merit or box < SMALLEST:
                return x, count, True
            trial = np.clip(x + step, *bounds)
            found = self._deviations(trial)
            ratio = (merit - self._merit(found, self._conditions.excess(trial)[0])) / (merit - predicted)
            if ratio > ACCEPTED:
                x, values = trial, found
                slopes = self._jacobian(x)
                excesses, gradients = self._conditions.excess(x)
                merit = self._merit(values, excesses)
            reached = bool(np.any(np.abs(step) >= 0.99 * box * scales))
            box *= 2.0 if ratio > GOOD and reached else 1.0 if ratio > 0.25 else 0.25
        return x, most_steps, False

    def _merit(self, values: Array, excesses: Array) -> float:
        penalty = self._weight * float(np.sum(self._conditions.violations(excesses))) if len(excesses) else 0.0
        return float(np.max(np.abs(values))) + penalty

    def _step(
        self, deviations: tuple[Array, Array], excesses: tuple[Array, Array], box: Array, room: Bounds
    ) -> tuple[Array, float]:
        """The step that minimizes the linearized sum, and that sum.

        The unknowns of the program are the step relative to the box, the largest deviation, and each violation.
        """
        from scipy.optimize import linprog

        (values, slopes), (beyond, gradients), equal = deviations, excesses, self._conditions.equal
        size = max(self._merit(values, beyond), 1e-300)
        count, scaled = len(beyond), slopes * box / size
        ones, nothing = np.ones((len(values), 1)), np.zeros((len(values), count))
        rows = [np.hstack([scaled, -ones, nothing]), np.hstack([-scaled, -ones, nothing])]
        right = [-values / size, values / size]
        turned, own = gradients * box, -np.eye(count)
        rows += [np.hstack([turned, np.zeros((count, 1)), own]), np.hstack([-turned, np.zeros((count, 1)), own])[equal]]
        right += [-beyond, beyond[equal]]
        limits = [(max(-1.0, low / b), min(1.0, high / b)) for low, high, b in zip(*room, box, strict=True)]
        cost = np.concatenate([np.zeros(len(box)), [1.0], np.full(count, self._weight / size)])
        found = linprog(
            cost,
            A_ub=np.vstack(rows),
            b_ub=np.concatenate(right),
            bounds=[*limits, *[(0.0, None)] * (1 + count)],
            method="highs",
        )
        if not found.success:
            return np.zeros(len(box)), self._merit(values, beyond)
        step = box * found.x[: len(box)]
        return step, self._merit(values + slopes @ step, beyond + gradients @ step)


def least_squares(
    deviations: Callable[[Array], Array], jacobian: Callable[[Array], Array], start: Array, bounds: Bounds,
    most_steps: int, *, excess: Excess | None = None, equal: NDArray[np.bool_] | None = None,
) -> tuple[Array, int, bool]:  # fmt: skip
    """The unknowns with the least sum of squares, the number of steps, and whether it converged; see `least_peak`."""
    if excess is None or equal is None:
        return _plain_squares(deviations, jacobian, start, bounds, most_steps)
    conditions = _Conditions(excess, equal)
    weight = WEIGHTS[0] * float(np.sum(deviations(start) ** 2)) or 1.0
    forces, x, steps, before, converged, stuck = np.zeros(len(equal)), start, 0, np.inf, False, 0
    exact = False
    for _ in range(ROUNDS):
        augmented = _Augmented(deviations, jacobian, conditions, forces, weight)
        tolerance = TOLERANCE if exact else ROUGH
        x, more, converged = _plain_squares(augmented.values, augmented.slopes, x, bounds, most_steps, tolerance)
        steps += more
        jacobian(x)
        beyond = excess(x)[0]
        violation = float(np.max(conditions.violations(beyond)))
        moved = forces + weight * beyond
        forces = np.where(equal, moved, np.maximum(moved, 0.0))
        if violation <= SETTLED and exact:
            return x, steps, converged
        exact = exact or violation <= NEARLY
        if violation > SLOW * before:
            weight *= STIFFER
        stuck = stuck + 1 if violation > STUCK * before else 0
        before = violation
        if stuck == PATIENCE:
            break
    return x, steps, converged and before <= MET


class _Augmented:
    """Deviations, then those of conditions, whose squares are the augmented Lagrangian but for a constant."""

    def __init__(
        self, deviations: Callable[[Array], Array], jacobian: Callable[[Array], Array], conditions: _Conditions,
        forces: Array, weight: float,
    ) -> None:  # fmt: skip
        self._deviations, self._jacobian, self._conditions = deviations, jacobian, conditions
        self._forces, self._weight = forces, weight

    def values(self, x: Array) -> Array:
        """Of unknowns."""
        return np.append(self._deviations(x), np.sqrt(self._weight) * self._beyond(self._conditions.excess(x)[0]))

    def slopes(self, x: Array) -> Array:
        """The derivatives."""
        first = self._jacobian(x)
        excesses, gradients = self._conditions.excess(x)
        acting = self._conditions.equal | (self._beyond(excesses) > 0.0)
        return np.vstack([first, np.sqrt(self._weight) * np.where(acting[:, None], gradients, 0.0)])

    def _beyond(self, excesses: Array) -> Array:
        shifted = excesses + self._forces / self._weight
        return np.where(self._conditions.equal, shifted, np.maximum(shifted, 0.0))


def _plain_squares(
    deviations: Callable[[Array], Array],
    jacobian: Callable[[Array], Array],
    start: Array,
    bounds: Bounds,
    most_steps: int,
    tolerance: float = TOLERANCE,
) -> tuple[Array, int, bool]:
    from scipy.optimize import least_squares as minimized

    found: Any = minimized(
        deviations,
        start,
        jacobian,
        bounds=bounds,
        x_scale="jac",
        max_nfev=most_steps,
        **dict.fromkeys(("xtol", "ftol", "gtol"), tolerance),
    )
    return np.asarray(found.x), int(found.nfev), bool(found.status > 0)
