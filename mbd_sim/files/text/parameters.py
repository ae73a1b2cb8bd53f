"""The names that expressions of a mechanism file use: `parameters`, `functions`, coordinates and speeds of joints.

Parameters may refer to each other in any order. The names of a joint's coordinate and speed are `crank`,
`crank.position` and `crank.velocity`. A function is an expression of arguments, such as
`stroke(t, phase): l + s*sin(w*t + phase)`; each call is replaced by its body, so that everything beyond this module
reads plain expressions.
"""

from __future__ import annotations

import ast
import copy
import functools
import keyword
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain
from typing import Any

from mbd_sim.base.errors import InputError, Problem, listed, nearest, quoted
from mbd_sim.files.text.units import factor, parse_value, si_factor, split_unit, unit_factor
from mbd_sim.mechanism.elements.joint_types import JOINT_KINDS, JointKind
from mbd_sim.mechanism.values.expression import (
    CALLABLE,
    CONSTANTS,
    HIDEABLE,
    MAX_EXPANDED,
    RESERVED,
    TIME,
    StateName,
    names_in,
    parsed,
)
from mbd_sim.mechanism.values.names import QUOTED, in_expression
from mbd_sim.mechanism.values.source import Source
from mbd_sim.mechanism.values.tables import Table


def dependencies_first(uses: Mapping[str, set[str]]) -> list[str]:
    """The names, each after those that it uses; without names in circles and those that depend on them."""
    used_by = users(uses)
    waiting = {name: len(used & uses.keys()) for name, used in uses.items()}
    order = [name for name, count in waiting.items() if not count]
    for name in order:
        for user in sorted(used_by[name]):
            waiting[user] -= 1
            if not waiting[user]:
                order.append(user)
    return order


def users(uses: Mapping[str, set[str]]) -> dict[str, set[str]]:
    """The names that use each name."""
    found: dict[str, set[str]] = {name: set() for name in uses}
    for name, used in uses.items():
        for other in used & uses.keys():
            found[other].add(name)
    return found


MAX_TOTAL = 500_000  # characters to which all calls in a file may expand
HEAD_PATTERN = r"^[A-Za-z][A-Za-z0-9_]*\s*\(\s*[A-Za-z][A-Za-z0-9_]*(\s*,\s*[A-Za-z][A-Za-z0-9_]*)*\s*\)$"
_EXAMPLE = "Write for example 'stroke(t): 0.1*sin(5*t)'."


@dataclass(frozen=True)
class FunctionDefinition:
    """A function: the names of its arguments, and its body, in which no other function of the file is left."""

    arguments: tuple[str, ...]
    body: ast.expr


@dataclass
class Functions:
    """The functions of a file by name, the names of those that are invalid, and what is wrong with them.

    `parameters` are the names of the file's parameters; `expanded_length` counts the characters inserted so far.
    """

    by_name: dict[str, FunctionDefinition] = field(default_factory=dict)
    unresolved: set[str] = field(default_factory=set)
    problems: list[Problem] = field(default_factory=list)
    parameters: frozenset[str] = frozenset()
    expanded_length: int = 0

    def expanded(self, expression: str) -> str:
        """The expression with each call of a function replaced by its body; the same text if it calls none.

        :raises InputError: wrong number of arguments, or the result is too long.
        """
        called = _called(expression)
        if not self.by_name or not called:
            return expression
        if unknown := sorted(called - {*CALLABLE} - self.by_name.keys() - self.unresolved - self.parameters):
            remedy = nearest(unknown[0], chain(self.by_name, CALLABLE))
            raise InputError(f"unknown function {quoted(unknown[0])}", remedy)
        if not (used := called & self.by_name.keys()):
            return expression
        text = _inlined(expression, tuple((name, self.by_name[name]) for name in sorted(used)))
        self.expanded_length += len(text)
        if len(text) > MAX_EXPANDED or self.expanded_length > MAX_TOTAL:
            raise InputError("is too long after its functions are inserted", "Simplify the functions.")
        return text

    def calls_invalid(self, expression: str) -> bool:
        """Whether an expression calls a function that could not be read, which is reported at the function."""
        return bool(self.unresolved and _called(expression) & self.unresolved)


@functools.lru_cache(maxsize=4096)  # a file is read again for each change of a live value; `parsed` shares the bodies
def _inlined(expression: str, functions: tuple[tuple[str, FunctionDefinition], ...]) -> str:
    return ast.unparse(_Inlined(dict(functions)).visit(copy.deepcopy(parsed(expression).body)))


class _Inlined(ast.NodeTransformer):
    """Replaces calls of functions by their bodies."""

    def __init__(self, functions: Mapping[str, FunctionDefinition]) -> None:
        self._functions = functions

    def visit_Call(self, node: ast.Call) -> ast.AST:
        self.generic_visit(node)
        if not isinstance(node.func, ast.Name) or node.func.id not in self._functions:
            return node
        name, function = node.func.id, self._functions[node.func.id]
        if len(node.args) != len(function.arguments) or node.keywords:
            count = len(function.arguments)
            message = f"{name}() takes {count} value{'s' if count > 1 else ''}, not {len(node.args)}"
            raise InputError(message, f"Write {name}({', '.join(function.arguments)}).")
        values = dict(zip(function.arguments, node.args, strict=True))
        size = sum(1 for argument in values.values() for _ in ast.walk(argument))
        if size * sum(1 for _ in ast.walk(function.body)) > 10 * MAX_EXPANDED:
            raise InputError("is too long after its functions are inserted", "Simplify the functions.")
        body: ast.AST = _Substituted(values).visit(copy.deepcopy(function.body))
        return body


class _Substituted(ast.NodeTransformer):
    """Replaces names by expressions."""

    def __init__(self, values: Mapping[str, ast.expr]) -> None:
        self._values = values

    def visit_Name(self, node: ast.Name) -> ast.AST:
        return self._values.get(node.id, node)


def resolve_functions(source: Source) -> Functions:
    """Read the file's `functions`, each after those that it calls."""
    parameters = source.data.get("parameters")
    names = set(parameters) if isinstance(parameters, dict) else set()
    result = Functions(parameters=frozenset(names))
    written = source.data.get("functions")
    if not isinstance(written, dict):
        return result
    heads: dict[str, str] = {}  # the key of each function in the file

    def fail(key: str, error: InputError) -> None:
        result.problems.append(source.problem(("functions", key), error.message, error.remedy, written[key]))
        result.unresolved.add(key.partition("(")[0].strip())

    for key in written:
        try:
            name = _checked_name(key, names, heads)
            heads[name] = key
        except InputError as error:
            fail(key, error)
    calls = {name: _called(written[key]) & heads.keys() for name, key in heads.items()}
    for name in dependencies_first(calls):
        if calls[name] & result.unresolved:
            result.unresolved.add(name)
            continue
        try:
            result.by_name[name] = _function(heads[name], written[heads[name]], names, result)
        except InputError as error:
            fail(heads[name], error)
    left = {name: used for name, used in calls.items() if name not in result.by_name and name not in result.unresolved}
    result.unresolved |= set(left)
    after_a_circle = set(dependencies_first(users(left)))
    circle = [name for name in left if name not in after_a_circle]
    for name in circle:
        message = f"functions call each other in a circle: {listed(circle)}"
        fail(heads[name], InputError(message, "A function can only call functions that do not call it."))
    return result


def _checked_name(key: str, parameters: set[str], known: Mapping[str, str]) -> str:
    form = re.fullmatch(HEAD_PATTERN, key)
    if form is None:
        raise InputError("not of the form name(argument, …)", _EXAMPLE)
    name, arguments = key.partition("(")[0].strip(), _arguments(key)
    for word in (name, *arguments):
        if word in RESERVED or keyword.iskeyword(word):
            raise InputError(f"'{word}' is reserved in expressions", "Choose another name.")
        if word in parameters:
            raise InputError(f"'{word}' is also a parameter", "Choose another name.")
    if name in known:
        raise InputError(f"the function '{name}' is given twice", "Rename one of them.")
    if len(set(arguments)) < len(arguments):
        raise InputError("two arguments have the same name", "Rename one of them.")
    return name


def _arguments(key: str) -> tuple[str, ...]:
    return tuple(word.strip() for word in key.partition("(")[2].rstrip(" )").split(","))


def _called(body: object) -> set[str]:
    found = re.findall(rf"{QUOTED}|([^\W\d]\w*)(?=\s*\()", str(body))
    return {name for name in found if name and not keyword.iskeyword(name)}


def _function(key: str, body: object, parameters: set[str], functions: Functions) -> FunctionDefinition:
    if isinstance(body, bool) or not isinstance(body, int | float | str):
        raise InputError("must be an expression", _EXAMPLE)
    expression, unit = split_unit(str(body))
    arguments = _arguments(key)
    used = names_in(expression)
    if unknown := sorted(name for name in used if name not in parameters and name not in arguments):
        head = f"{key.partition('(')[0].strip()}({', '.join([*arguments, unknown[0].replace('.', '_')])})"
        remedy = f"{nearest(unknown[0], {*parameters, *arguments})} Or make it an argument: {head}.".strip()
        raise InputError(f"unknown name {quoted(unknown[0])}", remedy, body)
    if unit:
        expression = f"({expression})*{unit_factor(unit, None)!r}"
    return FunctionDefinition(arguments, parsed(functions.expanded(expression)).body)


POSITION, VELOCITY = ".position", ".velocity"


@dataclass(frozen=True)
class CoordinateNames:
    """The coordinates of a file's joints by name, and whether each has a position: an angular velocity has none.

    `effort_units` are the SI units of their efforts. `unreadable` are joints of an unknown type.
    """

    has_position: Mapping[str, bool] = field(default_factory=dict)
    effort_units: Mapping[str, str] = field(default_factory=dict)
    unreadable: frozenset[str] = frozenset()

    def resolve(self, name: str) -> StateName | None:
        """What a name in an expression stands for; None if it is not the name of a coordinate or speed.

        :raises InputError: an angular velocity is used as a coordinate.
        """
        if any(name == joint or name.startswith(f"{joint}.") for joint in self.unreadable):
            return StateName(name, name, False)
        for suffix in (VELOCITY, POSITION, ""):
            coordinate = name.removesuffix(suffix)
            if not name.endswith(suffix) or coordinate not in self.has_position:
                continue
            if suffix != VELOCITY and not self.has_position[coordinate]:
                message = f"{quoted(coordinate)} is a component of an angular velocity: it has no position"
                raise InputError(message, f"For the speed write {in_expression(coordinate)}{VELOCITY}.")
            return StateName(name, coordinate, suffix == VELOCITY)
        return None

    def remedy_for_missing_quotes(self, expression: str) -> str:
        """What to do about a name such as shoulder-pitch that an expression has without quotes; "" if it has none."""
        found = [name for name in self.has_position if in_expression(name) != name and name in expression]
        return f"Put the name in quotes: {in_expression(found[0])}." if found else ""

    @property
    def suggestions(self) -> list[str]:
        """The names to which a misspelled one is compared."""
        speeds = [coordinate + VELOCITY for coordinate in self.has_position]
        return [*(name for name, has_position in self.has_position.items() if has_position), *speeds]


def coordinate_names(joints: Any) -> CoordinateNames:
    """The names for the `joints` of a file, as they are written."""
    found: dict[str, bool] = {}
    units: dict[str, str] = {}
    unreadable = set()
    for name, joint in joints.items() if isinstance(joints, dict) else ():
        kind = _kind(joint.get("type")) if isinstance(joint, dict) else None
        if kind is None:
            unreadable.add(name)
            continue
        for coordinate in kind.coordinates:
            found[name + coordinate.label] = kind.quaternion is None or not coordinate.rotation
            units[name + coordinate.label] = "N*m" if coordinate.rotation else "N"
    return CoordinateNames(found, units, frozenset(unreadable))


def _kind(written: Any) -> JointKind | None:
    return next((kind for name, kind in JOINT_KINDS.items() if name == written), None)


@dataclass
class Parameters:
    """The values of a file's parameters in SI units, the names of those that have none, and why they have none.

    `units` are those with which parameters are written. `functions` are those of the same file, and so are
    `coordinates` and `tables`, of which `unreadable_tables` are invalid. `ambiguous` are the names of joints that mean
    something else in expressions. If `lenient`, invalid numbers, which are reported already, count as unknown ones.
    """

    values: dict[str, float] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    ambiguous: frozenset[str] = frozenset()
    unresolved: set[str] = field(default_factory=set)
    problems: list[Problem] = field(default_factory=list)
    functions: Functions = field(default_factory=Functions)
    coordinates: CoordinateNames = field(default_factory=CoordinateNames)
    tables: dict[str, Table] = field(default_factory=dict)
    unreadable_tables: set[str] = field(default_factory=set)
    lenient: bool = False

    def unknown_in(self, value: str) -> bool:
        """Whether a value depends on a parameter or a function whose own problem is reported already."""
        if not (self.unresolved or self.functions.unresolved):
            return False
        expression, _ = split_unit(value)
        return self.functions.calls_invalid(expression) or bool(
            names_in(self.functions.expanded(expression), self.unresolved) & self.unresolved
        )

    def require_clear(self, expression: str, state: bool = False) -> None:
        """Refuse an expression with the name of a joint that is a constant too, or with a `state` the time.

        :raises InputError: which one.
        """
        doubtful = self.ambiguous if state else self.ambiguous - {TIME}
        if found := sorted(doubtful and names_in(expression, doubtful) & doubtful):
            what = "the time" if found[0] == TIME else "a constant"
            message = f"'{found[0]}' is {what} in expressions, and the name of a joint"
            raise InputError(message, f"Rename the joint, or write {found[0]}.position for its coordinate.")

    def unit_of(self, expression: str) -> str:
        """The unit of the parameter for which an expression stands, perhaps with a sign; "" if it is anything else."""
        return self.units.get(expression.strip("()+- "), "")

    def require_unit(self, expression: str, si_unit: str | None) -> None:
        """Refuse an expression that is a parameter with a unit that does not fit the quantity.

        :raises InputError: the parameter has another dimension, or another angle: a lead is per turn.
        """
        if si_unit is None or not (unit := self.unit_of(expression)):
            return
        name = expression.strip("()+- ")
        try:
            fits = factor(unit, si_unit) == si_factor(unit)
        except InputError as error:
            raise InputError(f"the parameter '{name}': {error.message}", error.remedy) from error
        if not fits:
            message = (
                f"the parameter '{name}' is in {unit}, and so counts per rad; a value in {si_unit} is expected here"
            )
            raise InputError(message, f"Write the parameter in {si_unit.partition('/')[0]}, without the angle.")

    def among(self, names: Collection[str]) -> dict[str, float]:
        """The values of those of the names that are parameters, in the order in which they were resolved."""
        return {name: self.values[name] for name in sorted(self.values.keys() & names, key=self._positions.__getitem__)}

    @cached_property
    def _positions(self) -> dict[str, int]:
        return {name: position for position, name in enumerate(self.values)}


def resolve_parameters(source: Source) -> Parameters:
    """Evaluate the file's `parameters`, each after those that it refers to."""
    functions = resolve_functions(source)
    joints, written = source.data.get("joints"), source.data.get("parameters")
    joint_names = frozenset(joints if isinstance(joints, dict) else ())
    ambiguous = joint_names & {*CONSTANTS, TIME} - (written.keys() if isinstance(written, dict) else set())
    result = Parameters(problems=list(functions.problems), functions=functions, ambiguous=ambiguous)
    if not isinstance(written, dict):
        return result

    def fail(name: str, error: InputError) -> None:
        result.problems.append(source.problem(("parameters", name), error.message, error.remedy, written[name]))
        result.unresolved.add(name)

    uses: dict[str, set[str]] = {}
    for name, value in written.items():
        try:
            uses[name] = _used_names(name, value, written, result)
        except InputError as error:
            fail(name, error)
    for name in dependencies_first(uses):
        value = written[name]
        calls_invalid = isinstance(value, str) and functions.calls_invalid(split_unit(value)[0])
        if calls_invalid or uses[name] & result.unresolved:
            result.unresolved.add(name)
            continue
        try:
            result.values[name] = parse_value(value, result.values, si_unit=None, functions=functions.expanded)
            if isinstance(value, str) and (unit := _unit(value, result)):
                result.units[name] = unit
        except InputError as error:
            fail(name, error)
    left = {name: used for name, used in uses.items() if name not in result.values and name not in result.unresolved}
    result.unresolved |= set(left)
    after_a_circle = set(dependencies_first(users(left)))
    circle = [name for name in left if name not in after_a_circle]
    for name in circle:
        message = f"parameters refer to each other in a circle: {listed(circle)}"
        fail(name, InputError(message, "Replace one of these references by a number."))
    return result


def _unit(value: str, parameters: Parameters) -> str:
    expression, unit = split_unit(value)
    return unit or parameters.unit_of(expression)


def _used_names(name: str, value: object, written: Mapping[str, object], parameters: Parameters) -> set[str]:
    if (name in RESERVED and name != HIDEABLE) or keyword.iskeyword(name):
        raise InputError(f"'{name}' is reserved in expressions", "Choose another name.")
    expression = parameters.functions.expanded(split_unit(value)[0]) if isinstance(value, str) else "0"
    parameters.require_clear(expression)
    used = names_in(expression, written)
    unknown = sorted(other for other in used if other not in written)
    if unknown:
        remedy = nearest(unknown[0], (other for other in written if other != name)) or "Define it under 'parameters'."
        raise InputError(f"unknown name {quoted(unknown[0])}", remedy)
    return used
