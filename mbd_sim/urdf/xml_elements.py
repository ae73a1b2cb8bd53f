"""Parses XML text to elements with their lines.

Document type declarations are refused, so that only XML's five predefined entities exist. Size, depth and the number of
elements are bounded, so that no file can exhaust the machine.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from xml.parsers import expat

from mbd_sim.errors import quoted
from mbd_sim.mechanism_file.file_limits import MAX_BYTES, MAX_VALUES, file_error
from mbd_sim.urdf.xml_slips import mended

MAX_NESTING = 200  # levels; a chain of bodies in an MJCF has as many as it has bodies
_BEGINS_AS_XML = re.compile(r"\ufeff?\s*<(?!<)")
_SURROGATE = re.compile("[\ud800-\udfff]")


@dataclass(eq=False)
class Element:
    """An element: its tag, attributes, line, the elements in it, its text, and the file where it stands.

    `slips` of a root element are those that were mended in the file, see `xml_slips`.
    """

    tag: str
    attributes: dict[str, str]
    line: int
    children: list[Element] = field(default_factory=list)
    text: str = ""
    file: str = ""
    slips: tuple[str, ...] = ()

    def all(self, tag: str) -> list[Element]:
        """The elements right inside with this tag."""
        return [child for child in self.children if child.tag == tag]

    def first(self, tag: str) -> Element | None:
        """The first of them, if there is one."""
        return next(iter(self.all(tag)), None)

    def walk(self) -> Iterator[Element]:
        """This element and all within it, in the order of the file."""
        waiting = [self]
        while waiting:
            element = waiting.pop()
            yield element
            waiting += reversed(element.children)


def is_xml(text: str) -> bool:
    """Whether a text is XML rather than YAML."""
    return _BEGINS_AS_XML.match(text) is not None


def root_tag(text: str) -> str:
    """The tag of the root element, without reading what is in it; empty if there is none, or it is not XML."""

    def stop(tag: str, attributes: object) -> None:
        raise _RootError(tag)

    text = text.removeprefix("\ufeff")
    for read in (str, _mended):
        parser = expat.ParserCreate()
        parser.StartElementHandler = stop
        try:
            parser.Parse(read(text), True)
        except _RootError as root:
            return root.tag
        except (expat.ExpatError, UnicodeError):
            pass
    return ""


def _mended(text: str) -> str:
    return mended(text)[0]


class _RootError(Exception):
    """Stops a parser at the root element."""

    def __init__(self, tag: str) -> None:
        super().__init__(tag)
        self.tag = tag


def parse_xml(text: str, file: str) -> Element:
    """The root element.

    :raises MechanismError: it is not XML, has a document type declaration, or is too large.
    """
    if len(text) > MAX_BYTES:
        raise file_error(
            file,
            1,
            f"the text is longer than {MAX_BYTES} characters",
            "Remove everything that does not describe the robot.",
        )
    if found := _SURROGATE.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise file_error(file, line, f"the character U+{ord(found[0]):04X} is not allowed", "Remove it.")
    text = text.removeprefix("\ufeff")
    try:
        return _parsed(text, file)
    except expat.ExpatError as error:
        with suppress(expat.ExpatError):
            plain, slips = mended(text)
            root = _parsed(plain, file)
            root.slips = slips
            return root
        message = f"not valid XML: {expat.ErrorString(error.code)}"
        raise file_error(file, error.lineno, message, "Check the tags and quotes near this line.") from error


def _parsed(text: str, file: str) -> Element:
    reader = _Reader(file)
    reader.parser.Parse(text, True)
    return reader.root.children[0]


class _Reader:
    """Builds elements from expat's events, within the limits on size and depth."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.root = Element("", {}, 1)
        self.open = [self.root]
        self.count = 0
        self.parser = expat.ParserCreate()
        self.parser.buffer_text = True
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._characters
        self.parser.StartDoctypeDeclHandler = self._doctype

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        line = self.parser.CurrentLineNumber
        self.count += 1 + len(attributes)
        if self.count > MAX_VALUES:
            raise file_error(
                self.file, line, f"more than {MAX_VALUES} values", "Remove everything that does not describe the robot."
            )
        if len(self.open) > MAX_NESTING:
            raise file_error(self.file, line, f"nested deeper than {MAX_NESTING} levels", "Flatten the file.")
        element = Element(tag, attributes, line, file=self.file)
        self.open[-1].children.append(element)
        self.open.append(element)

    def _characters(self, text: str) -> None:
        if not text.isspace():
            self.open[-1].text += text

    def _end(self, tag: str) -> None:
        self.open.pop()

    def _doctype(self, name: str, *_: object) -> None:
        message, remedy = "a document type declaration is not allowed", "Remove it, and the entities that it declares."
        line = self.parser.CurrentLineNumber
        raise file_error(self.file, line, message, remedy, key="DOCTYPE", value=quoted(name))
