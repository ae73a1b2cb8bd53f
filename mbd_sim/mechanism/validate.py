"""A parsed file against the schema: every problem at once, each with its line and a remedy."""

from __future__ import annotations

from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from mbd_sim.errors import MechanismError, Problem, nearest
from mbd_sim.mechanism.expression import CONSTANTS, FUNCTIONS, ExpressionError, names_in
from mbd_sim.mechanism.quantity import parse_value, split_unit
from mbd_sim.mechanism.schema import MechanismFile
from mbd_sim.mechanism.source import Location, Source


def validate(source: Source) -> tuple[MechanismFile, dict[str, float]]:
    """The file's records and the values of its parameters.

    :raises MechanismError: with all problems that the schema finds.
    """
    if not isinstance(source.data, dict):
        raise MechanismError(
            [source.problem((), "a mechanism file is a mapping with 'mechanism', 'parts' and 'joints'")]
        )
    parameters, problems = resolve_parameters(source)
    try:
        file = MechanismFile.model_validate(source.data, context={"parameters": parameters})
    except ValidationError as error:
        problems += [_problem(source, details) for details in error.errors(include_url=False)]
    if problems:
        raise MechanismError(sorted(set(problems), key=lambda problem: problem.line))
    return file, parameters


def resolve_parameters(source: Source) -> tuple[dict[str, float], list[Problem]]:
    """The values of the file's `parameters`, which may use each other in any order.

    Those that cannot be resolved are reported and stand as 1, so that what uses them is not reported as well.
    """
    written = source.data.get("parameters")
    if not isinstance(written, dict):
        return {}, []
    values: dict[str, float] = {}
    problems: list[Problem] = []

    def fail(name: str, error: ExpressionError) -> None:
        problems.append(source.problem(("parameters", name), str(error), error.remedy, written[name]))
        values[name] = 1.0

    waiting: dict[str, set[str]] = {}
    for name, value in written.items():
        try:
            if name in CONSTANTS or name in FUNCTIONS:
                raise ExpressionError(f"'{name}' is a built-in name", "Choose another name.")
            used = names_in(split_unit(value)[0]) if isinstance(value, str) else set()
            unknown = sorted(used - set(written))
            if unknown:
                raise ExpressionError(f"unknown name '{unknown[0]}'", nearest(unknown[0], written))
            waiting[name] = used
        except ExpressionError as error:
            fail(name, error)
    while waiting:
        ready = [name for name, used in waiting.items() if used <= set(values)]
        if not ready:
            circle = ExpressionError(f"parameters refer to each other in a circle: {', '.join(waiting)}")
            for name in waiting:
                fail(name, circle)
            break
        for name in ready:
            del waiting[name]
            try:
                values[name] = parse_value(written[name], values, si_unit=None)
            except ExpressionError as error:
                fail(name, error)
    return values, problems


def _problem(source: Source, details: ErrorDetails) -> Problem:
    location, value = _in_file(source, details["loc"])
    context = details.get("ctx", {})
    kind = details["type"]
    message, remedy = details["msg"], str(context.get("remedy", ""))
    leaf = str(details["loc"][-1]) if details["loc"] else ""
    if kind == "extra_forbidden":
        message, remedy = f"unknown key '{leaf}'", nearest(leaf, _known_keys(details["loc"][:-1]))
        return source.problem(location, message, remedy)
    if kind == "missing" and isinstance(value, list):
        return source.problem(location, f"has only {len(value)} values", "", value)
    if kind == "missing":
        return source.problem(location, f"'{_file_key(leaf)}' is missing", "Add it.")
    if kind == "union_tag_not_found":
        return source.problem(location, "'type' is missing", nearest("", _tags(details["loc"])))
    if kind == "union_tag_invalid":
        tag = str(context.get("tag", ""))
        return source.problem((*location, "type"), f"unknown type '{tag}'", nearest(tag, _tags(details["loc"])))
    if kind == "string_pattern_mismatch":
        pattern = str(context.get("pattern", ""))
        remedy = (
            "Letters, digits and _ only, a letter first." if "A-Za-z" in pattern else "Write a colour as '#rrggbb'."
        )
        message = "not a valid name" if "A-Za-z" in pattern else "not a colour"
    elif kind in ("model_type", "model_attributes_type", "dict_type"):
        message, remedy = "must be a mapping of keys to values", ""
    elif kind in ("tuple_type", "list_type"):
        message, remedy = "must be a list", "Write it as [a, b, c]."
    elif kind == "too_long":
        message = f"has {context.get('actual_length')} values, not {context.get('max_length')}"
    elif kind == "too_short":
        message, remedy, value = "needs at least one entry", "", None
    elif kind == "record":
        value = None
    return source.problem(location, message[:1].lower() + message[1:], remedy, value)


def _in_file(source: Source, loc: tuple[int | str, ...]) -> tuple[Location, Any]:
    """A pydantic location without the tags of unions, and the value that stands there."""
    location: Location = ()
    value = source.data
    for step in loc:
        if (isinstance(value, dict) and step in value) or (
            isinstance(value, list) and isinstance(step, int) and step < len(value)
        ):
            value = value[step]
        else:
            continue
        location += (step,)
    return location, value


def json_schema() -> dict[str, Any]:
    """The JSON Schema of mechanism files, for editors."""
    schema = MechanismFile.model_json_schema(by_alias=True)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "mbd_sim mechanism", **schema}


def _schema_at(loc: tuple[int | str, ...]) -> dict[str, Any]:
    """The part of the JSON Schema that describes a pydantic location."""
    whole = json_schema()

    def resolved(node: dict[str, Any]) -> dict[str, Any]:
        while "$ref" in node:
            node = whole["$defs"][node["$ref"].rsplit("/", 1)[-1]]
        return node

    node = resolved(whole)
    for step in loc:
        options = [resolved(option) for option in node.get("anyOf", node.get("oneOf", []))]
        mapping = node.get("discriminator", {}).get("mapping", {})
        for option in options:
            mapping = mapping or option.get("discriminator", {}).get("mapping", {})
            if step in option.get("properties", {}) or (step == "mapping" and "properties" in option):
                node = option
        if step in mapping:
            node = resolved({"$ref": mapping[step]})
        elif step in node.get("properties", {}):
            node = resolved(node["properties"][step])
        elif isinstance(node.get("additionalProperties"), dict):
            node = resolved(node["additionalProperties"])
        elif isinstance(node.get("patternProperties"), dict):
            node = resolved(next(iter(node["patternProperties"].values())))
        elif isinstance(step, int):
            lists = [part for part in [node, *options] if "items" in part]
            node = resolved(lists[0]["items"]) if lists else node
    return node


def _known_keys(loc: tuple[int | str, ...]) -> list[str]:
    return list(_schema_at(loc).get("properties", {}))


def _tags(loc: tuple[int | str, ...]) -> list[str]:
    node = _schema_at(loc)
    for option in [node, *node.get("anyOf", [])]:
        if "discriminator" in option:
            return list(option["discriminator"]["mapping"])
    return []


def _file_key(field: str) -> str:
    return {"start": "from", "end": "to"}.get(field, field)
