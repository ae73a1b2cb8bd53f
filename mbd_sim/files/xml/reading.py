"""Reads numbers, poses and names of XML elements, and collects problems with their lines."""

from __future__ import annotations

import re
from typing import Any, Literal

import numpy as np

from mbd_sim.base.errors import Problem, listed, quoted
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.geometry.rotation import from_rpy
from mbd_sim.files.xml.elements import Element
from mbd_sim.mechanism.values.source import Origin

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
        """Note that something in an element is not imported, with the line of the element."""
        other = "" if element.file in ("", self.file) else f"{element.file}, "
        self.leave_out(kind, f"{key} ({other}line {element.line})")

    def note_slips(self, root: Element) -> None:
        """Note the slips of a file that were mended."""
        other = "" if root.file in ("", self.file) else f" of {root.file}"
        for slip in root.slips:
            self.leave_out(f"XML{other} that is not well-formed, read as it is meant", slip)

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
                remedy = "This is a xacro expression: expand the file with xacro first."
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
