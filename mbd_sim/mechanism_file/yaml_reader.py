"""YAML text to plain data, with the line on which every value stands.

The YAML 1.2 core schema is followed (`1e3` is a number, `no` is a word), aliases and merge keys are
allowed, and the size, depth and number of values are bounded, so that no file can exhaust the machine.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from mbd_sim.errors import MechanismError, Problem, nearest, quoted
from mbd_sim.mechanism.source import Location, Source, dotted

MAX_BYTES = 1_000_000
MAX_DEPTH = 40
MAX_VALUES = 100_000

_INTEGER = re.compile(r"[-+]?[0-9]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_WORDS: dict[str, Any] = {
    "": None, "~": None, "null": None, "Null": None, "NULL": None,
    "true": True, "True": True, "TRUE": True, "false": False, "False": False, "FALSE": False,
    ".nan": math.nan, ".NaN": math.nan, ".NAN": math.nan,
}  # fmt: skip
_INFINITY = re.compile(r"([-+]?)\.(inf|Inf|INF)")

# What YAML does not allow in a text, and what half of a split character leaves behind.
UNPRINTABLE = re.compile("[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")

_Loader = getattr(yaml, "CBaseLoader", yaml.BaseLoader)


def read_text(path: Path) -> str:
    """The text of a file.

    :raises MechanismError: the file cannot be read, is too large, or is not UTF-8.
    """
    try:
        with path.open("rb") as stream:
            raw = stream.read(MAX_BYTES + 1)
        if len(raw) > MAX_BYTES:
            raise _refused(str(path), 1, f"the file is larger than {MAX_BYTES} bytes", "A mechanism file is a few kB.")
        text = raw.decode("utf-8")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise _refused(str(path), line, f"not UTF-8 text: {error.reason}", "Save the file as UTF-8.") from error
    except OSError as error:
        raise _refused(str(path), 0, f"cannot read the file: {error.strerror}", "Check its permissions.") from error
    return text


def read_source(path: Path) -> Source:
    """Read a YAML file.

    :raises MechanismError: the file cannot be read, is too large, or is not YAML.
    """
    return parse_source(read_text(path), file=str(path))


def parse_source(text: str, file: str = "<text>") -> Source:
    """Parse YAML text; see `read_source`."""
    source = Source(data=None, file=file, text=text)
    if len(text) > MAX_BYTES:
        raise _refused(file, 1, f"the text is longer than {MAX_BYTES} characters", "A mechanism file is a few kB.")
    if unprintable := UNPRINTABLE.search(text):
        line = text.count("\n", 0, unprintable.start()) + 1
        raise _refused(file, line, f"the character U+{ord(unprintable[0]):04X} is not allowed", "Remove it.")
    try:
        root = _Composer(text, file).compose()
    except yaml.MarkedYAMLError as error:
        last = max(1, len(text.splitlines()))
        begun, found = (mark and min(mark.line + 1, last) for mark in (error.context_mark, error.problem_mark))
        line = found or begun or 1
        context = f"{error.context} begun on line {begun}" if begun and begun != line else error.context
        cause = " ".join(part for part in (context, error.problem) if part)
        raise _refused(file, line, f"not valid YAML: {cause}", _yaml_remedy(text, line)) from error
    except yaml.YAMLError as error:
        raise _refused(file, 1, f"not valid YAML: {error}", "") from error
    source.data = _Constructor(source).construct(root, ())
    return source


def _yaml_remedy(text: str, line: int) -> str:
    lines = text.splitlines()
    if 0 < line <= len(lines) and "${" in lines[line - 1] and re.search(r"[\[{,]\s*[^'\"]*\$\{", lines[line - 1]):
        return 'Inside [ ] and { } write the expression bare (l/2) or quoted ("${l/2}").'
    if 0 < line <= len(lines) and re.match(r"\s*\t", lines[line - 1]):
        return "Indent with spaces, not with tabs."
    return "Check indentation and punctuation near this line; a value that holds ': ' or ' #' needs quotes."


def _refused(file: str, line: int, message: str, remedy: str) -> MechanismError:
    return MechanismError([Problem(message=message, remedy=remedy, file=file, line=line)])


@dataclass(eq=False)
class _Node:
    kind: str
    line: int
    text: str = ""
    plain: bool = False
    items: list[_Node] = field(default_factory=list)


class _Composer:
    """Events to nodes with a stack of its own, so that deep nesting cannot overflow the interpreter's."""

    def __init__(self, text: str, file: str) -> None:
        self.text = text
        self.file = file
        self.anchors: dict[str, _Node] = {}

    def compose(self) -> _Node:
        root = _Node("list", 1)
        stack = [root]
        documents = values = 0
        last = max(1, len(self.text.splitlines()))
        for event in yaml.parse(self.text, Loader=_Loader):
            line = min(event.start_mark.line + 1, last) if event.start_mark else 1
            if isinstance(event, yaml.DocumentStartEvent):
                documents += 1
                if documents > 1:
                    raise _refused(self.file, line, "a second YAML document starts here", "Keep one mechanism a file.")
            if isinstance(event, yaml.SequenceEndEvent | yaml.MappingEndEvent):
                stack.pop()
            if not isinstance(event, yaml.NodeEvent):
                continue
            values += 1
            if values > MAX_VALUES:
                raise _refused(self.file, line, f"more than {MAX_VALUES} values", "A mechanism file has hundreds.")
            node = self._node(event, line)
            stack[-1].items.append(node)
            if isinstance(event, yaml.CollectionStartEvent):
                stack.append(node)
                if len(stack) > MAX_DEPTH:
                    raise _refused(self.file, line, f"nested deeper than {MAX_DEPTH} levels", "Flatten the file.")
        return root.items[0] if root.items else _Node("scalar", 1, plain=True)

    def _node(self, event: yaml.NodeEvent, line: int) -> _Node:
        if isinstance(event, yaml.AliasEvent):
            name = str(event.anchor)
            if name not in self.anchors:
                known = nearest(name, self.anchors) or f"Mark a value before it with &{name[:60]}."
                raise _refused(self.file, line, f"unknown alias {quoted('*' + name)}", known)
            return self.anchors[name]
        tag: str | None = getattr(event, "tag", None)
        if tag and tag != "!":
            tag = quoted(tag.replace("tag:yaml.org,2002:", "!!"))
            raise _refused(self.file, line, f"the tag {tag} is not allowed", "Write plain values, without it.")
        if isinstance(event, yaml.ScalarEvent):
            node = _Node("scalar", line, text=event.value, plain=bool(event.implicit[0]))
        else:
            node = _Node("list" if isinstance(event, yaml.SequenceStartEvent) else "map", line)
        if event.anchor:
            self.anchors[event.anchor] = node
        return node


class _Constructor:
    """Nodes to data; counts what aliases expand to, so that a YAML bomb is refused early."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self.count = 0
        self.open: set[int] = set()

    def construct(self, node: _Node, location: Location) -> Any:
        self.count += 1
        if self.count > MAX_VALUES:
            remedy = "Use fewer aliases."
            raise _refused(self.source.file, node.line, f"aliases expand to more than {MAX_VALUES} values", remedy)
        if id(node) in self.open:
            raise _refused(self.source.file, node.line, "an alias stands inside what it repeats", "Remove it.")
        if len(location) > MAX_DEPTH:
            raise _refused(self.source.file, node.line, f"nested deeper than {MAX_DEPTH} levels", "Flatten the file.")
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

    def _mapping(self, node: _Node, location: Location) -> dict[str, Any]:
        mapping: dict[str, Any] = {}
        merged: list[tuple[_Node, Any]] = []
        for key_node, value_node in zip(node.items[::2], node.items[1::2], strict=True):
            if key_node.kind != "scalar":
                remedy = "In [ ] and { } and at the start of a line, quote texts that hold ? or { or [."
                raise _refused(self.source.file, key_node.line, "a key must be a word", remedy)
            key = key_node.text
            if key == "<<" and key_node.plain:
                merged.append((value_node, self.construct(value_node, (*location, "<<"))))
                continue
            if key in mapping:
                first = self.source.lines[(*location, key)]
                self._complain(
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
                    self._complain((*location, "<<"), value_node.line, message, "Write <<: *name, with &name at one.")
                    continue
                for key, inherited in source.items():
                    if key not in mapping:
                        place = (*location, "<<", *([index] if several else []), key)
                        self.source.lines[(*location, key)] = self.source.lines[place]
                        mapping[key] = inherited
        return mapping

    def _complain(self, location: Location, line: int, message: str, remedy: str) -> None:
        problem = Problem(message, remedy, key=dotted(location), file=self.source.file, line=line)
        self.source.problems.append(problem)


def plain_scalar(text: str) -> Any:
    """What a text without quotes stands for: a number, a word of YAML's, or itself."""
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
