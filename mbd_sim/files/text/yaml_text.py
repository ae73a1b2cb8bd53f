"""YAML text as a tree of nodes and as plain data, with the line of every value; and data as readable YAML.

Aliases and merge keys are allowed. Scalars are read by the core schema of YAML 1.2: `1e3` is a number, `no` is a word.
What is written has an entry per line, and short mappings and lists in brackets.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Literal

import yaml

from mbd_sim.base.errors import Problem, nearest, quoted
from mbd_sim.files.text.library import MAX_BYTES, MAX_DEPTH, MAX_VALUES, file_error, too_deep
from mbd_sim.mechanism.values.source import Location, Source, dotted

_Loader = getattr(yaml, "CBaseLoader", yaml.BaseLoader)


@dataclass(eq=False)
class YamlNode:
    """A YAML value: a scalar with its `text`, or a list or a map with its `items` (keys and values alternate)."""

    kind: Literal["scalar", "list", "map"]
    line: int
    text: str = ""
    plain: bool = False
    items: list[YamlNode] = field(default_factory=list)


def compose(text: str, file: str) -> YamlNode:
    """The tree of nodes of a YAML text; aliases share the node that they repeat.

    :raises yaml.YAMLError: the text is not YAML.
    :raises MechanismError: a limit is exceeded, or the text has tags or a second document.
    """
    return _Composer(text, file).compose()


class _Composer:
    """Builds nodes from events with an explicit stack: deep nesting cannot overflow the interpreter's."""

    def __init__(self, text: str, file: str) -> None:
        self.text = text
        self.file = file
        self.anchors: dict[str, YamlNode] = {}

    def compose(self) -> YamlNode:
        root = YamlNode("list", 1)
        stack = [root]
        documents = values = 0
        last = max(1, len(self.text.splitlines()))
        for event in yaml.parse(self.text, Loader=_Loader):
            line = min(event.start_mark.line + 1, last) if event.start_mark else 1
            if isinstance(event, yaml.DocumentStartEvent):
                documents += 1
                if documents > 1:
                    raise file_error(
                        self.file, line, "a second YAML document starts here", "Keep one mechanism per file."
                    )
            if isinstance(event, yaml.SequenceEndEvent | yaml.MappingEndEvent):
                stack.pop()
            if not isinstance(event, yaml.NodeEvent):
                continue
            values += 1
            if values > MAX_VALUES:
                raise file_error(
                    self.file,
                    line,
                    f"more than {MAX_VALUES} values",
                    "A mechanism file normally has hundreds of values.",
                )
            node = self._node(event, line)
            stack[-1].items.append(node)
            if isinstance(event, yaml.CollectionStartEvent):
                stack.append(node)
                if len(stack) > MAX_DEPTH:
                    raise too_deep(self.file, line)
        return root.items[0] if root.items else YamlNode("scalar", 1, plain=True)

    def _node(self, event: yaml.NodeEvent, line: int) -> YamlNode:
        if isinstance(event, yaml.AliasEvent):
            name = str(event.anchor)
            if name not in self.anchors:
                known = nearest(name, self.anchors) or f"Mark a value before it with &{name[:60]}."
                raise file_error(self.file, line, f"unknown alias {quoted('*' + name)}", known)
            return self.anchors[name]
        tag: str | None = getattr(event, "tag", None)
        if tag and tag != "!":
            tag = quoted(tag.replace("tag:yaml.org,2002:", "!!"))
            raise file_error(self.file, line, f"the tag {tag} is not allowed", "Write plain values, without it.")
        if isinstance(event, yaml.ScalarEvent):
            node = YamlNode("scalar", line, text=event.value, plain=bool(event.implicit[0]))
        else:
            node = YamlNode("list" if isinstance(event, yaml.SequenceStartEvent) else "map", line)
        if event.anchor:
            self.anchors[event.anchor] = node
        return node


_INTEGER = re.compile(r"[-+]?[0-9]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_WORDS: dict[str, Any] = {
    "": None, "~": None, "null": None, "Null": None, "NULL": None,
    "true": True, "True": True, "TRUE": True, "false": False, "False": False, "FALSE": False,
    ".nan": math.nan, ".NaN": math.nan, ".NAN": math.nan,
}  # fmt: skip
_INFINITY = re.compile(r"([-+]?)\.(inf|Inf|INF)")

# Characters that YAML does not allow, and single surrogates.
UNPRINTABLE = re.compile("[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def plain_scalar(text: str) -> Any:
    """The value of a text without quotes: a number, true, false, null, or the text itself."""
    if text in _WORDS:
        return _WORDS[text]
    if len(text) <= 30 and _INTEGER.fullmatch(text):
        return int(text)
    if _FLOAT.fullmatch(text):
        return float(text)
    infinity = _INFINITY.fullmatch(text)
    if infinity:
        return -math.inf if infinity[1] == "-" else math.inf
    return text


def parse_source(text: str, file: str = "<text>") -> Source:
    """Parse YAML text; `file` is its name in error messages.

    :raises MechanismError: the text is not YAML, or too large.
    """
    source = Source(data=None, file=file, text=text)
    if len(text) > MAX_BYTES:
        raise file_error(
            file, 1, f"the text is longer than {MAX_BYTES} characters", "A mechanism file normally has a few kB."
        )
    if unprintable := UNPRINTABLE.search(text):
        line = text.count("\n", 0, unprintable.start()) + 1
        raise file_error(file, line, f"the character U+{ord(unprintable[0]):04X} is not allowed", "Remove it.")
    try:
        root = compose(text, file)
    except yaml.MarkedYAMLError as error:
        last = max(1, len(text.splitlines()))
        begun, found = (mark and min(mark.line + 1, last) for mark in (error.context_mark, error.problem_mark))
        line = found or begun or 1
        # libyaml reads ahead, and reaches its own limit before the nodes that it has read so far reach ours.
        if "maximum nesting depth" in (error.problem or ""):
            raise too_deep(file, line) from error
        context = f"{error.context} that begins on line {begun}" if begun and begun != line else error.context
        cause = " ".join(part for part in (context, error.problem) if part)
        raise file_error(file, line, f"not valid YAML: {cause}", _yaml_remedy(text, line)) from error
    except yaml.YAMLError as error:
        raise file_error(file, 1, f"not valid YAML: {error}", "") from error
    source.data = _Constructor(source).construct(root, ())
    return source


def _yaml_remedy(text: str, line: int) -> str:
    lines = text.splitlines()
    if 0 < line <= len(lines) and "${" in lines[line - 1] and re.search(r"[\[{,]\s*[^'\"]*\$\{", lines[line - 1]):
        return 'Inside [ ] and { } write the expression bare (l/2) or quoted ("${l/2}").'
    if 0 < line <= len(lines) and re.match(r"\s*\t", lines[line - 1]):
        return "Indent with spaces, not with tabs."
    return "Check indentation and punctuation near this line; a value with ': ' or ' #' in it needs quotes."


class _Constructor:
    """Builds data from nodes; counts the values that aliases expand to, so that a YAML bomb is refused early."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self.count = 0
        self.open: set[int] = set()

    def construct(self, node: YamlNode, location: Location) -> Any:
        self.count += 1
        if self.count > MAX_VALUES:
            remedy = "Use fewer aliases."
            raise file_error(self.source.file, node.line, f"aliases expand to more than {MAX_VALUES} values", remedy)
        if id(node) in self.open:
            raise file_error(self.source.file, node.line, "an alias is inside the value that it repeats", "Remove it.")
        if len(location) > MAX_DEPTH:
            raise too_deep(self.source.file, node.line)
        self.source.lines.setdefault(location, node.line)
        if node.kind == "scalar":
            return plain_scalar(node.text) if node.plain else node.text
        self.open.add(id(node))
        try:
            if node.kind == "list":
                return [self.construct(item, (*location, index)) for index, item in enumerate(node.items)]
            return self._mapping(node, location)
        finally:
            self.open.discard(id(node))

    def _mapping(self, node: YamlNode, location: Location) -> dict[str, Any]:
        mapping: dict[str, Any] = {}
        merged: list[tuple[YamlNode, Any]] = []
        for key_node, value_node in zip(node.items[::2], node.items[1::2], strict=True):
            if key_node.kind != "scalar":
                remedy = "In [ ] and { } and at the start of a line, quote texts that contain ? or { or [."
                raise file_error(self.source.file, key_node.line, "a key must be a word", remedy)
            key = key_node.text
            if key == "<<" and key_node.plain:
                merged.append((value_node, self.construct(value_node, (*location, "<<"))))
                continue
            if key in mapping:
                first = self.source.lines[(*location, key)]
                self._report(
                    (*location, key), key_node.line, f"is given twice, first on line {first}", "Remove one of them."
                )
                continue
            self.source.lines[(*location, key)] = key_node.line
            mapping[key] = self.construct(value_node, (*location, key))
        for value_node, value in merged:
            several = isinstance(value, list)
            for index, source in enumerate(value if several else [value]):
                if not isinstance(source, dict):
                    message = "must merge a mapping, or a list of mappings"
                    remedy = "Write <<: *name, and &name before the mapping to merge."
                    self._report((*location, "<<"), value_node.line, message, remedy)
                    continue
                for key, inherited in source.items():
                    if key not in mapping:
                        source_location = (*location, "<<", *([index] if several else []), key)
                        self.source.lines[(*location, key)] = self.source.lines[source_location]
                        mapping[key] = inherited
        return mapping

    def _report(self, location: Location, line: int, message: str, remedy: str) -> None:
        problem = Problem(message, remedy, key=dotted(location), file=self.source.file, line=line)
        self.source.problems.append(problem)


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
        case () | ("parameters" | "ranges" | "functions" | "ground",) | ("ground", "points"):
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
