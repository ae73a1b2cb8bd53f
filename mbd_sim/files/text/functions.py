"""The `functions` of a mechanism file: named expressions of arguments, `stroke(t, phase): l + s*sin(w*t + phase)`.

Each call of a function is replaced by its body, so that everything beyond this module reads plain expressions. Names
that refer to each other, of functions or of parameters, are put into an order in which they can be evaluated.
"""

from __future__ import annotations

import ast
import copy
import functools
import keyword
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import chain

from mbd_sim.base.errors import InputError, Problem, listed, nearest, quoted
from mbd_sim.files.text.values import split_unit, unit_factor
from mbd_sim.mechanism.values.expression import CALLABLE, MAX_EXPANDED, RESERVED, names_in, parsed
from mbd_sim.mechanism.values.names import QUOTED
from mbd_sim.mechanism.values.source import Source


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
