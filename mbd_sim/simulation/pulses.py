"""Finds forces of time that act within single steps, where no method sees them."""

from __future__ import annotations

import re
from collections.abc import Iterator

import casadi as ca
import numpy as np

from mbd_sim.dynamics.time_functions import function_of
from mbd_sim.mechanism.expression import TIME, TimeExpression
from mbd_sim.mechanism.force_expressions import expressions_of_forces
from mbd_sim.mechanism.records import Mechanism

SAMPLES = 64  # in a step
SEARCHED = 1024  # steps from the start on; later ones are searched near the numbers of the expression
LATEST = 1e6  # s, to which numbers of an expression may be times
MISSED = 0.01  # of the largest value, that the mean over a step may differ from that of its ends
NUMBER = re.compile(r"(?<![\w.])(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


def pulse_remarks(mechanism: Mechanism, step: float) -> Iterator[str]:
    """A sentence on each force of time that changes within a step and is the same at its ends, in steps of `step` s."""
    for force in expressions_of_forces(mechanism):
        expression = force.expression
        if expression.variables != {TIME}:
            continue
        if (found := _missed(expression, step)) is not None:
            where = ".".join(map(str, force.location))
            yield (
                f"{where} changes within the step at {found:.6g} s and is back at its end, so that it may not be seen. "
                f"Use a step below {step:g} s that resolves it, or a longer and smaller force."
            )


def _missed(expression: TimeExpression, step: float) -> float | None:
    """The start in s of the first step within which a change is missed; None without one."""
    t = ca.SX.sym("t")
    function = ca.Function("force", [t], [function_of(expression, {TIME: t})])
    named = [*map(float, NUMBER.findall(expression.text)), *expression.names.values()]
    near = [np.floor(time / step) + np.array([-1.0, 0.0, 1.0]) for time in named if SEARCHED * step < time < LATEST]
    starts = np.unique(np.concatenate([np.arange(SEARCHED, dtype=float), *near]))
    times = step * (starts[:, None] + np.arange(SAMPLES + 1) / SAMPLES)
    values = np.array(function(times.reshape(1, -1)), dtype=float).reshape(times.shape)
    largest = float(np.max(np.abs(values)))
    if not 0.0 < largest < np.inf:
        return None
    first, last, mean = values[:, 0], values[:, -1], values[:, :-1].mean(axis=1)
    missed = np.abs(mean - 0.5 * (first + last)) > MISSED * largest
    unseen = np.flatnonzero(missed & (np.abs(last - first) < MISSED * largest))
    return float(times[unseen[0], 0]) if len(unseen) else None
