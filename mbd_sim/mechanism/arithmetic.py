"""The constants and functions of expressions, and the arithmetics in which these can be evaluated."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from mbd_sim.geometry.batch import per_variant

CONSTANTS: dict[str, float] = {"pi": math.pi, "e": math.e}
HIDEABLE = "e"  # may be the name of a parameter as well, by tradition a coefficient of restitution
FUNCTIONS: dict[str, tuple[int, Callable[..., float]]] = {
    "sqrt": (1, math.sqrt), "exp": (1, math.exp), "log": (1, math.log), "abs": (1, abs),
    "sin": (1, math.sin), "cos": (1, math.cos), "tan": (1, math.tan),
    "asin": (1, math.asin), "acos": (1, math.acos), "atan": (1, math.atan), "atan2": (2, math.atan2),
    "min": (2, min), "max": (2, max), "hypot": (2, math.hypot),
    "tanh": (1, math.tanh), "sign": (1, lambda x: float(x > 0.0) - float(x < 0.0)), "floor": (1, math.floor),
    "mod": (2, lambda a, b: a - b * math.floor(a / b)), "clip": (3, lambda x, low, high: max(min(x, high), low)),
}  # fmt: skip
WHERE, TABLE = "where", "table"
ARGUMENTS = {WHERE: "condition, a, b", TABLE: "name, x"}  # of functions that are not functions of numbers
CALLABLE = (*FUNCTIONS, *ARGUMENTS)
# Functions that came later than files whose parameters and functions may have these names; those hide them.
HIDEABLE_FUNCTIONS = frozenset({"tanh", "sign", "floor", "mod", "clip", WHERE, TABLE})
RESERVED = frozenset({*CONSTANTS, *CALLABLE}) - HIDEABLE_FUNCTIONS
Branch = Callable[["Arithmetic"], Any]


@dataclass(frozen=True)
class Arithmetic:
    """The functions and operators to evaluate with: for numbers, or for the symbols of a library.

    `where(condition, a, b)` has a or b evaluated in the arithmetic that it passes to them, and `look_up` reads a table.
    """

    functions: Mapping[str, tuple[int, Callable[..., Any]]]
    power: Callable[[Any, Any], Any]
    divide: Callable[[Any, Any], Any]
    where: Callable[[Any, Branch, Branch], Any]
    look_up: Callable[..., Any]


def _branch_taken(condition: Any, a: Branch, b: Branch) -> Any:
    return a(NUMBERS) if condition else b(NUMBERS)


def _both_branches(condition: Any, a: Branch, b: Branch) -> Any:
    value, _ = a(FORM), b(FORM)
    return value


FORM: Arithmetic = Arithmetic(  # in which every function and every table has the value 1
    {name: (count, lambda *_: 1.0) for name, (count, _) in FUNCTIONS.items()},
    power=lambda a, b: 1.0,
    divide=lambda a, b: 1.0,
    where=_both_branches,
    look_up=lambda *_: 1.0,
)
NUMBERS: Arithmetic = Arithmetic(
    {name: (count, per_variant(function)) for name, (count, function) in FUNCTIONS.items()},
    power=per_variant(math.pow),
    divide=lambda a, b: a / b,
    where=_branch_taken,
    look_up=lambda table, *at: table.at(*at),
)
