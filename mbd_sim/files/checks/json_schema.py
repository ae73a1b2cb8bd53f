"""The JSON Schema of mechanism files, for editors and for error messages."""

from __future__ import annotations

import copy
import functools
from collections.abc import Sequence
from typing import Any

from pydantic import create_model
from pydantic.json_schema import GenerateJsonSchema

from mbd_sim.files.schema.fields import SUFFIX, Spec, validator_of
from mbd_sim.files.schema.file import MechanismFile
from mbd_sim.files.text.spelling import FORMER_KEYS
from mbd_sim.mechanism.values.source import Location, value_at

PydanticLocation = tuple[int | str, ...]  # keys, indices, and tags of unions
SchemaNode = dict[str, Any]

UNIT_KEY = "x-unit"  # of the number of a quantity, see `Quantity`
REPEATED_SECTIONS = ("parts", "joints", "constraints", "contacts", "forces", "actuators", "sensors")
REPEATED_NAME = r"^[^{]*\{.*$"  # with an index in braces
REPETITION: SchemaNode = {
    "type": "object",
    "description": "indices and their values: the entry stands for one entry for each of them",
    "minProperties": 1,
    "additionalProperties": {
        "anyOf": [
            {"type": "string", "pattern": r"\.\."},
            {"type": "array", "items": {"type": ["number", "string"]}},
        ]
    },
}
MERGED_SECTIONS = ("parts", "joints")  # whose entries may be incomplete beside a URDF that has the rest of them

_FORMS_BY_TYPE = {"array": "list", "object": "mapping"}  # the tags of alternatives


def json_schema() -> SchemaNode:
    """The JSON Schema of mechanism files. A file with `urdf` may leave out entries that the URDF has."""
    schema = copy.deepcopy(_json_schema())
    _admit_former_keys(schema)
    _admit_repetition(schema)
    alone = {"required": schema.pop("required")}
    for section in MERGED_SECTIONS:
        properties = schema["properties"]
        alone.setdefault("properties", {})[section] = properties[section]
        properties[section] = {"type": "object", "description": properties[section].get("description", section)}
    return {**schema, "if": {"required": ["urdf"]}, "else": alone}


def known_keys(location: PydanticLocation) -> list[str]:
    """The keys that a mapping at this location may have."""
    schema, nodes = _nodes_at(location)
    nodes = [form for node in nodes for form in (_variants(node, schema) if "discriminator" in node else [node])]
    return list(dict.fromkeys(key for node in nodes for key in node.get("properties", {})))


def list_length(location: PydanticLocation) -> int:
    """The number of entries that a list at this location has; 0 if it may have any number."""
    return max((int(node.get("minItems", 0)) for node in _nodes_at(location)[1]), default=0)


def known_types(location: PydanticLocation) -> list[str]:
    """The values that `type` may have in a mapping at this location."""
    return [tag for node in _nodes_at(location)[1] for tag in node.get("discriminator", {}).get("mapping", {})]


def takes_expression(data: Any, location: Location) -> bool:
    """Whether the value at a location of a file's data may be an expression."""
    nodes = _nodes_of(data, location)
    return any("number" in (kinds := node.get("type", "")) or kinds == "number" for node in nodes)


def unit_at(data: Any, location: Location) -> str:
    """The SI unit of the quantity at a location of a file's data; empty if it is none, or has none."""
    written = (node.get(UNIT_KEY, "") for node in _nodes_of(data, location))
    return next((str(unit) for unit in written if unit), "")


def _nodes_of(data: Any, location: Location) -> list[SchemaNode]:
    """The parts of the schema that describe the value at a location of a file's data."""
    schema = _schema_around(location)
    nodes = _forms(schema, schema)
    for step in location:
        kind = data.get("type") if isinstance(data, dict) else None
        tagged = [inner for node in nodes if "discriminator" in node and kind for inner in _below(node, str(kind))]
        nodes = [form for node in tagged or nodes for form in _forms(node, schema)]
        nodes = [form for node in nodes for inner in _below(node, step) for form in _forms(inner, schema)]
        data = value_at(data, (step,))
    return nodes


class _Generator(GenerateJsonSchema):
    """Names the definitions like the Python classes, without their suffix."""

    def normalize_name(self, name: str) -> str:
        """The name of a definition."""
        return super().normalize_name(name.removesuffix(SUFFIX))


@functools.cache
def _json_schema() -> SchemaNode:
    schema = validator_of(MechanismFile).json_schema(by_alias=True, schema_generator=_Generator)
    _forbid_other_names(schema)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema, "title": "mbd_sim mechanism"}


def _schema_around(location: Sequence[object]) -> SchemaNode:
    """The JSON Schema of mechanism files without sections other than the one of a location; only their keys are there.

    The whole one takes longer than reading most files.
    """
    section = location[0] if location else None
    schema = _section_schema(section) if isinstance(section, str) and section in MechanismFile.model_fields else {}
    return {**schema, "properties": {key: {} for key in MechanismFile.model_fields} | schema.get("properties", {})}


@functools.cache
def _section_schema(section: str) -> SchemaNode:
    field = MechanismFile.model_fields[section]
    fields: dict[str, Any] = {section: (field.annotation, field)}
    model = create_model(MechanismFile.__name__, __base__=Spec, **fields)
    return validator_of(model).json_schema(by_alias=True, schema_generator=_Generator)


def _admit_former_keys(schema: SchemaNode) -> None:
    for definition in schema["$defs"].values():
        properties = definition.get("properties", {})
        for former, current in FORMER_KEYS.items():
            if current in properties:
                properties[former] = {**properties[current], "deprecated": True}


def _admit_repetition(schema: SchemaNode) -> None:
    """Admit `for` in entries that may stand for several, and indices in their names."""
    properties, part = schema["properties"], schema["$defs"]["Part"]["properties"]
    points = [schema["$defs"]["Ground"]["properties"]["points"], part["points"]]
    for entries in [*(properties[section] for section in REPEATED_SECTIONS), *points]:
        patterns = entries["patternProperties"]
        patterns[REPEATED_NAME] = next(iter(patterns.values()))
    schema["$defs"]["Repetition"] = REPETITION
    repeated = {"Part", "Point", "Mesh", *_names_in(properties), *_names_in(part["shapes"])}
    for name in repeated - {"Ground", "Integration"}:
        schema["$defs"][name]["properties"]["for"] = {"$ref": "#/$defs/Repetition"}


def _names_in(node: object) -> set[str]:
    """The names of the definitions to which a part of the schema refers directly."""
    inner = node.values() if isinstance(node, dict) else node if isinstance(node, list) else ()
    found = {name for value in inner for name in _names_in(value)}
    reference = node.get("$ref") if isinstance(node, dict) else None
    return found | {reference.rsplit("/", 1)[-1]} if isinstance(reference, str) else found


def _forbid_other_names(node: object) -> None:
    """Declare names that match no pattern as errors: pydantic refuses them, but its schema does not say so."""
    for inner in node.values() if isinstance(node, dict) else node if isinstance(node, list) else []:
        _forbid_other_names(inner)
    if isinstance(node, dict) and isinstance(node.get("patternProperties"), dict):
        node["additionalProperties"] = False


def _nodes_at(location: PydanticLocation) -> tuple[SchemaNode, list[SchemaNode]]:
    """A schema, and its parts that describe a location; several where a value may have several forms."""
    schema = _schema_around(location)
    nodes = _forms(schema, schema)
    for step in location:
        nodes = [form for node in nodes for inner in _below(node, step) for form in _forms(inner, schema)] or nodes
    return schema, nodes


def _forms(node: SchemaNode, schema: SchemaNode) -> list[SchemaNode]:
    """A node of a schema with its reference resolved, or all its alternatives."""
    if "$ref" in node:
        node = schema["$defs"][node["$ref"].rsplit("/", 1)[-1]]
    alternatives = node.get("anyOf", []) + node.get("oneOf", [])
    if "discriminator" in node or not alternatives:
        return [node]
    return [form for alternative in alternatives for form in _forms(alternative, schema)]


def _below(node: SchemaNode, step: int | str) -> list[SchemaNode]:
    """The nodes below a node under a key, an index or the tag of an alternative."""
    tagged = node.get("discriminator", {}).get("mapping", {})
    if step in tagged:
        return [{"$ref": tagged[step]}]
    if isinstance(step, int):
        return node.get("prefixItems", [])[step : step + 1] or [node[key] for key in ("items",) if key in node]
    if step in node.get("properties", {}):
        return [node["properties"][step]]
    if step == _FORMS_BY_TYPE.get(str(node.get("type"))) and "patternProperties" not in node:
        return [node]
    others = node.get("additionalProperties")
    return [*node.get("patternProperties", {}).values(), *([others] if isinstance(others, dict) else [])]


def _variants(node: SchemaNode, schema: SchemaNode) -> list[SchemaNode]:
    references = node["discriminator"]["mapping"].values()
    return [form for reference in references for form in _forms({"$ref": reference}, schema)]
