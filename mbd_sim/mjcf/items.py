"""Elements of an MJCF with the attributes that their default classes give them."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from mbd_sim.errors import nearest, quoted
from mbd_sim.urdf.value_reader import NUMBER, Reading
from mbd_sim.urdf.xml_elements import Element

MAIN = "main"  # the class of elements that name none
ACTUATORS = (
    "general", "motor", "position", "velocity", "intvelocity", "orientation", "pid", "damper", "cylinder", "muscle",
    "adhesion", "dcmotor", "plugin",
)  # fmt: skip
TENDONS = ("fixed", "spatial")


@dataclass(frozen=True, eq=False)
class Item:
    """An element with its attributes, and the element that gives each: itself, or one in a default class."""

    reading: Reading
    element: Element
    key: str
    places: Mapping[str, Element]

    def has(self, name: str) -> bool:
        """Whether it has an attribute."""
        return name in self.places

    def text(self, name: str, otherwise: str = "") -> str:
        """An attribute as written."""
        return self.places[name].attributes[name] if name in self.places else otherwise

    def report(self, name: str, message: str, remedy: str = "") -> None:
        """Note a problem of an attribute, or, if `name` is empty, of the element."""
        place = self.places.get(name, self.element)
        value = self.text(name) if self.has(name) else None
        self.reading.report(place, f"{self.key}.{name}" if name else self.key, message, remedy, value)

    def leave_out(self, kind: str) -> None:
        """Note that something of it is not imported."""
        self.reading.leave_out_at(kind, self.element, self.key)

    def numbers(self, name: str, least: int, most: int | None = None) -> list[float] | None:
        """The numbers of an attribute; None if it is missing, or, with a problem, if it is invalid.

        :param most: how many there may be; `least` by default.
        """
        if name not in self.places:
            return None
        words, most = self.text(name).split(), least if most is None else most
        if wrong := [word for word in words if not NUMBER.fullmatch(word)]:
            self.report(name, f"{quoted(wrong[0])} is not a finite number", "Write plain numbers.")
        elif not least <= len(words) <= most:
            wanted = f"{least}" if least == most else f"{least} to {most}"
            self.report(name, f"has {len(words)} numbers", f"Write {wanted}, separated by spaces.")
        else:
            return [float(word) + 0.0 for word in words]
        return None

    def number(self, name: str, otherwise: float = 0.0) -> float:
        """The number of an attribute."""
        found = self.numbers(name, 1)
        return found[0] if found else otherwise

    def number_from_zero(self, name: str, otherwise: float = 0.0) -> float:
        """The same, where negative numbers have no meaning.

        Of the coefficients of a polynomial, which newer files may give, the first; the others are noted.
        """
        found = self.numbers(name, 1, 3) or [otherwise]
        if any(found[1:]):
            self.leave_out(f"higher coefficients of {name}")
        if found[0] < 0.0:
            self.report(name, "must not be negative", "Write its size.")
            return otherwise
        return found[0]

    def choice(self, name: str, choices: Collection[str], otherwise: str) -> str:
        """The word of an attribute, which must be one of `choices`."""
        word = self.text(name, otherwise)
        if word not in choices:
            self.report(name, "unknown word", nearest(word, choices))
            return otherwise
        return word

    def limited(self, name: str, range_name: str, automatic: bool) -> bool:
        """Whether a range acts: `true`, `false`, or `auto`, which is whether there is one."""
        word = self.choice(name, ("true", "false", "auto"), "auto")
        return self.has(range_name) and automatic if word == "auto" else word == "true"


class Defaults:
    """The default classes of a model. A class inherits from the one around it, the outermost one is `main`."""

    def __init__(self, root: Element, reading: Reading) -> None:
        self._reading = reading
        self._classes: dict[str, dict[str, dict[str, Element]]] = {MAIN: {}}
        for default in root.all("default"):
            self._read(default, default.attributes.get("class", MAIN), MAIN)

    def item(self, element: Element, key: str, childclass: str = "", tag: str = "") -> Item:
        """An element with its attributes; its own class goes before `childclass`.

        :param tag: of the defaults, if it differs from that of the element.
        """
        named = element.attributes.get("class", "")
        if named and named not in self._classes:
            remedy = nearest(named, self._classes) or "Define it in <default>."
            self._reading.report(element, f"{key}.class", f"there is no default class {quoted(named)}", remedy)
        places = self._classes.get(named or childclass or MAIN, {}).get(_family(tag or element.tag), {})
        return Item(self._reading, element, key, {**places, **dict.fromkeys(element.attributes, element)})

    def exists(self, name: str) -> bool:
        """Whether there is a class of this name."""
        return name in self._classes

    def _read(self, default: Element, name: str, parent: str) -> None:
        classes = self._classes
        own = classes[name] if name in classes else {tag: dict(places) for tag, places in classes[parent].items()}
        classes[name] = own
        for element in default.children:
            if element.tag != "default":
                places = own.setdefault(_family(element.tag), {})
                places |= dict.fromkeys(element.attributes, element)
        for inner in default.all("default"):
            if not inner.attributes.get("class"):
                self._reading.report(inner, "default", "'class' is missing", "Name the class.")
            else:
                self._read(inner, inner.attributes["class"], name)


def _family(tag: str) -> str:
    """All actuators share their defaults, and so do tendons; a `freejoint` has none."""
    return "actuator" if tag in ACTUATORS else "tendon" if tag in TENDONS else tag
