"""Entries of a mechanism file that stand for several, such as `leg_{i}: {for: {i: 1..6}, type: distance, …}`.

An entry with `for` is replaced by one entry for each value of its indices. `{…}` in its names, keys and values is
replaced by the value of the expression in it; in values that are expressions, an index may also stand alone.
"""

from __future__ import annotations

import itertools
import keyword
import re
from collections.abc import Iterator, Mapping
from typing import Any

from mbd_sim.base.errors import InputError, MechanismError, quoted
from mbd_sim.files.builders.mechanism import in_order
from mbd_sim.files.checks.json_schema import takes_expression
from mbd_sim.files.text.library import MAX_VALUES, file_error
from mbd_sim.files.text.parameters import Parameters, resolve_parameters
from mbd_sim.files.text.units import split_unit
from mbd_sim.mechanism.values.expression import RESERVED, evaluate, names_in
from mbd_sim.mechanism.values.names import PLAIN_PATTERN, QUOTED
from mbd_sim.mechanism.values.source import Location, Source

FOR = "for"
VARIABLES = ("t", "x", "y", "z")  # of expressions; an index of such a name would hide them
_BRACES = re.compile(r"(?<!\$)\{([^{}]*)\}")
_EXAMPLE = "Write for example 'for: {i: 1..6}'."
Indices = Mapping[str, float | str]


def expanded(source: Source) -> Source:
    """The source with every entry that has `for` replaced by the entries that it stands for.

    :raises MechanismError: with every problem of the repetitions.
    """
    if not isinstance(source.data, dict) or not _has_repetition(source.data, ()):
        return source
    return _Expansion(source).result()


def _holds_entries(location: Location) -> bool:
    """Whether the entries of the mapping or list at a location may have `for`."""
    match location:
        case ("parts" | "joints" | "constraints" | "contacts" | "forces" | "actuators" | "sensors",):
            return True
        case ("ground", "points"):
            return True
        case ("parts", _, "points" | "shapes" | "meshes"):
            return True
    return False


def _has_repetition(value: Any, location: Location) -> bool:
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    if _holds_entries(location) and any(isinstance(entry, dict) and FOR in entry for _, entry in inner):
        return True
    inner = value.items() if isinstance(value, dict) else ()
    return len(location) < 3 and any(_has_repetition(entry, (*location, key)) for key, entry in inner)


class _Expansion:
    """Copies the data of a file, entry by entry, with the line of the template for each copy."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._parameters: Parameters = resolve_parameters(source)
        self._used: set[str] = set()
        self._expressions: dict[Location, bool] = {}  # whether the value at a location of the template is one
        self._count = 0
        self._result = Source(
            data=None,
            file=source.file,
            text=source.text,
            problems=list(source.problems),
            origins=dict(source.origins),
            notes=source.notes,
            remarks=source.remarks,
            format=source.format,
            template=source.data,
            template_lines=source.lines,
        )

    def result(self) -> Source:
        """The source without repetitions.

        :raises MechanismError: with every problem of the repetitions.
        """
        self._result.data = self._copy(self._source.data, (), (), {})
        if len(self._result.problems) > len(self._source.problems):
            raise MechanismError(in_order(self._result.problems))
        self._result.shaping = frozenset(self._with_dependencies(self._used))
        return self._result

    def _copy(self, value: Any, old: Location, new: Location, indices: Indices) -> Any:
        """A copy of the value at `old` in the template, for the place `new`."""
        self._count += 1
        if self._count > MAX_VALUES:
            message = f"the repetitions expand to more than {MAX_VALUES} values"
            raise file_error(self._source.file, self._source.line(old), message, "Use fewer repetitions.")
        if old in self._source.lines:
            self._result.lines[new] = self._source.lines[old]
        if isinstance(value, dict):
            return self._mapping(value, old, new, indices)
        if isinstance(value, list):
            return self._list(value, old, new, indices)
        if isinstance(value, str) and indices:
            return self._replaced(value, old, indices, self._takes_expression(old))
        return value

    def _takes_expression(self, location: Location) -> bool:
        known = self._expressions.get(location)
        if known is None:
            known = self._expressions[location] = takes_expression(self._source.data, location)
        return known

    def _mapping(self, value: dict[str, Any], old: Location, new: Location, indices: Indices) -> dict[str, Any]:
        result: dict[str, Any] = {}
        holds_entries = _holds_entries(old)
        for key, inner in value.items():
            here = (*old, key)
            repeated = holds_entries and isinstance(inner, dict) and FOR in inner
            for scope in self._scopes(inner[FOR], here, indices) if repeated else [indices]:
                name = self._replaced(key, here, scope, False) if scope else key
                place = (*new, name)
                if name in result:
                    self._report_twice(here, name, key, scope)
                    break
                if repeated:
                    self._result.repetitions[place] = _in_words(scope)
                    body = {other: entry for other, entry in inner.items() if other != FOR}
                    result[name] = self._copy(body, here, place, scope)
                else:
                    result[name] = self._copy(inner, here, place, scope)
        return result

    def _list(self, value: list[Any], old: Location, new: Location, indices: Indices) -> list[Any]:
        result: list[Any] = []
        for index, inner in enumerate(value):
            here = (*old, index)
            if _holds_entries(old) and isinstance(inner, dict) and FOR in inner:
                body = {key: entry for key, entry in inner.items() if key != FOR}
                for scope in self._scopes(inner[FOR], here, indices):
                    place = (*new, len(result))
                    self._result.repetitions[place] = _in_words(scope)
                    result.append(self._copy(body, here, place, scope))
            else:
                result.append(self._copy(inner, here, (*new, len(result)), indices))
        return result

    def _scopes(self, written: Any, entry: Location, outer: Indices) -> Iterator[Indices]:
        """The values of all indices for each repetition of an entry; the last index changes fastest."""
        if not isinstance(written, dict) or not written:
            self._report((*entry, FOR), InputError("must be a mapping of an index to its values", _EXAMPLE))
            return
        scopes = [outer]
        for name, values in written.items():
            try:
                self._check_index(name, outer)
                scopes = [{**scope, name: value} for scope in scopes for value in self._values(values, scope)]
                if len(scopes) > MAX_VALUES:
                    raise InputError(f"expands to more than {MAX_VALUES} entries", "Use fewer repetitions.")
            except InputError as error:
                self._report((*entry, FOR, name), error)
                return
        yield from scopes

    def _check_index(self, name: str, outer: Indices) -> None:
        if not re.fullmatch(PLAIN_PATTERN, name) or keyword.iskeyword(name):
            raise InputError("not a valid index name", "Use letters, such as i.")
        if name in RESERVED or name in VARIABLES:
            raise InputError(f"'{name}' is reserved in expressions", "Choose another name, such as i.")
        if name in (self._source.data.get("parameters") or {}):
            raise InputError(f"the index '{name}' has the name of a parameter", "Rename one of them.")
        if name in outer:
            raise InputError(f"the index '{name}' is already used by an enclosing entry", "Rename one of them.")

    def _values(self, written: Any, scope: Indices) -> list[float | str]:
        """The values that an index takes."""
        if isinstance(written, list):
            for value in written:
                if isinstance(value, bool) or not isinstance(value, int | float | str):
                    raise InputError("must be a list of numbers or words", "Write for example [left, right].", value)
            return list(written)
        first, dots, last = str(written).partition("..")
        if not dots or not isinstance(written, str):
            raise InputError("must be a range or a list", "Write for example 1..6 or [left, right].", written)
        begin, end = self._whole(first, scope), self._whole(last, scope)
        if end < begin - 1:
            message = f"the range begins with {begin} and ends with {end}"
            raise InputError(message, "Begin with the smaller number, or list the values.", written)
        if end - begin >= MAX_VALUES:
            raise InputError(f"has more than {MAX_VALUES} values", "Use fewer repetitions.", written)
        return list(range(begin, end + 1))

    def _whole(self, text: str, scope: Indices) -> int:
        value = self._evaluated(text, scope)
        if not value.is_integer():
            raise InputError(f"{quoted(text.strip())} is {value:g}, not a whole number", "Write for example 1..6.")
        return int(value)

    def _evaluated(self, text: str, indices: Indices) -> float:
        text = self._parameters.functions.expanded(text.strip())
        numbers = {name: value for name, value in indices.items() if not isinstance(value, str)}
        self._used |= names_in(text, self._parameters.values) & self._parameters.values.keys()
        return evaluate(text, {**self._parameters.values, **numbers})

    def _replaced(self, text: str, location: Location, indices: Indices, is_expression: bool) -> str:
        """A text with the values of the indices in it."""

        def braces(found: re.Match[str]) -> str:
            content = found[1].strip()
            value = indices[content] if content in indices else self._evaluated(content, indices)
            return _inserted(value, text[found.end() :] if is_expression else None)

        def word(found: re.Match[str]) -> str:
            return found[0] if found[1] else _inserted(indices[found[0]], found.string[found.end() :])

        try:
            result = _BRACES.sub(braces, text)
            if is_expression:
                result = re.sub(rf"({QUOTED})|(?<![\w.])(?:{'|'.join(indices)})(?!\w|\s*\()", word, result)
            return result
        except InputError as error:
            self._report(location, InputError(error.message, error.remedy, text), _in_words(indices))
            return text

    def _report(self, location: Location, error: InputError, repetition: str = "") -> None:
        self._result.problems.append(self._source.problem_of(location, error, repetition))

    def _report_twice(self, entry: Location, name: str, key: str, scope: Indices) -> None:
        message = f"the name '{name}' is given twice"
        remedy, plain = "Choose another name.", key.replace("${", "{")
        if scope and plain != key and _BRACES.search(plain):
            remedy = f"Write the index of a name without $: {plain}."
        elif scope and not _BRACES.search(key):
            remedy = f"Put the index into the name: {key}_{{{list(scope)[-1]}}}."
        self._report(entry, InputError(message, remedy), _in_words(scope))

    def _with_dependencies(self, names: set[str]) -> set[str]:
        """The parameters, and all those on which their values depend."""
        found: set[str] = set()
        waiting = list(names)
        while waiting:
            name = waiting.pop()
            if name not in found and name in self._parameters.values:
                found.add(name)
                value = self._source.data["parameters"][name]
                if isinstance(value, str):
                    waiting += sorted(names_in(self._parameters.functions.expanded(split_unit(value)[0])))
        return found


def _inserted(value: float | str, following: str | None) -> str:
    """The text for a value: in parentheses where a power follows; `following` is None in names.

    :raises InputError: a fraction in a name.
    """
    if isinstance(value, str):
        return value
    if following is None and value != int(value):
        raise InputError(f"{value:g} is not a whole number and cannot be part of a name", "Use whole numbers or words.")
    text = repr(int(value)) if value == int(value) else repr(float(value))
    is_base = following is not None and re.match(r"\s*(\*\*|\^)", following)
    return f"({text})" if value < 0 and is_base else text


def _in_words(indices: Indices) -> str:
    return ", ".join(f"{name} = {value}" for name, value in itertools.islice(indices.items(), 5))
