"""Arithmetic expressions with named values: parsed, checked and evaluated node by node, never executed as code.

Their constants and functions are defined here, with the arithmetics in which they can be evaluated.
"""

from __future__ import annotations

import ast
import functools
import math
import re
from collections.abc import Callable, Container, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import chain, pairwise
from typing import TYPE_CHECKING, Any, cast

from mbd_sim.base import rounded
from mbd_sim.base.errors import InputError, nearest, quoted
from mbd_sim.base.geometry.batch import Batch, is_finite, per_variant
from mbd_sim.mechanism.values.names import QUOTED

if TYPE_CHECKING:
    from mbd_sim.mechanism.values.tables import Table


CONSTANTS: dict[str, float] = {"pi": math.pi, "e": math.e}
HIDEABLE = "e"  # may be the name of a parameter as well, by tradition a coefficient of restitution
FUNCTIONS: dict[str, tuple[int, Callable[..., float]]] = {
    "sqrt": (1, math.sqrt), "exp": (1, rounded.exponential), "log": (1, rounded.logarithm), "abs": (1, abs),
    "sin": (1, rounded.sine), "cos": (1, rounded.cosine), "tan": (1, rounded.tangent),
    "asin": (1, rounded.arc_sine), "acos": (1, rounded.arc_cosine),
    "atan": (1, rounded.arc_tangent), "atan2": (2, rounded.arc_tangent),
    "min": (2, min), "max": (2, max), "hypot": (2, rounded.hypotenuse),
    "tanh": (1, rounded.hyperbolic_tangent), "sign": (1, lambda x: float(x > 0.0) - float(x < 0.0)),
    "floor": (1, math.floor),
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
    power=per_variant(rounded.power),
    divide=lambda a, b: a / b,
    where=lambda condition, a, b: a(NUMBERS) if condition else b(NUMBERS),
    look_up=lambda table, *at: table.at(*at),
)


MAX_LENGTH = 500  # of an expression as written
MAX_EXPANDED = 5000  # of one in which functions of the file are replaced by their bodies
TIME = "t"

_POWER = re.compile(rf"({QUOTED})|\^")
_BINARY: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
}
_COMPARISONS: dict[type[ast.cmpop], Callable[[Any, Any], Any]] = {
    ast.Lt: lambda a, b: a < b,
    ast.LtE: lambda a, b: a <= b,
    ast.Gt: lambda a, b: a > b,
    ast.GtE: lambda a, b: a >= b,
}
# Only numbers, names, perhaps in quotes, operators and comparisons reach Python's parser.
_TOKENS = re.compile(
    r"(?>\s+|(?>(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(?![\w.])"
    rf"|(?:[^\W\d]\w*(?!['\"\w])|{QUOTED})(?:\.[^\W\d]\w*)*|[-+*/(),^]|[<>]=?)*+"
)


@dataclass(frozen=True)
class StateName:
    """A name in an expression, as `written`, for a joint coordinate in m or rad, or for its speed in m/s or rad/s."""

    written: str
    coordinate: str
    speed: bool


@dataclass(frozen=True)
class TimeExpression:
    """An expression of the time `t` in s or of other variables, with the values of all other names in it.

    `tables` are those that it reads by name, and `state` the names of joint coordinates and speeds.
    """

    text: str
    names: Mapping[str, float]
    tables: Mapping[str, Table] = field(default_factory=dict)
    state: tuple[StateName, ...] = ()

    @property
    def variables(self) -> set[str]:
        """The names in it that have no value here: those that vary while the mechanism moves."""
        return names_in(self.text, self.names) - self.names.keys()

    def at(self, time: float) -> float:
        """Its value at a time in s.

        :raises InputError: it has no finite value.
        """
        return self.value({TIME: time})

    def value(self, variables: Mapping[str, float]) -> float:
        """Its value with these values of its variables.

        :raises InputError: it has no finite value.
        """
        return evaluate(self.text, {**self.names, **variables}, self.tables)


def names_in(text: str, defined: Container[str] = ()) -> set[str]:
    """The names that an expression refers to, except functions, tables and constants that are not `defined` otherwise.

    :raises InputError: not an arithmetic expression.
    """
    return {name for name in _names(parsed(text).body) if name not in CONSTANTS or name in defined}


def tables_in(text: str) -> set[str]:
    """The names of the tables that an expression reads.

    :raises InputError: not an arithmetic expression.
    """
    calls = (node for node in ast.walk(parsed(text)) if isinstance(node, ast.Call) and _is_table(node))
    return {_dotted(call.args[0]) for call in calls if call.args and _dotted(call.args[0])}


def _names(node: ast.AST) -> Iterator[str]:
    waiting = [node]
    while waiting:
        node = waiting.pop()
        if name := _dotted(node):
            yield name
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            waiting += node.args[1:] if _is_table(node) else node.args
        else:
            waiting += ast.iter_child_nodes(node)


def _is_table(call: ast.Call) -> bool:
    return isinstance(call.func, ast.Name) and call.func.id == TABLE


def _dotted(node: ast.AST) -> str:
    """The name that a node stands for, such as `crank.velocity`; empty if it stands for something else."""
    match node:
        case ast.Name(id=name) | ast.Constant(value=str(name)):
            return name
        case ast.Attribute(value=value, attr=attribute) if prefix := _dotted(value):
            return f"{prefix}.{attribute}"
    return ""


def evaluate(text: str, names: Mapping[str, float], tables: Mapping[str, Table] | None = None) -> float:
    """The value of an arithmetic expression such as `m*l**2/12` (`^` may stand for `**`).

    :raises InputError: not arithmetic, an unknown name, or no finite value.
    """
    try:
        value = evaluate_with(text, names, NUMBERS, tables)
        value = value if isinstance(value, Batch) else float(value)
    except ZeroDivisionError as error:
        raise InputError("division by zero", "Check the divisor.") from error
    except InputError:
        raise
    except (ValueError, OverflowError) as error:
        raise InputError("has no finite value", _OUT_OF_RANGE) from error
    except RecursionError as error:
        raise InputError("is nested too deeply", "Split it into parameters.") from error
    if not is_finite(value):
        raise InputError("has no finite value", _OUT_OF_RANGE)
    return cast(float, value)


def require_valid(text: str, names: Iterable[str], tables: Mapping[str, Table]) -> None:
    """Refuse an expression that uses functions, conditions or tables wrongly, also in parts that need no value.

    :param names: all names that have values.
    :raises InputError: what is wrong.
    """
    evaluate_with(text, dict.fromkeys(names, 1.0), FORM, tables)


def evaluate_with(
    text: str, names: Mapping[str, Any], arithmetic: Arithmetic, tables: Mapping[str, Table] | None = None
) -> Any:
    """The value of an expression in the given arithmetic.

    :raises InputError: not arithmetic, or an unknown name.
    """
    return _Evaluation(names, tables or {}).value(parsed(text).body, arithmetic)


@functools.lru_cache(maxsize=4096)  # an expression is parsed for its names and then for its value
def parsed(text: str) -> ast.Expression:
    """The syntax tree of an expression; it is shared, and must not be changed.

    :raises InputError: not an arithmetic expression.
    """
    if len(text) > MAX_EXPANDED:
        raise InputError(f"is longer than {MAX_EXPANDED} characters", "Split it into parameters.")
    if not _TOKENS.fullmatch(text) or re.fullmatch(r"\d+,\d+", text.strip()):
        raise InputError(_NO_VALUE, "Write decimals with a point." if re.search(r"\d,\d", text) else _remedy(text))
    try:
        return ast.parse(_POWER.sub(lambda found: found[1] or "**", text.strip()), mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise InputError(_NO_VALUE, _remedy(text)) from error


def is_cut(text: str) -> bool:
    """Whether a text has a parenthesis that is not closed, as what YAML leaves of an expression up to a comma."""
    return text.count("(") > text.count(")")


def _remedy(text: str) -> str:
    """What to write instead of a text that is not an expression."""
    if is_cut(text):
        return f"A parenthesis is not closed. {QUOTE_COMMAS}"
    if "(" in text and (found := _WITH_UNIT.search(text)) is not None:
        return (
            f"Numbers inside an expression have no units: in place of {quoted(found[0])}, write the number in SI "
            "units, or the name of a parameter that has the unit."
        )
    return _EXAMPLES


QUOTE_COMMAS = 'Between brackets or braces, put an expression with commas in quotes: "where(x > 0, a, b)".'
_WITH_UNIT = re.compile(r"(?<![\w.])(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?\s*(?!(?:and|or)\b)[^\W\d_][^\s,()<>=]*")
_OUT_OF_RANGE = "Check the numbers in it."
_NO_VALUE = "not a number, a value with a unit, or an expression"
_EXAMPLES = "Write for example 0.5, 30 deg, l/2, or ${l/2} mm."


@dataclass(frozen=True)
class _Evaluation:
    """Evaluates the nodes of an expression with the values of its names."""

    names: Mapping[str, Any]
    tables: Mapping[str, Table]

    def value(self, node: ast.expr, arithmetic: Arithmetic) -> Any:
        match node:
            case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
                return float(number)
            case ast.Name() | ast.Attribute() | ast.Constant() if name := _dotted(node):
                return self._named(name)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return -self.value(operand, arithmetic)
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return self.value(operand, arithmetic)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _BINARY:
                return _BINARY[type(op)](self.value(left, arithmetic), self.value(right, arithmetic))
            case ast.BinOp(left=left, op=ast.Div(), right=right):
                return arithmetic.divide(self.value(left, arithmetic), self.value(right, arithmetic))
            case ast.BinOp(left=left, op=ast.Pow(), right=right):
                return arithmetic.power(self.value(left, arithmetic), self.value(right, arithmetic))
            case ast.Call(func=ast.Name(id=name), args=args, keywords=[]):
                return self._called(name, args, arithmetic)
            case ast.Compare() | ast.BoolOp() | ast.UnaryOp(op=ast.Not()):
                message = "a comparison stands where a number is expected"
                raise InputError(message, "Use it as a condition: where(x > 0, a, b).")
        raise InputError("only numbers, names, + - * / ** ( ) and functions are allowed here", _EXAMPLES)

    def _named(self, name: str) -> Any:
        if name in self.names:
            return self.names[name]
        if name in CONSTANTS:
            return CONSTANTS[name]
        raise InputError(f"unknown name {quoted(name)}", nearest(name, chain(self.names, CONSTANTS)))

    def _called(self, name: str, args: list[ast.expr], arithmetic: Arithmetic) -> Any:
        if name in self.names:
            raise InputError(f"'{name}' is not a function", f"To multiply, write {name}*(...).")
        if name == TABLE:
            return self._looked_up(args, arithmetic)
        if name not in CALLABLE:
            raise InputError(f"unknown function {quoted(name)}", nearest(name, CALLABLE))
        count = 3 if name == WHERE else arithmetic.functions[name][0]
        if len(args) != count:
            values = f"{count} value{'s' if count > 1 else ''}"
            arguments = ARGUMENTS.get(name, "a, b, c"[: 3 * count - 2])
            raise InputError(f"{name}() takes {values}, not {len(args)}", f"Write {name}({arguments}).")
        if name == WHERE:
            return self._where(args, arithmetic)
        return arithmetic.functions[name][1](*(self.value(arg, arithmetic) for arg in args))

    def _where(self, args: list[ast.expr], arithmetic: Arithmetic) -> Any:
        condition = self.condition(args[0], arithmetic)
        return arithmetic.where(condition, *(functools.partial(self.value, branch) for branch in args[1:]))

    def condition(self, node: ast.expr, arithmetic: Arithmetic) -> Any:
        """Whether a comparison holds, or a combination of comparisons; parts that do not matter need no value."""
        match node:
            case ast.Compare(left=left, ops=ops, comparators=right) if all(type(op) in _COMPARISONS for op in ops):
                values = [self.value(side, arithmetic) for side in (left, *right)]
                holds = [_COMPARISONS[type(op)](a, b) for op, (a, b) in zip(ops, pairwise(values), strict=True)]
                return functools.reduce(lambda one, other: one * other, holds)
            case ast.BoolOp(op=op, values=[first, *rest]):
                others = rest[0] if len(rest) == 1 else ast.BoolOp(op, rest)
                further = functools.partial(self.condition, others)
                branches = (further, lambda _: 0.0) if isinstance(op, ast.And) else (lambda _: 1.0, further)
                return arithmetic.where(self.condition(first, arithmetic), *branches)
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return 1 - self.condition(operand, arithmetic)
        raise InputError("a condition must be a comparison", "Write for example where(x > 0 and x < 1, a, b).")

    def _looked_up(self, args: list[ast.expr], arithmetic: Arithmetic) -> Any:
        name = _dotted(args[0]) if args else ""
        if not name:
            raise InputError("table() needs the name of a table", "Write table(name, x) or table(name, x, y).")
        if name not in self.tables:
            remedy = nearest(name, self.tables) or "Define it under 'tables'; parameters and sizes cannot use tables."
            raise InputError(f"there is no table {quoted(name)}", remedy)
        table = self.tables[name]
        if len(args) != 1 + table.dimension:
            values = f"{table.dimension} variable{'s' if table.dimension > 1 else ''}"
            written = f"table({name}, x{', y' if table.dimension > 1 else ''})"
            raise InputError(f"'{name}' is a table of {values}, not of {len(args) - 1}", f"Write {written}.")
        return arithmetic.look_up(table, *(self.value(arg, arithmetic) for arg in args[1:]))
