"""Reads the values of SDF elements: texts, numbers and poses."""

from __future__ import annotations

import math

import numpy as np

from mbd_sim.base.errors import quoted
from mbd_sim.base.geometry.pose import Array, Pose, identity_pose
from mbd_sim.base.geometry.rotation import from_quaternion, from_rpy, unit
from mbd_sim.files.xml.elements import Element
from mbd_sim.files.xml.reading import NUMBER, Reading

UNLIMITED = 1e15  # limits from here on stand for none
INFINITE = {"inf": math.inf, "+inf": math.inf, "-inf": -math.inf, "infinity": math.inf, "-infinity": -math.inf}


class Values:
    """Values of elements inside others; what is wrong is reported."""

    def __init__(self, reading: Reading, version: str) -> None:
        """:param version: of the file, unless a model is included from another one."""
        self.reading, self.version = reading, version

    def text(self, element: Element, tag: str, otherwise: str = "") -> str:
        """The text of the first element with a tag."""
        found = element.first(tag)
        return otherwise if found is None else found.text.strip()

    def flag(self, element: Element, tag: str, key: str) -> bool:
        """Whether it is true; false if it is missing."""
        word = self.text(element, tag, "false")
        if word not in ("true", "false", "1", "0"):
            self.reading.report(
                element.first(tag) or element, f"{key}.{tag}", "unknown word", "Write true or false.", word
            )
        return word in ("true", "1")

    def numbers_in(self, element: Element, key: str, *counts: int) -> list[float] | None:
        """The numbers in the text of an element; None, with a problem, if they are not as many as one of `counts`."""
        words = element.text.split()
        if wrong := [word for word in words if not NUMBER.fullmatch(word) and word.lower() not in INFINITE]:
            self.reading.report(element, key, f"{quoted(wrong[0])} is not a number", "Write plain numbers.")
        elif len(words) not in counts:
            wanted = " or ".join(map(str, counts))
            self.reading.report(element, key, f"has {len(words)} numbers", f"Write {wanted}, separated by spaces.")
        else:
            return [INFINITE[word.lower()] if word.lower() in INFINITE else float(word) + 0.0 for word in words]
        return None

    def numbers(self, element: Element, tag: str, key: str, count: int) -> list[float] | None:
        """The finite numbers of the first element with a tag; None if it is missing or wrong."""
        found = element.first(tag)
        numbers = None if found is None else self.numbers_in(found, f"{key}.{tag}", count)
        if found is not None and numbers and not all(map(math.isfinite, numbers)):
            self.reading.report(found, f"{key}.{tag}", "must be finite", "Write a number.")
            return None
        return numbers

    def number(self, element: Element, tag: str, key: str, otherwise: float = 0.0) -> float:
        """The finite number of the first element with a tag; `otherwise` if it is missing or wrong."""
        numbers = self.numbers(element, tag, key, 1)
        return numbers[0] if numbers else otherwise

    def number_from_zero(self, element: Element, tag: str, key: str, otherwise: float = 0.0) -> float:
        """The number of the first element with a tag, where negative numbers have no meaning."""
        value = self.number(element, tag, key, otherwise)
        if value < 0.0:
            self.reading.report(
                element.first(tag) or element, f"{key}.{tag}", "must not be negative", "Write its size."
            )
            return otherwise
        return value

    def bound(self, element: Element, tag: str, key: str, otherwise: float) -> float:
        """A limit, infinite if it stands for none."""
        found = element.first(tag)
        numbers = None if found is None else self.numbers_in(found, f"{key}.{tag}", 1)
        value = numbers[0] if numbers else otherwise
        return math.copysign(math.inf, value) if abs(value) >= UNLIMITED else value

    def pose(self, element: Element, key: str) -> Pose:
        """The pose in the element's `<pose>`: position, and roll, pitch, yaw or a quaternion (x, y, z, w)."""
        found = element.first("pose")
        if found is None or not found.text.strip():
            return identity_pose()
        where = f"{key}.pose"
        if found.attributes.get("rotation_format", "euler_rpy") == "quat_xyzw":
            numbers = self.numbers_in(found, where, 7)
            if numbers is None or not any(numbers[3:]):
                if numbers:
                    self.reading.report(found, where, "has a quaternion of 0", "Write for example 0 0 0 1.")
                return identity_pose()
            x, y, z, w = numbers[3:]
            return Pose(np.array(numbers[:3]), from_quaternion(unit([w, x, y, z])))
        numbers = self.numbers_in(found, where, 6)
        if numbers is None:
            return identity_pose()
        scale = math.pi / 180.0 if found.attributes.get("degrees") in ("true", "1") else 1.0
        return Pose(np.array(numbers[:3]), from_rpy(*(scale * angle for angle in numbers[3:])))


def direction(numbers: list[float] | None) -> Array:
    """A unit vector (3,); z if there is none."""
    return np.array([0.0, 0.0, 1.0]) if numbers is None else unit(numbers)
