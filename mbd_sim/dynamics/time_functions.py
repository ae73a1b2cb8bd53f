"""Expressions of time as CasADi functions, with their derivatives."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from mbd_sim.errors import MechanismError
from mbd_sim.mechanism.expression import Arithmetic, TimeExpression, evaluate_with
from mbd_sim.mechanism.records import Mechanism

_FUNCTIONS: dict[str, tuple[int, Callable[..., Any]]] = {
    "sqrt": (1, ca.sqrt), "exp": (1, ca.exp), "log": (1, ca.log), "abs": (1, ca.fabs),
    "sin": (1, ca.sin), "cos": (1, ca.cos), "tan": (1, ca.tan),
    "asin": (1, ca.asin), "acos": (1, ca.acos), "atan": (1, ca.atan), "atan2": (2, ca.atan2),
    "min": (2, ca.fmin), "max": (2, ca.fmax), "hypot": (2, lambda a, b: ca.sqrt(a * a + b * b)),
}  # fmt: skip
_ARITHMETIC = Arithmetic(_FUNCTIONS, power=lambda a, b: a**b)


def require_smooth(mechanism: Mechanism) -> None:
    """Refuse drives without a finite position, velocity or acceleration at the start.

    :raises MechanismError: the joints are named.
    """
    t = ca.SX.sym("t")
    problems = []
    for name, joint in mechanism.joints.items():
        if not joint.drive:
            continue
        values = np.array(ca.Function("at", [t], [ca.vertcat(*time_functions(joint.drive, t))])(0.0))
        if not np.all(np.isfinite(values)):
            message = "the drive has no finite velocity or acceleration at t = 0"
            remedy = "Write an expression that can be differentiated twice there."
            problems.append(mechanism.source.problem(("joints", name, "drive"), message, remedy))
    if problems:
        raise MechanismError(problems)


def time_functions(expressions: Sequence[TimeExpression], t: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """The values (n,) of expressions at time t in s, and their first and second time derivatives."""
    values = ca.vertcat(*(function_of(expression, {"t": t}) for expression in expressions))
    rates = ca.jacobian(values, t)
    return values, rates, ca.jacobian(rates, t)


def function_of(expression: TimeExpression, names: Mapping[str, ca.SX]) -> ca.SX:
    """The value of an expression with symbols for these names."""
    return ca.SX(evaluate_with(expression.text, {**expression.names, **names}, _ARITHMETIC))
