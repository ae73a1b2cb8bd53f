"""Nonlinear least squares with a few shared unknowns and further ones for each part of the data.

The Levenberg-Marquardt method (Nocedal & Wright, *Numerical Optimization*, sec. 10.3), with the unknowns of each part
eliminated from its linearized residuals by a singular value decomposition.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mbd_sim.errors import MbdSimError
from mbd_sim.geometry.pose import Array

ITERATIONS = 200
FIRST_DAMPING, LEAST_DAMPING, LARGEST_DAMPING = 1e-4, 1e-12, 1e8
CONVERGED = (
    1e-14  # decrease of the sum that the linearized problem predicts, relative to the sum, or change of unknowns
)
ROUNDING = 1e-10  # the same where a step does not decrease the sum, because of round-off in it
DEPENDENT = 1e-10  # relative size of singular values that count as zero

TINY = 1e-300


@dataclass(frozen=True, slots=True)
class Linearized:
    """Residuals (k,), and their derivatives by the shared (k, m) and by the own unknowns (k, d)."""

    residuals: Array
    by_shared: Array
    by_own: Array


@dataclass(frozen=True, slots=True)
class Step:
    """Changes of the shared unknowns (m,) and those of each part, and the sum of squares that is predicted."""

    shared: Array
    own: list[Array]
    predicted: float


@dataclass(frozen=True, slots=True)
class Eliminated:
    """Residuals and derivatives by the shared unknowns that the own ones of a part cannot change, and their `rank`."""

    residuals: Array
    by_shared: Array
    pseudo_inverse: Array
    rank: int


def fit(
    linearize: Callable[[Array, Sequence[Array] | None], Sequence[Linearized] | None],
    commit: Callable[[], None],
    shared: Array,
) -> tuple[Array, Sequence[Linearized]]:
    """The shared unknowns that minimize the sum of squares, and the residuals there.

    :param linearize: evaluates shared unknowns and changes of the own ones from where they were committed last; None
        where there is no solution.
    :param commit: makes the own unknowns that were evaluated last the present ones.
    :raises MbdSimError: the first guess has no solution, or the search does not converge.
    """
    present = linearize(shared, None)
    if present is None:
        raise MbdSimError("there is no trajectory with the first guesses. Use better ones.")
    commit()
    damping = FIRST_DAMPING
    for _ in range(ITERATIONS):
        cost = _cost(present)
        step = solve(present, damping)
        if damping <= 1.0 and (cost - step.predicted <= CONVERGED * cost or _change(step, shared) <= CONVERGED):
            return shared, present
        tried = linearize(shared + step.shared, step.own)
        if tried is not None and _cost(tried) <= cost:
            commit()
            shared, present, damping = shared + step.shared, tried, max(0.1 * damping, LEAST_DAMPING)
            continue
        if damping <= 1.0 and cost - step.predicted <= ROUNDING * cost:
            return shared, present
        if damping > LARGEST_DAMPING:
            if _change(solve(present, 0.0), shared) <= ROUNDING:
                return shared, present
            break
        damping *= 10.0
    raise MbdSimError("the search for the parameters did not converge. Use better guesses, or shorter intervals.")


def solve(parts: Sequence[Linearized], damping: float) -> Step:
    """The step that minimizes the linearized residuals, with changes penalized by the damping and their columns."""
    sizes = column_sizes(parts)
    eliminated = [_eliminated(part, damping) for part in parts]
    penalty = np.sqrt(damping) * np.diag(sizes)
    matrix = np.vstack([*(one.by_shared for one in eliminated), penalty])
    right = np.concatenate([*(one.residuals for one in eliminated), np.zeros(len(sizes))])
    scaled = np.linalg.lstsq(matrix / sizes, -right, rcond=None)[0]
    shared = scaled / sizes
    own = [
        one.pseudo_inverse @ -(part.residuals + part.by_shared @ shared)
        for one, part in zip(eliminated, parts, strict=True)
    ]
    left = right + matrix @ shared
    return Step(shared, own, float(left @ left))


def eliminated_parts(parts: Sequence[Linearized]) -> list[Eliminated]:
    """What the own unknowns of each part cannot change."""
    return [_eliminated(part, 0.0) for part in parts]


def column_sizes(parts: Sequence[Linearized]) -> Array:
    """The norm (m,) of the derivatives by each shared unknown, 1 where they are zero."""
    norms = np.linalg.norm(np.vstack([part.by_shared for part in parts]), axis=0)
    return np.where(norms > 0.0, norms, 1.0)


def _eliminated(part: Linearized, damping: float) -> Eliminated:
    rows = len(part.residuals)
    norms = np.linalg.norm(part.by_own, axis=0)
    sizes = np.where(norms > 0.0, norms, 1.0)
    count = len(sizes)
    own = np.vstack([part.by_own / sizes, np.sqrt(damping) * np.eye(count)])
    shared = np.vstack([part.by_shared, np.zeros((count, part.by_shared.shape[1]))])
    residuals = np.concatenate([part.residuals, np.zeros(count)])
    u, s, v = np.linalg.svd(own, full_matrices=False)
    kept = s > DEPENDENT * np.max(s, initial=0.0)
    u, inverse = u[:, kept], (v[kept].T / s[kept]) @ u[:rows, kept].T / sizes[:, None]
    return Eliminated(residuals - u @ (u.T @ residuals), shared - u @ (u.T @ shared), inverse, int(kept.sum()))


def _cost(parts: Sequence[Linearized]) -> float:
    return float(sum(part.residuals @ part.residuals for part in parts))


def _change(step: Step, shared: Array) -> float:
    """The largest relative change of a shared unknown."""
    return float(np.max(np.abs(step.shared) / np.maximum(np.abs(shared), TINY), initial=0.0))
