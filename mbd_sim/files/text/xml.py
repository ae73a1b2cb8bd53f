"""XML text as elements with their lines, the numbers, poses and names in them, and what becomes of their shapes.

Document type declarations are refused, so that only XML's five predefined entities exist. Size, depth and the number of
elements are bounded, so that no file can exhaust the machine.

TinyXML-2, with which Gazebo, urdfdom and MuJoCo read, accepts some XML that is not well-formed. Such slips are mended
in the text, without moving any line: `--` in a comment, a blank before `<?xml`, a bare `&`, and no blank between two
attributes.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeVar
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np

from mbd_sim.base.errors import InputError, MechanismError, Problem, listed, quoted
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.geometry.rotation import from_rpy
from mbd_sim.base.linear_algebra import product
from mbd_sim.files.text.library import MAX_BYTES, MAX_VALUES, file_error
from mbd_sim.mechanism.values.source import Origin

_TOKENS = re.compile(
    r"(?P<comment><!--.*?-->)"
    r"|(?P<verbatim><!\[CDATA\[.*?\]\]>|<\?.*?\?>)"
    r"|(?P<tag><[A-Za-z_](?:[^<>\"']|\"[^\"]*\"|'[^']*')*>)"
    r"|(?P<entity>&)",
    re.DOTALL,
)
_DECLARATION = re.compile(r"\s+<\?xml\b.*?\?>", re.DOTALL)
_BARE = re.compile(r"&(?!(?:amp|lt|gt|quot|apos|#[0-9]+|#x[0-9A-Fa-f]+);)")
_QUOTED = re.compile(r"(=\s*(?:\"[^\"]*\"|'[^']*'))(?=[A-Za-z_])")
_NO_NEWLINE = re.compile(r"[^\n]")


def mended(text: str) -> tuple[str, tuple[str, ...]]:
    """The text as well-formed XML, as far as these slips go, and each of them with its line."""
    found: list[tuple[int, str]] = []
    if declaration := _DECLARATION.match(text):
        found.append((declaration.end(), "a blank before <?xml"))
        text = _NO_NEWLINE.sub(" ", declaration[0]) + text[declaration.end() :]

    def mend(token: re.Match[str]) -> str:
        whole, start = token[0], token.start()
        if token["comment"]:
            inner = whole[4:-3]
            if "--" not in inner and not inner.endswith("-"):
                return whole
            found.append((start, "'--' in a comment"))
            return f"<!--{_NO_NEWLINE.sub(' ', inner)}-->"
        if token["verbatim"]:
            return whole
        if token["entity"]:
            bare = _BARE.match(text, start)
            if bare:
                found.append((start, "a bare '&'"))
            return "&amp;" if bare else whole
        spaced = _QUOTED.sub(r"\1 ", whole)
        if spaced != whole:
            found.append((start, "no blank between attributes"))
        if _BARE.search(spaced):
            found.append((start, "a bare '&'"))
        return _BARE.sub("&amp;", spaced)

    result = _TOKENS.sub(mend, text.rstrip("\0"))
    if text.endswith("\0"):
        found.append((len(text), "a NUL character at the end"))
    return result, tuple(f"{slip} (line {text.count(chr(10), 0, place) + 1})" for place, slip in found)


def slips_of(text: str) -> tuple[str, ...]:
    """The slips in a text, if it is not well-formed because of them."""
    try:
        expat.ParserCreate().Parse(text.removeprefix("\ufeff"), True)
    except (expat.ExpatError, UnicodeError):
        return mended(text)[1]
    return ()


FILES, PLACE = "mbd_sim-files", "mbd_sim-place"  # processing instructions that say where elements come from
MAX_NESTING = 200  # levels; a chain of bodies in an MJCF has as many as it has bodies
_BEGINS_AS_XML = re.compile(r"\ufeff?\s*<(?!<)")
_SURROGATE = re.compile("[\ud800-\udfff]")


@dataclass(eq=False)
class Element:
    """An element: its tag, attributes, line, the elements in it, its text, and the file where it stands.

    `slips` of a root element are those that were mended in the file, see `mended`, and `warnings` those of the program
    that wrote the text, see `xacro_files`.
    """

    tag: str
    attributes: dict[str, str]
    line: int
    children: list[Element] = field(default_factory=list)
    text: str = ""
    file: str = ""
    slips: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

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


def parse_elements(text: str, tag: str) -> list[Element]:
    """The elements in a text, all of which have this tag.

    :raises InputError: it is not XML, or has something else.
    """
    try:
        root = parse_xml(f"<all>{text}</all>", "")
    except MechanismError as error:
        raise InputError(error.problems[0].message, error.problems[0].remedy) from error
    if root.text or len(root.all(tag)) < len(root.children) or not root.children:
        raise InputError(f"must consist of <{tag}> elements", f"Write '<{tag} …>…</{tag}>'.")
    return root.children


def as_tree(element: Element) -> ElementTree.Element:
    """An element that was read, to be written again."""
    tree = ElementTree.Element(element.tag, element.attributes)
    tree.text = element.text or None
    tree.extend(map(as_tree, element.children))
    return tree


def text_of(elements: Iterable[Element]) -> str:
    """The text of elements that were read, without comments."""
    trees = list(map(as_tree, elements))
    for tree in trees:
        ElementTree.indent(tree)
    return "".join(ElementTree.tostring(tree, encoding="unicode") + "\n" for tree in trees)


def _parsed(text: str, file: str) -> Element:
    reader = _ElementReader(file)
    reader.parser.Parse(text, True)
    return reader.root.children[0]


class _ElementReader:
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
        self.parser.ProcessingInstructionHandler = self._instruction
        self.files: list[str] = []
        self.warnings: tuple[str, ...] = ()
        self.place: tuple[str, int] | None = None  # of the next element, where it comes from another text

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        line = self.parser.CurrentLineNumber
        self.count += 1 + len(attributes)
        if self.count > MAX_VALUES:
            raise file_error(
                self.file, line, f"more than {MAX_VALUES} values", "Remove everything that does not describe the robot."
            )
        if len(self.open) > MAX_NESTING:
            raise file_error(self.file, line, f"nested deeper than {MAX_NESTING} levels", "Flatten the file.")
        file, line = self.place or (self.file, line)
        element = Element(tag, attributes, line, file=file, warnings=() if self.root.children else self.warnings)
        self.open[-1].children.append(element)
        self.open.append(element)

    def _characters(self, text: str) -> None:
        if not text.isspace():
            self.open[-1].text += text

    def _end(self, tag: str) -> None:
        self.open.pop()

    def _instruction(self, target: str, data: str) -> None:
        with suppress(ValueError, TypeError, LookupError):  # one that somebody else wrote
            if target == FILES:
                head = json.loads(data)
                self.files, self.warnings = list(map(str, head["files"])), tuple(map(str, head["warnings"]))
            elif target == PLACE:
                number, line = map(int, data.split())
                self.place = self.files[number], line

    def _doctype(self, name: str, *_: object) -> None:
        message, remedy = "a document type declaration is not allowed", "Remove it, and the entities that it declares."
        line = self.parser.CurrentLineNumber
        raise file_error(self.file, line, message, remedy, key="DOCTYPE", value=quoted(name))


Base = Literal["fixed", "free"]  # how the root of a file is attached to ground
NUMBER = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?", re.ASCII)


class Reading:
    """The state of reading a file: the `problems` found so far, and notes on elements that are not imported."""

    def __init__(self, file: str, most: int = 12) -> None:
        """:param most: how many elements of a kind the notes name; beyond it they give their number."""
        self.file, self.most = file, most
        self.problems: list[Problem] = []
        self._left_out: dict[str, list[str]] = {}

    def origin(self, element: Element, key: str) -> Origin:
        """The origin of a value: the file and the line of an element."""
        return Origin(element.file or self.file, element.line, key)

    def report(self, element: Element, key: str, message: str, remedy: str = "", value: str | None = None) -> None:
        """Note a problem of an element, named by `key`."""
        shown = "" if value is None else quoted(value)
        file = element.file or self.file
        self.problems.append(Problem(message, remedy, key=key, value=shown, file=file, line=element.line))

    def leave_out(self, kind: str, element: str) -> None:
        """Note that something in an element is not imported."""
        self._left_out.setdefault(kind, []).append(element)

    def leave_out_at(self, kind: str, element: Element, key: str) -> None:
        """Note that something in an element is not imported, with the line of the element, and the name of its file."""
        other = "" if element.file in ("", self.file) else f"{Path(element.file).name}, "
        self.leave_out(kind, f"{key} ({other}line {element.line})")

    def note_slips(self, root: Element) -> None:
        """Note the slips of a file that were mended."""
        other = "" if root.file in ("", self.file) else f" of {root.file}"
        for slip in root.slips:
            self.leave_out(f"XML{other} that is not well-formed, read as it is meant", slip)
        for warning in root.warnings:
            self.leave_out("xacro warns", warning)

    @property
    def notes(self) -> tuple[str, ...]:
        """The elements that were not imported, a sentence for each kind."""
        return tuple(
            f"{kind}: {listed(list(dict.fromkeys(elements)), self.most)}" for kind, elements in self._left_out.items()
        )

    def numbers(self, element: Element, attribute: str, key: str, count: int) -> list[float] | None:
        """The numbers of an attribute; None if it is missing, or, with a problem, if it is invalid."""
        text = element.attributes.get(attribute)
        if text is None:
            return None
        words, where = text.split(), f"{key}.{attribute}"
        if wrong := [word for word in words if not NUMBER.fullmatch(word)]:
            remedy = "Write plain numbers."
            if "$" in text:
                remedy = "This is a xacro expression: name the file .urdf.xacro, so that it is expanded."
            self.report(element, where, f"{quoted(wrong[0])} is not a number", remedy, text)
        elif len(words) != count:
            form = "one number" if count == 1 else f"{count} numbers separated by spaces"
            found = "one number" if len(words) == 1 else f"{len(words)} numbers"
            self.report(element, where, f"has {found}", f"Write {form}.", text)
        else:
            return [float(word) + 0.0 for word in words]
        return None

    def number(self, element: Element, attribute: str, key: str) -> float | None:
        """The number of an attribute; None as in `numbers`."""
        found = self.numbers(element, attribute, key, 1)
        return found[0] if found else None

    def required(self, element: Element, attribute: str, key: str) -> float | None:
        """The number of an attribute that must be there."""
        if attribute not in element.attributes:
            self.report(element, key, f"'{attribute}' is missing", "Add it.")
        return self.number(element, attribute, key)

    def pose(self, element: Element, key: str) -> tuple[list[float], list[float]]:
        """xyz in m and rpy in rad of the element's `<origin>`, zero by default."""
        origin = element.first("origin")
        zero = [0.0, 0.0, 0.0]
        if origin is None:
            return zero, zero
        xyz, rpy = (self.numbers(origin, attribute, f"{key}.origin", 3) for attribute in ("xyz", "rpy"))
        return xyz or zero, rpy or zero


def pose_of(xyz: list[float], rpy: list[float]) -> Pose:
    """The pose of an `<origin>`."""
    return Pose(np.array(xyz), from_rpy(*rpy))


def placed(xyz: list[float], rpy: list[float]) -> dict[str, Any]:
    """The keys of a mechanism file for a pose."""
    return ({"at": xyz} if any(xyz) else {}) | ({"rotate": {"rpy": rpy}} if any(rpy) else {})


def rows(array: Array) -> list[float]:
    """An array as plain numbers, without negative zeros."""
    return [float(value) + 0.0 for value in array]


Entry = TypeVar("Entry")


def capsule(pose: Pose, radius: float, length: float) -> dict[str, Any]:
    """A cylinder of a `length` in m along z with half a ball at each end: a rod with round ends."""
    arm = product(pose.rotation, np.array([0.0, 0.0, 0.5 * length]))
    return {"type": "rod", "from": rows(pose.position - arm), "to": rows(pose.position + arm), "radius": radius}


def hull(mesh: dict[str, Any]) -> dict[str, Any]:
    """What touches of a mesh: the convex hull of its file."""
    return {"type": "hull", **{key: value for key, value in mesh.items() if key != "color"}}


def with_collisions(found: dict[str, list[Entry]], kind_of: Callable[[Entry], str]) -> dict[str, list[Entry]]:
    """The keys of a part for its `meshes`, its `shapes` and what touches, its `collisions`.

    A part without shapes to draw is drawn as what touches, but for hulls. Only shapes that are drawn and touch nothing
    need an empty list of collisions.

    :param kind_of: the type of a shape.
    """
    plain = [entry for entry in found["collisions"] if kind_of(entry) != "hull"]
    if not found["shapes"]:
        same = len(plain) == len(found["collisions"])
        found = {**found, "shapes": plain, "collisions": [] if same else found["collisions"]}
        return {kind: entries for kind, entries in found.items() if entries}
    return {kind: entries for kind, entries in found.items() if entries or kind == "collisions"}
