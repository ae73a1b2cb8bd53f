"""The least largest deviation: linear programs in a trust region.

Each step minimizes the largest of the linearized deviations within bounds and a box (Madsen 1975). It converges
quadratically where as many deviations are equally large as unknowns determine, and linearly elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mbd_sim.geometry.pose import Array

FIRST = 0.1  # size of the first box, relative to the scales of the unknowns
SMALLEST, GAIN = 1e-11, 1e-11  # of the box, and of the predicted gain relative to the deviation, at which it ends
ACCEPTED, GOOD = 0.05, 0.7  # ratio of actual and predicted gain, from which a step is taken and the box grows


def least_peak(
    deviations: Callable[[Array], Array], jacobian: Callable[[Array], Array], start: Array, bounds: tuple[Array, Array],
    scales: Array, most_steps: int,
) -> tuple[Array, int, bool]:  # fmt: skip
    """The unknowns that minimize the largest |deviation|, the number of steps, and whether it converged.

    :param deviations: of unknowns; inf where they are undefined.
    :param bounds: of the unknowns, between which the start lies.
    :param scales: typical sizes of the unknowns.
    """
    x, box = start.copy(), FIRST
    values = deviations(x)
    slopes, peak = jacobian(x), float(np.max(np.abs(values)))
    for count in range(most_steps):
        step, predicted = _step(values, slopes, box * scales, (bounds[0] - x, bounds[1] - x))
        if peak - predicted <= GAIN * peak or box < SMALLEST:
            return x, count, True
        trial = np.clip(x + step, *bounds)
        found = deviations(trial)
        ratio = (peak - float(np.max(np.abs(found)))) / (peak - predicted)
        if ratio > ACCEPTED:
            x, values = trial, found
            slopes, peak = jacobian(x), float(np.max(np.abs(values)))
        reached = bool(np.any(np.abs(step) >= 0.99 * box * scales))
        box *= 2.0 if ratio > GOOD and reached else 1.0 if ratio > 0.25 else 0.25
    return x, most_steps, False


def _step(values: Array, slopes: Array, box: Array, room: tuple[Array, Array]) -> tuple[Array, float]:
    """The step that minimizes the largest linearized deviation, and that deviation."""
    from scipy.optimize import linprog  # type: ignore[import-untyped]

    size = max(float(np.max(np.abs(values))), 1e-300)
    scaled = slopes * box / size
    ones = np.ones((len(values), 1))
    rows = np.vstack([np.hstack([scaled, -ones]), np.hstack([-scaled, -ones])])
    right = np.concatenate([-values, values]) / size
    limits = [(max(-1.0, low / b), min(1.0, high / b)) for low, high, b in zip(*room, box, strict=True)]
    cost = np.append(np.zeros(len(box)), 1.0)
    found = linprog(cost, A_ub=rows, b_ub=right, bounds=[*limits, (0.0, None)], method="highs")
    if not found.success:
        return np.zeros(len(box)), size
    step = box * found.x[:-1]
    return step, float(np.max(np.abs(values + slopes @ step)))
