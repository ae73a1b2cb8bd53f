"""Expressions of time and other variables as CasADi functions, with their derivatives, and their values."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np

from mbd_sim.base.errors import MechanismError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.math.piecewise import looked_up
from mbd_sim.mechanism.elements.joint_types import CommandedDrive
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.expression import Arithmetic, Branch, TimeExpression, evaluate_with

_FUNCTIONS: dict[str, tuple[int, Callable[..., Any]]] = {
    "sqrt": (1, ca.sqrt), "exp": (1, ca.exp), "log": (1, ca.log), "abs": (1, ca.fabs),
    "sin": (1, ca.sin), "cos": (1, ca.cos), "tan": (1, ca.tan),
    "asin": (1, ca.asin), "acos": (1, ca.acos), "atan": (1, ca.atan), "atan2": (2, ca.atan2),
    "min": (2, ca.fmin), "max": (2, ca.fmax), "hypot": (2, lambda a, b: ca.sqrt(a * a + b * b)),
    "tanh": (1, ca.tanh), "sign": (1, ca.sign), "floor": (1, ca.floor),
    "mod": (2, lambda a, b: a - b * ca.floor(a / b)), "clip": (3, lambda x, low, high: ca.fmax(ca.fmin(x, high), low)),
}  # fmt: skip
# Arguments at which functions and their derivatives are finite; functions that are finite everywhere are left out.
_HARMLESS: dict[str, tuple[float, ...]] = {
    "sqrt": (1.0,), "exp": (0.0,), "log": (1.0,), "tan": (0.0,), "asin": (0.0,), "acos": (0.0,), "atan2": (0.0, 1.0),
    "hypot": (1.0, 1.0), "mod": (0.0, 1.0), "/": (1.0, 1.0), "**": (1.0, 1.0),
}  # fmt: skip


def _in_branch(condition: Any) -> Arithmetic:
    """The arithmetic of a branch that matters where the condition holds, and is finite elsewhere.

    The derivative of a branch is multiplied by its condition, and zero times infinity is undefined: so where the
    condition does not hold, functions get arguments at which they and their derivatives are finite.
    """

    def guarded(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        if name not in _HARMLESS:
            return function
        return lambda *args: function(
            *(ca.if_else(condition, *pair) for pair in zip(args, _HARMLESS[name], strict=True))
        )

    return Arithmetic(
        {name: (count, guarded(name, function)) for name, (count, function) in _FUNCTIONS.items()},
        power=guarded("**", lambda a, b: a**b),
        divide=guarded("/", lambda a, b: a / b),
        where=lambda inner, a, b: _where(inner, a, b, condition),
        look_up=looked_up,
    )


def _where(condition: Any, a: Branch, b: Branch, outer: Any = 1.0) -> Any:
    """One of two branches, within an `outer` branch."""
    one, other = a(_in_branch(condition * outer)), b(_in_branch((1.0 - condition) * outer))
    return ca.if_else(condition, one, other)


_ARITHMETIC = Arithmetic(
    _FUNCTIONS, power=lambda a, b: a**b, divide=lambda a, b: a / b, where=_where, look_up=looked_up
)


def require_smooth(mechanism: Mechanism) -> None:
    """Refuse drives without a finite position, velocity or acceleration at the start.

    :raises MechanismError: the joints are named.
    """
    t = ca.SX.sym("t")
    problems = []
    for name, joint in mechanism.joints.items():
        if not joint.drive or isinstance(joint.drive, CommandedDrive):
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
    return ca.SX(evaluate_with(expression.text, {**expression.names, **names}, _ARITHMETIC, expression.tables))


class _Evaluator:
    """Memory of the arguments and results of a function; the results are views, column by column."""

    def __init__(self, function: ca.Function) -> None:
        self._buffer, self.evaluate = function.buffer()
        self.arguments = [np.zeros(function.nnz_in(index)) for index in range(function.n_in())]
        self.sizes = [argument.size for argument in self.arguments]
        results = [np.zeros(function.nnz_out(index)) for index in range(function.n_out())]
        for index, argument in enumerate(self.arguments):
            self._buffer.set_arg(index, argument.data)  # type: ignore[call-arg]  # the size is that of the memory
        for index, result in enumerate(results):
            self._buffer.set_res(index, result.data)  # type: ignore[call-arg]
        self.results = [result.reshape(function.size_out(k), order="F") for k, result in enumerate(results)]


def all_evaluated(function: ca.Function, *arguments: float | Array) -> list[Array]:
    """The results, as contiguous arrays, of a function with dense arguments and dense results.

    :raises ValueError: an argument does not have as many numbers as that of the function.
    """
    idle = vars(function).setdefault("_idle", [])  # one for each thread that calls it, as long as the function is kept
    arrays = [np.asarray(argument, dtype=float) for argument in arguments]
    evaluator = idle.pop() if idle else _Evaluator(function)
    try:
        if [array.size for array in arrays] != evaluator.sizes:
            raise ValueError(f"the arguments of {function} do not have the sizes {[a.shape for a in arrays]}")
        for own, array in zip(evaluator.arguments, arrays, strict=True):
            own[:] = array if array.ndim < 2 else array.ravel()
        evaluator.evaluate()
        return [result.copy() for result in evaluator.results]
    finally:
        idle.append(evaluator)


def evaluated(function: ca.Function, *arguments: float | Array) -> Array:
    """The first of the results, see `all_evaluated`."""
    return all_evaluated(function, *arguments)[0]


GROUP = 64  # rows that are evaluated in one call
_maps: WeakKeyDictionary[ca.Function, ca.Function] = WeakKeyDictionary()


def _mapped(function: ca.Function) -> ca.Function:
    """The function for as many rows, which is kept as long as the function itself."""
    if (found := _maps.get(function)) is None:
        found = _maps.setdefault(function, function.map(GROUP))
    return found


def evaluated_for_all(function: ca.Function, *arguments: Array) -> Array:
    """The first result (k, n) of a function for each of k rows (k, …) of its arguments, column by column.

    CasADi's map evaluates the function for one row after the other, so that each gets the bits of a call of its own.
    """
    count, size = len(arguments[0]), function.nnz_out(0)
    padding = -count % GROUP
    padded = [np.concatenate([rows, np.repeat(rows[-1:], padding, axis=0)]) for rows in arguments]
    mapped = _mapped(function)
    groups = [
        all_evaluated(mapped, *(np.ascontiguousarray(rows[first : first + GROUP]) for rows in padded))[0]
        for first in range(0, count, GROUP)
    ]
    flat = [np.ascontiguousarray(group.T).reshape(GROUP, size) for group in groups]
    return np.concatenate([np.zeros((0, size)), *flat])[:count]
