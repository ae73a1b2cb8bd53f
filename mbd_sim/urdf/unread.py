"""What is not read from an XML file: attributes and elements that a table of those that are read does not have."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mbd_sim.urdf.value_reader import Reading
from mbd_sim.urdf.xml_elements import Element


@dataclass(frozen=True)
class Read:
    """What is read of an element: `attributes`, `elements` of which each is read, and `single` ones, read once.

    Of one that is `checked`, other elements are listed by the function that reads it.
    """

    attributes: frozenset[str]
    single: frozenset[str]
    elements: frozenset[str]
    checked: bool


def read(attributes: str = "", single: str = "", elements: str = "", *, checked: bool = False) -> Read:
    """The record, from words."""
    return Read(frozenset(attributes.split()), frozenset(single.split()), frozenset(elements.split()), checked)


Table = Mapping[str, Read]  # by tag, or by parent/tag where that is not enough


def note_unread(reading: Reading, element: Element, key: str, table: Table) -> None:
    """List the attributes and elements in an element and all within it that are not read, with their lines.

    An element whose tag is not in the table is not looked into.

    :param key: how the element is named.
    """
    waiting = [(element, key, table.get(element.tag))]
    while waiting:
        one, own, known = waiting.pop()
        if known is None:
            continue
        for name in one.attributes:
            if name not in known.attributes and not name.startswith("xmlns"):
                reading.leave_out_at(f"{name} of <{one.tag}>", one, own)
        seen: set[str] = set()
        further = []
        for child in one.children:
            inner = f"{own}.{_named(child)}"
            if child.tag in known.elements or (child.tag in known.single and child.tag not in seen):
                further.append((child, inner, table.get(f"{one.tag}/{child.tag}", table.get(child.tag))))
            elif child.tag in known.single:
                reading.leave_out_at(f"<{child.tag}> that is not the first of <{one.tag}>", child, own)
            elif not known.checked:
                reading.leave_out_at(f"<{child.tag}> of <{one.tag}>", child, own)
            seen.add(child.tag)
        waiting += reversed(further)


def _named(element: Element) -> str:
    name = element.attributes.get("name", "")
    return f"{element.tag}[{name}]" if name.isprintable() and 0 < len(name) <= 60 else element.tag
