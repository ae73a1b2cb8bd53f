"""A parsed file against the schema: every problem at once, each with its line and a remedy."""

from __future__ import annotations

import copy
import functools
import keyword
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from pydantic import TypeAdapter, ValidationError
from pydantic.json_schema import GenerateJsonSchema
from pydantic_core import ErrorDetails

from mbd_sim.errors import MechanismError, Problem, listed, nearest, quoted
from mbd_sim.mechanism.expression import CONSTANTS, FUNCTIONS, ExpressionError, names_in
from mbd_sim.mechanism.source import Location, Source
from mbd_sim.mechanism_file.builders.mechanism_builder import assemble, in_order
from mbd_sim.mechanism_file.library import SUFFIXES
from mbd_sim.mechanism_file.quantity import parse_value, split_unit
from mbd_sim.mechanism_file.schema.base_schema import NAME_PATTERN, SUFFIX
from mbd_sim.mechanism_file.schema.constraint_schema import AnyConstraintSpec
from mbd_sim.mechanism_file.schema.file_schema import GroundSpec, MechanismFile, PartSpec
from mbd_sim.mechanism_file.schema.force_schema import AnyForceSpec
from mbd_sim.mechanism_file.schema.joint_schema import AnyJointSpec

# What a user may call the types that a file knows by another name.
_SYNONYMS = {
    "hinge": "revolute", "pin": "revolute", "rotation": "revolute", "continuous": "revolute",
    "slider": "prismatic", "translation": "prismatic", "weld": "fixed", "rigid": "fixed", "floating": "free",
    "bar": "rod", "disk": "disc", "wheel": "disc", "hoop": "ring", "box": "block", "cuboid": "block",
    "ball": "sphere", "point": "particle", "rectangle": "plate",
}  # fmt: skip

MERGED = ("parts", "joints")  # sections whose entries may be written in part beside those of a URDF


def validate(source: Source) -> tuple[MechanismFile, dict[str, float]]:
    """The file's records and the values of its parameters.

    :raises MechanismError: with all that the schema finds, and what is wrong with the parts and joints it accepts.
    """
    if not isinstance(source.data, dict):
        message = "a mechanism file is a mapping with 'mechanism', 'parts' and 'joints'"
        remedy = "Begin with a line such as 'mechanism: pendulum'."
        if isinstance(source.data, str) and source.data.endswith(SUFFIXES):
            remedy = "This is a path: load_mechanism reads files, parse_mechanism their text."
        raise MechanismError([source.problem((), message, remedy, source.data)])
    parameters = resolve_parameters(source)
    problems = source.problems + parameters.problems
    context = {"parameters": parameters.values, "unresolved": parameters.unresolved}
    file = None
    try:
        file = MechanismFile.model_validate(source.data, context=context)
    except ValidationError as error:
        problems += [_problem(source, details) for details in error.errors(include_url=False)]
    if problems or file is None:
        raise MechanismError(in_order(problems + _beyond_the_schema(source, context)))
    return file, parameters.values


@dataclass
class Parameters:
    """The values of a file's parameters, the names of those that have none, and why."""

    values: dict[str, float] = field(default_factory=dict)
    unresolved: set[str] = field(default_factory=set)
    problems: list[Problem] = field(default_factory=list)


def resolve_parameters(source: Source) -> Parameters:
    """The values of the file's `parameters`, which may use each other in any order."""
    result = Parameters()
    written = source.data.get("parameters")
    if not isinstance(written, dict):
        return result

    def fail(name: str, error: ExpressionError) -> None:
        result.problems.append(source.problem(("parameters", name), str(error), error.remedy, written[name]))
        result.unresolved.add(name)

    uses: dict[str, set[str]] = {}
    for name, value in written.items():
        try:
            uses[name] = _used_names(name, value, written)
        except ExpressionError as error:
            fail(name, error)
    for name in _dependencies_first(uses):
        if uses[name] & result.unresolved:
            result.unresolved.add(name)
            continue
        try:
            result.values[name] = parse_value(written[name], result.values, si_unit=None)
        except ExpressionError as error:
            fail(name, error)
    left = {name: used for name, used in uses.items() if name not in result.values and name not in result.unresolved}
    result.unresolved |= set(left)
    after_a_circle = set(_dependencies_first(_reversed(left)))
    circle = [name for name in left if name not in after_a_circle]
    for name in circle:
        message = f"parameters refer to each other in a circle: {listed(circle)}"
        fail(name, ExpressionError(message, "Give one of them a value of its own."))
    return result


def _used_names(name: str, value: object, written: Mapping[str, object]) -> set[str]:
    if name in CONSTANTS or name in FUNCTIONS or keyword.iskeyword(name):
        raise ExpressionError(f"'{name}' has a meaning in expressions", "Choose another name.")
    used = names_in(split_unit(value)[0]) if isinstance(value, str) else set()
    unknown = sorted(used - set(written))
    if unknown:
        raise ExpressionError(f"unknown name {quoted(unknown[0])}", nearest(unknown[0], set(written) - {name}))
    return used


def _dependencies_first(uses: Mapping[str, set[str]]) -> list[str]:
    """The names, each after those that it uses; without the names in circles and those that use them."""
    users = _reversed(uses)
    waiting = {name: len(used & uses.keys()) for name, used in uses.items()}
    order = [name for name, count in waiting.items() if not count]
    for name in order:
        for user in sorted(users[name]):
            waiting[user] -= 1
            if not waiting[user]:
                order.append(user)
    return order


def _reversed(uses: Mapping[str, set[str]]) -> dict[str, set[str]]:
    users: dict[str, set[str]] = {name: set() for name in uses}
    for name, used in uses.items():
        for other in used & uses.keys():
            users[other].add(name)
    return users


def _beyond_the_schema(source: Source, context: dict[str, Any]) -> list[Problem]:
    """What is wrong with the parts, joints and forces that the schema accepts, in a file that it refuses."""
    keys = ("parts", "joints", "forces", "constraints", "ground")
    written_parts, written_joints, written_forces, written_constraints, ground = map(source.data.get, keys)
    records = {"ground": {} if ground is None else ground}
    accepted_ground = _accepted(records, TypeAdapter(GroundSpec), context).get("ground")
    parts = _accepted(written_parts, TypeAdapter(PartSpec), context)
    joints: dict[str, Any] = {}
    forces: dict[str, Any] = {}
    unreadable, all_joints = [] if accepted_ground else ["ground"], False
    if isinstance(written_parts, dict) and isinstance(written_joints, dict):
        unreadable += [name for name in written_parts if name not in parts]
        ends = {name: joint.get("between") for name, joint in written_joints.items() if isinstance(joint, dict)}
        welds = {name: {"type": "fixed", "between": between} for name, between in ends.items()}
        as_written = _accepted(written_joints, TypeAdapter(AnyJointSpec), context)
        # of joints that are refused, the ends can still be checked
        joints = _accepted(welds, TypeAdapter(AnyJointSpec), context) | as_written
        all_joints = as_written.keys() == written_joints.keys()
    if isinstance(written_forces, dict):
        plain = {name: _plain_force(force) for name, force in written_forces.items() if isinstance(force, dict)}
        for records in (plain, written_forces):  # likewise
            forces |= _accepted(records, TypeAdapter(AnyForceSpec), context)
    constraints = _accepted(written_constraints, TypeAdapter(AnyConstraintSpec), context)
    frame = accepted_ground or GroundSpec()
    return assemble(parts, joints, forces, constraints, frame, source, unreadable, all_joints).problems


def _plain_force(written: dict[str, Any]) -> dict[str, Any]:
    """A force element with the ends of a written one and nothing else."""
    if "between" in written:
        return {"type": "spring", "between": written["between"], "stiffness": 1}
    kind, key = ("couple", "on") if "on" in written else ("force", "at")
    return {"type": kind, key: written.get(key), "vector": [0, 0, 0]}


def _accepted(records: object, adapter: TypeAdapter[Any], context: dict[str, Any]) -> dict[str, Any]:
    accepted = {}
    for name, record in records.items() if isinstance(records, dict) else ():
        try:
            accepted[name] = adapter.validate_python(record, context=context)
        except ValidationError:
            continue  # reported already
    return accepted


def _problem(source: Source, details: ErrorDetails) -> Problem:
    """What pydantic found, in the words of the file."""
    loc, kind, context = details["loc"], details["type"], details.get("ctx", {})
    location, value = _in_file(source, loc)
    leaf = str(loc[-1]) if loc else ""
    match kind:
        case "extra_forbidden":
            return source.problem(location, f"unknown key {quoted(leaf)}", nearest(leaf, _known_keys(loc[:-1])))
        case "missing" | "too_long" if isinstance(value, list):
            where = loc[:-1] if kind == "missing" else loc
            return source.problem(location, f"has {_count(len(value))}, not {_length(where)}", _form(where), value)
        case "missing" if value is None:
            return source.problem(location, "has no value", "Give it one.")
        case "missing":
            return source.problem(location, f"'{leaf}' is missing", "Add it.")
        case "union_tag_not_found":
            return source.problem(location, "'type' is missing", nearest("", _tags(loc)))
        case "union_tag_invalid":
            tag = value.get("type") if isinstance(value, dict) else None
            if tag is None:
                return source.problem((*location, "type"), "has no value", nearest("", _tags(loc)))
            known = f"Did you mean '{_SYNONYMS[tag]}'? " if isinstance(tag, str) and tag in _SYNONYMS else ""
            remedy = f"{known}Valid: {listed(_tags(loc))}." if known else nearest(str(tag), _tags(loc))
            return source.problem((*location, "type"), f"unknown type {quoted(tag)}", remedy)
        case "literal_error":
            return source.problem(location, "unknown word", f"Write {context['expected']}.".replace("'", ""), value)
        case "quantity" | "record":
            message, remedy = str(context.get("why", "")), str(context.get("remedy", ""))
            return source.problem(location, message, remedy, value if kind == "quantity" else None)
    message, remedy = _wording(kind, loc, value)
    if "[key]" in loc or kind == "too_short":
        value = None
    elif value is None:
        message, remedy = "has no value", remedy or "Give it one."
    return source.problem(location, message or details["msg"], remedy, value)


def _wording(kind: str, loc: tuple[int | str, ...], value: object) -> tuple[str, str]:
    """A message and a remedy for a kind of error, both empty for kinds that cannot occur."""
    match kind:
        case "string_pattern_mismatch" if "color" in loc[-1:]:
            return "not a colour", "Write it in quotes, as '#1f77b4'."
        case "string_pattern_mismatch" | "string_too_long":
            text = str(loc[-2] if loc[-1:] == ("[key]",) else value)
            valid = re.sub(r"[^A-Za-z0-9_]+", "_", text).strip("_")
            example = f", for example {valid}" if len(valid) <= 60 and re.match(NAME_PATTERN, valid) else ""
            return "not a valid name", f"Letters, digits and _ only, a letter first, 60 at most{example}."
        case "string_type":
            between = "Write the name of a part, or part.point." if "between" in loc[-2:] else "Put it in quotes."
            return "must be text", between
        case "bool_type" | "bool_parsing":
            return "must be true or false", "Write true or false."
        case "tuple_type" | "list_type":
            return "must be a list", _form(loc)
        case "model_type" | "model_attributes_type" | "dict_type" if loc[-1:] == ("mapping",):
            return "must be a list or a mapping", _form((*loc[:-1], "list"))
        case "model_type" | "model_attributes_type" | "dict_type":
            keys = _known_keys(loc)
            return (
                "must be a mapping of keys to values",
                f"Its keys: {listed(keys)}." if keys else "Write 'name: value'.",
            )
        case "too_short":
            return "needs at least one entry", "Add one below it."
    return "", ""


def _count(number: int) -> str:
    return f"{number} value" if number == 1 else f"{number} values"


def _form(loc: tuple[int | str, ...]) -> str:
    """How a list of fixed length is written."""
    if loc[-1:] == ("between",):
        return "Write it as [ground, part] or [part.point, part.point]."
    if loc[-1:] == ("table",):
        return "Write it as [[elongation, force], [elongation, force]]."
    if "table" in loc[-2:]:
        return "Write it as [elongation, force]."
    if "inertia" in loc[-2:]:
        return "Write it as [I_xx, I_yy, I_zz] or {xx: …, yy: …, zz: …, xy: …}."
    letters = {2: "x, y", 3: "x, y, z", 4: "w, x, y, z"}.get(_length(loc))
    return f"Write it as [{letters}]." if letters else "Begin each entry with '- '."


def _in_file(source: Source, loc: tuple[int | str, ...]) -> tuple[Location, Any]:
    """A pydantic location without the tags of unions, and the value that stands there."""
    location: Location = ()
    value = source.data
    for step in loc:
        if isinstance(value, list) and isinstance(step, int) and step < len(value):
            value = value[step]
        elif isinstance(value, dict) and step in value:
            value = value[str(step)]
        else:
            continue  # the tag of a union, or a key that is missing
        location += (step,)
    return location, value


class _PlainNames(GenerateJsonSchema):
    """Names definitions as users know the things, without the suffix of our classes."""

    def normalize_name(self, name: str) -> str:
        """The name of a definition."""
        return super().normalize_name(name.removesuffix(SUFFIX))


@functools.cache
def _json_schema() -> dict[str, Any]:
    schema = MechanismFile.model_json_schema(by_alias=True, schema_generator=_PlainNames)
    _forbid_other_names(schema)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema, "title": "mbd_sim mechanism"}


def _forbid_other_names(node: object) -> None:
    """Names that match no pattern are errors, which pydantic leaves out of its schema."""
    for inner in node.values() if isinstance(node, dict) else node if isinstance(node, list) else []:
        _forbid_other_names(inner)
    if isinstance(node, dict) and isinstance(node.get("patternProperties"), dict):
        node["additionalProperties"] = False


def json_schema() -> dict[str, Any]:
    """The JSON Schema of mechanism files, for editors. A file with `urdf` may leave out what the URDF has."""
    schema = copy.deepcopy(_json_schema())
    alone = {"required": schema.pop("required")}
    for section in MERGED:
        properties = schema["properties"]
        alone.setdefault("properties", {})[section] = properties[section]
        properties[section] = {"type": "object", "description": properties[section].get("description", section)}
    return {**schema, "if": {"required": ["urdf"]}, "else": alone}


def _schema_at(loc: tuple[int | str, ...]) -> list[dict[str, Any]]:
    """The parts of the JSON Schema that describe a pydantic location: several where a value may take several forms."""
    nodes = _forms(_json_schema())
    for step in loc:
        nodes = [form for node in nodes for inner in _below(node, step) for form in _forms(inner)] or nodes
    return nodes


def _forms(node: dict[str, Any]) -> list[dict[str, Any]]:
    """A part of the schema with its references followed; all its alternatives where it has some."""
    if "$ref" in node:
        node = _json_schema()["$defs"][node["$ref"].rsplit("/", 1)[-1]]
    alternatives = node.get("anyOf", []) + node.get("oneOf", [])
    if "discriminator" in node or not alternatives:
        return [node]
    return [form for alternative in alternatives for form in _forms(alternative)]


def _below(node: dict[str, Any], step: int | str) -> list[dict[str, Any]]:
    """What stands in a part of the schema under a key, an index or the tag of an alternative."""
    tagged = node.get("discriminator", {}).get("mapping", {})
    if step in tagged:
        return [{"$ref": tagged[step]}]
    if isinstance(step, int):
        return node.get("prefixItems", [])[step : step + 1] or [node[key] for key in ("items",) if key in node]
    if step in node.get("properties", {}):
        return [node["properties"][step]]
    if step == {"array": "list", "object": "mapping"}.get(node.get("type", "")) and "patternProperties" not in node:
        return [node]
    return list(node.get("patternProperties", {}).values())


def _known_keys(loc: tuple[int | str, ...]) -> list[str]:
    nodes = [form for node in _schema_at(loc) for form in (_variants(node) if "discriminator" in node else [node])]
    return list(dict.fromkeys(key for node in nodes for key in node.get("properties", {})))


def _variants(node: dict[str, Any]) -> list[dict[str, Any]]:
    return [form for reference in node["discriminator"]["mapping"].values() for form in _forms({"$ref": reference})]


def _length(loc: tuple[int | str, ...]) -> int:
    return max((int(node.get("minItems", 0)) for node in _schema_at(loc)), default=0)


def _tags(loc: tuple[int | str, ...]) -> list[str]:
    return [tag for node in _schema_at(loc) for tag in node.get("discriminator", {}).get("mapping", {})]
