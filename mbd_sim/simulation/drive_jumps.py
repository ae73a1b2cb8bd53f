"""Times at which a prescribed motion jumps, in position or in speed.

A jump of the speed v of a prescribed coordinate is an impact: with the impulse Λ = (G M⁻¹ Gᵀ)⁻¹ Δv of the constraint,
all other speeds jump as well. A simulation does not compute this impulse.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np

from mbd_sim.dynamics.time_functions import time_functions
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.constraints import Coupling, Distance, expressions_of
from mbd_sim.mechanism.drives import CommandedDrive
from mbd_sim.mechanism.expression import TIME, TimeExpression
from mbd_sim.mechanism.records import Mechanism

MAY_JUMP = re.compile(r"\b(where|floor|sign|mod|abs|min|max|clip|table)\b|[<>]")
MOST_POINTS = 200_000  # at which an expression is evaluated
MOST_CANDIDATES = 50  # intervals that are searched
BISECTIONS = 60
LEAST = 1e-6  # jump, relative to the range of the quantity, that counts


@dataclass(frozen=True, slots=True)
class Jump:
    """A jump of a `quantity` ("position" or "speed") by an amount at a time in s."""

    quantity: str
    amount: float
    time: float


def jump_remarks(mechanism: Mechanism, end: float) -> Iterator[str]:
    """A sentence on each prescribed motion that jumps between the times 0 and `end` in s."""
    for owner, expression, unit in _prescribed(mechanism):
        found = jumps(expression, mechanism.step, end)
        if not found:
            continue
        first, more = found[0], len(found) - 1
        unit = unit if first.quantity == "position" else f"{unit}/s"
        others = f", and {more} more time{'s' if more > 1 else ''} until t = {found[-1].time:.6g} s" if more else ""
        yield (
            f"{owner} jumps in {first.quantity} by {first.amount:.6g} {unit} at t = {first.time:.6g} s{others}. The "
            "impulse of such an impact is not computed: the speeds of all other coordinates stay, and the energy "
            "residual contains its work. Let the motion change within several steps."
        )


def _prescribed(mechanism: Mechanism) -> Iterator[tuple[str, TimeExpression, str]]:
    """The expressions of time alone that prescribe motions: whose, the expression, and the unit."""
    for name, joint in mechanism.joints.items():
        if not isinstance(joint.drive, CommandedDrive):
            for motion, expression, kind in zip(joint.motion_names, joint.drive, joint.kind.coordinates, strict=False):
                yield f"the drive of '{motion if len(joint.drive) > 1 else name}'", expression, kind.unit
    for constraint in mechanism.constraints:
        if isinstance(constraint, Distance | Coupling):
            for expression in expressions_of(constraint):
                unit = "m" if isinstance(constraint, Distance) else "units"
                yield f"the constraint '{constraint.name}'", expression, unit


def jumps(expression: TimeExpression, step: float, end: float) -> list[Jump]:
    """The jumps of an expression of time and of its rate between 0 and `end` in s, in order.

    They are sought between points that are a step apart, or more if the time is long: two within a step that cancel
    each other are not found.
    """
    if expression.variables != {TIME} or not MAY_JUMP.search(expression.text):
        return []
    t = ca.SX.sym("t")
    evaluated = ca.Function("prescribed", [t], list(time_functions([expression], t)))
    times = np.linspace(0.0, end, min(max(round(end / step), 1), MOST_POINTS) + 1)
    position, rate, rate_of_rate = (np.asarray(one).ravel() for one in evaluated(times[None]))
    found: dict[float, Jump] = {}
    for quantity, index, values, slopes in (("speed", 1, rate, rate_of_rate), ("position", 0, position, rate)):
        amounts: dict[float, float] = {}
        for low, high in _candidates(times, values, slopes):
            amount, at = _located(evaluated, index, low, high)
            if abs(amount) > LEAST * np.ptp(values[np.isfinite(values)]):
                at = float(f"{at:.12g}")  # at a kink, the rate may have a value of its own, between two jumps
                amounts[at] = amounts.get(at, 0.0) + amount
        found |= {at: Jump(quantity, amount, at) for at, amount in amounts.items()}
    return [found[time] for time in sorted(found)]


def _candidates(times: Array, values: Array, slopes: Array) -> list[tuple[float, float]]:
    """Intervals in which a quantity changes otherwise than its slopes say, those with the largest difference."""
    with np.errstate(all="ignore"):
        off = np.abs(np.diff(values) - np.diff(times) * (slopes[1:] + slopes[:-1]) / 2.0)
    off = np.where(np.isfinite(off), off, 0.0)
    off[off <= LEAST * float(np.ptp(values[np.isfinite(values)], axis=None))] = 0.0
    rows = np.sort(np.argsort(-off, kind="stable")[:MOST_CANDIDATES])
    return [(float(times[row]), float(times[row + 1])) for row in rows if off[row]]


def _located(function: ca.Function, index: int, low: float, high: float) -> tuple[float, float]:
    """The largest change of a result of a function between two neighboring times of an interval, and its time."""

    def value(time: float) -> float:
        return float(function(time)[index])

    first, last = value(low), value(high)
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break
        between = value(middle)
        if abs(between - first) >= abs(last - between):
            high, last = middle, between
        else:
            low, first = middle, between
    return last - first, low
