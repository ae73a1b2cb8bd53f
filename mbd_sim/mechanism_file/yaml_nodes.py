"""YAML text as a tree of nodes, each with its line."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import yaml

from mbd_sim.errors import nearest, quoted
from mbd_sim.mechanism_file.file_limits import MAX_DEPTH, MAX_VALUES, file_error, too_deep

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
