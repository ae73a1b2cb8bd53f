"""The data of a mechanism file as readable YAML: an entry per line, short mappings and lists in brackets."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

import yaml

from mbd_sim.files.text.yaml_reader import UNPRINTABLE, plain_scalar
from mbd_sim.mechanism.values.source import Location, Source

WIDTH = 120
WHOLE = 1e15  # whole numbers below it are written without a decimal point

_STRING = "tag:yaml.org,2002:str"
_RESOLVER = yaml.resolver.Resolver()


def yaml_text(data: dict[str, Any], comments: Iterable[str] = ()) -> str:
    """The text from which `parse_source` reads the same data; keys without a value are left out."""
    head = "".join(f"# {_one_line(comment)}\n" for comment in comments)
    body: str = yaml.serialize(_node(data, ()), Dumper=yaml.SafeDumper, width=WIDTH, allow_unicode=True)
    return head + body


def mechanism_text(source: Source) -> str:
    """YAML from which alone a mechanism can be built again: the text of its file, or its converted or changed data."""
    if source.changed:
        return yaml_text(source.data)
    return yaml_text(source.data, source.comments) if source.text is None else source.text


def _one_line(comment: str) -> str:
    return " ".join(UNPRINTABLE.sub(" ", comment).split())


def _node(value: Any, location: Location) -> yaml.Node:
    flow = not _block(location)
    if isinstance(value, dict):
        given = {key: inner for key, inner in value.items() if inner is not None}
        pairs = [(_scalar(str(key)), _node(inner, (*location, str(key)))) for key, inner in given.items()]
        return yaml.MappingNode("tag:yaml.org,2002:map", pairs, flow_style=flow or not pairs)
    if isinstance(value, list | tuple):
        nodes = [_node(inner, (*location, index)) for index, inner in enumerate(value)]
        return yaml.SequenceNode("tag:yaml.org,2002:seq", nodes, flow_style=flow or not nodes)
    return _scalar(value)


def _block(location: Location) -> bool:
    """Whether each entry at a location is on its own line: in sections, in their entries, and in the lists of parts."""
    match location:
        case () | ("parameters" | "functions" | "ground",) | ("ground", "points"):
            return True
        case ("parts" | "joints" | "constraints" | "contacts" | "forces" | "actuators", *rest) if len(rest) <= 1:
            return True
        case ("parts", _, "points" | "shapes" | "meshes"):
            return True
    return False


def _scalar(value: Any) -> yaml.ScalarNode:
    if value is None:  # in a list; in a mapping it is left out
        return yaml.ScalarNode("tag:yaml.org,2002:null", "null")
    if isinstance(value, str):
        plain = value.isprintable() and _tag(value) == _STRING and isinstance(plain_scalar(value), str)
        lines = value.replace("\n", "").isprintable() and "\n" in value
        return yaml.ScalarNode(_STRING, value, style=None if plain else "|" if lines else '"')
    text = str(value).lower() if isinstance(value, bool) else _number(value)
    return yaml.ScalarNode(_tag(text), text)


def _tag(text: str) -> Any:
    """The tag of a text without quotes in YAML 1.1, which the writer follows."""
    return _RESOLVER.resolve(yaml.ScalarNode, text, (True, False))  # type: ignore[no-untyped-call]


def _number(value: float) -> str:
    if isinstance(value, int):
        return str(value)
    if value.is_integer() and abs(value) < WHOLE:
        return str(int(value))
    return re.sub(r"^(-?)(inf|nan)$", r"\1.\2", repr(value))
