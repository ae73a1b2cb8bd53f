"""Arithmetic expressions with named values: parsed, checked and evaluated node by node, never executed as code."""

from __future__ import annotations

import ast
import functools
import keyword
import math
import re
import unicodedata
from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass
from itertools import chain
from typing import Any

from mbd_sim.errors import InputError, nearest, quoted

MAX_LENGTH = 500  # of an expression as written
MAX_EXPANDED = 5000  # of one in which functions of the file are replaced by their bodies
TIME = "t"

CONSTANTS: dict[str, float] = {"pi": math.pi, "e": math.e}
HIDEABLE = "e"  # may be the name of a parameter as well, by tradition a coefficient of restitution
FUNCTIONS: dict[str, tuple[int, Callable[..., float]]] = {
    "sqrt": (1, math.sqrt), "exp": (1, math.exp), "log": (1, math.log), "abs": (1, abs),
    "sin": (1, math.sin), "cos": (1, math.cos), "tan": (1, math.tan),
    "asin": (1, math.asin), "acos": (1, math.acos), "atan": (1, math.atan), "atan2": (2, math.atan2),
    "min": (2, min), "max": (2, max), "hypot": (2, math.hypot),
}  # fmt: skip
_BINARY: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b,
}
# Only numbers, names and operators reach Python's parser.
_TOKENS = re.compile(r"(?>\s+|(?>(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(?![\w.])|[^\W\d]\w*|[-+*/(),^])*+")
_NAMES = re.compile(r"(?<![\w.])([^\W\d]\w*)(\s*\()?")


@dataclass(frozen=True)
class Arithmetic:
    """The functions and the power operator to evaluate with: for numbers, or for the symbols of a library."""

    functions: Mapping[str, tuple[int, Callable[..., Any]]]
    power: Callable[[Any, Any], Any]


NUMBERS = Arithmetic(FUNCTIONS, math.pow)


@dataclass(frozen=True)
class TimeExpression:
    """An expression of the time `t` in s or of other variables, with the values of all other names in it."""

    text: str
    names: Mapping[str, float]

    def at(self, time: float) -> float:
        """Its value at a time in s.

        :raises InputError: it has no finite value.
        """
        return evaluate(self.text, {**self.names, TIME: time})


def names_in(text: str, defined: Container[str] = ()) -> set[str]:
    """The names that an expression refers to, except functions and those constants that are not `defined` otherwise.

    :raises InputError: not an arithmetic expression.
    """
    parsed(text)
    found = _NAMES.findall(unicodedata.normalize("NFKC", text))  # as Python's parser reads them
    called = {name for name, parenthesis in found if parenthesis}
    constants = {name for name in CONSTANTS if name not in defined}
    return {name for name, _ in found if not keyword.iskeyword(name)} - called - constants


def evaluate(text: str, names: Mapping[str, float]) -> float:
    """The value of an arithmetic expression such as `m*l**2/12` (`^` may stand for `**`).

    :raises InputError: not arithmetic, an unknown name, or no finite value.
    """
    try:
        value = float(evaluate_with(text, names, NUMBERS))
    except ZeroDivisionError as error:
        raise InputError("division by zero", "Check the divisor.") from error
    except InputError:
        raise
    except (ValueError, OverflowError) as error:
        raise InputError("has no finite value", _OUT_OF_RANGE) from error
    except RecursionError as error:
        raise InputError("is nested too deeply", "Split it into parameters.") from error
    if not math.isfinite(value):
        raise InputError("has no finite value", _OUT_OF_RANGE)
    return value


def evaluate_with(text: str, names: Mapping[str, Any], arithmetic: Arithmetic) -> Any:
    """The value of an expression in the given arithmetic.

    :raises InputError: not arithmetic, or an unknown name.
    """
    return _value(parsed(text).body, names, arithmetic)


@functools.lru_cache(maxsize=4096)  # an expression is parsed for its names and then for its value
def parsed(text: str) -> ast.Expression:
    """The syntax tree of an expression; it is shared, and must not be changed.

    :raises InputError: not an arithmetic expression.
    """
    if len(text) > MAX_EXPANDED:
        raise InputError(f"is longer than {MAX_EXPANDED} characters", "Split it into parameters.")
    if not _TOKENS.fullmatch(text) or re.fullmatch(r"\d+,\d+", text.strip()):
        raise InputError(_NO_VALUE, "Write decimals with a point." if re.search(r"\d,\d", text) else _EXAMPLES)
    try:
        return ast.parse(text.strip().replace("^", "**"), mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise InputError(_NO_VALUE, _EXAMPLES) from error


_OUT_OF_RANGE = "Check the numbers in it."
_NO_VALUE = "not a number, a value with a unit, or an expression"
_EXAMPLES = "Write for example 0.5, 30 deg, l/2, or ${l/2} mm."


def _value(node: ast.expr, names: Mapping[str, Any], arithmetic: Arithmetic) -> Any:
    match node:
        case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
            return float(number)
        case ast.Name(id=name):
            if name in names:
                return names[name]
            if name in CONSTANTS:
                return CONSTANTS[name]
            raise InputError(f"unknown name {quoted(name)}", nearest(name, chain(names, CONSTANTS)))
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return -_value(operand, names, arithmetic)
        case ast.UnaryOp(op=ast.UAdd(), operand=operand):
            return _value(operand, names, arithmetic)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _BINARY:
            return _BINARY[type(op)](_value(left, names, arithmetic), _value(right, names, arithmetic))
        case ast.BinOp(left=left, op=ast.Pow(), right=right):
            return arithmetic.power(_value(left, names, arithmetic), _value(right, names, arithmetic))
        case ast.Call(func=ast.Name(id=name), args=args, keywords=[]):
            if name in names:
                raise InputError(f"'{name}' is not a function", f"To multiply, write {name}*(...).")
            if name not in arithmetic.functions:
                raise InputError(f"unknown function {quoted(name)}", nearest(name, arithmetic.functions))
            count, function = arithmetic.functions[name]
            if len(args) != count:
                values = f"{count} value{'s' if count > 1 else ''}"
                raise InputError(
                    f"{name}() takes {values}, not {len(args)}", f"Write {name}({'a, b'[: 3 * count - 2]})."
                )
            return function(*(_value(arg, names, arithmetic) for arg in args))
    raise InputError("only numbers, names, + - * / ** ( ) and functions are allowed here", _EXAMPLES)
