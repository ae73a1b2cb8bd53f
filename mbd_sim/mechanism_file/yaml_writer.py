"""The data of a mechanism file as readable YAML: an entry per line, short mappings and lists in brackets."""

from __future__ import annotations

import functools
import re
from collections.abc import Iterable
from typing import Any

import yaml

from mbd_sim.mechanism.source import Location, Source
from mbd_sim.mechanism_file.yaml_layout import UnusualTextError, YamlLayout
from mbd_sim.mechanism_file.yaml_scalars import UNPRINTABLE, plain_scalar

WIDTH = 120
WHOLE = 1e15  # whole numbers below it are written without a decimal point

_STRING = "tag:yaml.org,2002:str"
_RESOLVER = yaml.resolver.Resolver()


def yaml_text(data: dict[str, Any], comments: Iterable[str] = ()) -> str:
    """The text from which `parse_source` reads the same data; keys without a value are left out."""
    head = "".join(f"# {_one_line(comment)}\n" for comment in comments)
    try:
        return head + YamlLayout(WIDTH, _block, _plain, _is_quoted).text(data)
    except UnusualTextError:
        return head + text_by_pyyaml(data)


def text_by_pyyaml(data: dict[str, Any]) -> str:
    """The text of any data, which `YamlLayout` writes in the same way if it can."""
    text: str = yaml.serialize(_node(data, ()), Dumper=yaml.SafeDumper, width=WIDTH, allow_unicode=True)
    return text


def mechanism_text(source: Source) -> str:
    """YAML from which alone a mechanism can be built again: the text of its file, or its changed data."""
    return yaml_text(source.data) if source.changed else source.text


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
    if isinstance(value, str):
        return yaml.ScalarNode(_STRING, value, style='"' if _is_quoted(value) else None)
    text = _plain(value)
    return yaml.ScalarNode(_tag(text), text)


def _plain(value: Any) -> str:
    """The text of a number, true, false, or null, which is in lists only; mappings leave it out."""
    if value is None:
        return "null"
    return str(value).lower() if isinstance(value, bool) else _number(value)


@functools.lru_cache(maxsize=1024)
def _is_quoted(text: str) -> bool:
    """Whether a text without quotes would be read as something else, in YAML 1.1 or 1.2."""
    return not (text.isprintable() and _tag(text) == _STRING and isinstance(plain_scalar(text), str))


def _tag(text: str) -> Any:
    """The tag of a text without quotes in YAML 1.1, which the writer follows."""
    return _RESOLVER.resolve(yaml.ScalarNode, text, (True, False))  # type: ignore[no-untyped-call]


def _number(value: float) -> str:
    if isinstance(value, int):
        return str(value)
    if value.is_integer() and abs(value) < WHOLE:
        return str(int(value))
    return re.sub(r"^(-?)(inf|nan)$", r"\1.\2", repr(value))
