"""An MJCF as MuJoCo's own compiler resolves it: defaults, classes, frames, orientations, masses, and its errors.

Its polynomials and weighted sums of coordinates are written as the texts of expressions of a mechanism file.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

from mbd_sim.base.errors import MechanismError, quoted
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.geometry.rotation import from_quaternion
from mbd_sim.base.packages import require_packages
from mbd_sim.files.text.library import digest_of_file, file_error
from mbd_sim.files.text.xml import Reading, slips_of
from mbd_sim.mechanism.values.names import LONGEST_NAME, in_expression
from mbd_sim.mechanism.values.source import Origin

MOST = 1000  # elements of a kind in the list of what was left out
LINE = re.compile(r"line (\d+)|Line number=(\d+)")
KINDS = {  # of elements that have a number in the compiled model, by their lists in the specification
    "body": "bodies",
    "joint": "joints",
    "geom": "geoms",
    "site": "sites",
    "tendon": "tendons",
    "equality": "equalities",
    "actuator": "actuators",
    "sensor": "sensors",
    "key": "keys",
    "flex": "flexes",
    "skin": "skins",
    "pair": "pairs",
    "camera": "cameras",
    "light": "lights",
}


class CompiledModel:
    """A compiled model `m`, with the names and lines of its elements, and the notes on what is left out."""

    def __init__(self, text: str, file: str) -> None:
        """:raises MechanismError: MuJoCo is not installed, or refuses the model; with the line that it names."""
        otherwise = "or convert the file where it is installed: mbd_sim convert FILE > FILE.yaml"
        require_packages("mujoco", purpose="Reading an MJCF", otherwise=otherwise)
        import mujoco

        self.mujoco: ModuleType = mujoco
        self.file, self.reading = file, Reading(file, MOST)
        path = Path(file)
        self.on_disk = path.is_file() and path.read_bytes() == text.encode("utf-8", "surrogatepass")
        for slip in slips_of(text):
            self.reading.leave_out("XML that is not well-formed, read as it is meant", slip)
        with _collected_warnings(mujoco) as warned:
            try:
                self.spec = mujoco.MjSpec.from_file(file) if self.on_disk else mujoco.MjSpec.from_string(text)
                _without_needless(self.spec)
                self.m = self.spec.compile()
            except ValueError as error:
                raise _problem(file, str(error)) from error
        for warning in warned:
            self.reading.leave_out("MuJoCo warns", warning)
        self._elements = {
            kind: {element.id: element for element in getattr(self.spec, name)} for kind, name in KINDS.items()
        }

    @property
    def other_files(self) -> dict[str, str]:
        """The digests of the included files and of the meshes, by their paths."""
        found = self.mujoco.mju_getXMLDependencies(self.file) if self.on_disk else []
        own = Path(self.file).resolve()
        return {path: digest_of_file(Path(path)) for path in sorted(found) if Path(path).resolve() != own}

    def count(self, kind: str) -> int:
        """The number of elements of a kind."""
        return len(self._elements[kind])

    def name(self, kind: str, index: int) -> str:
        """The name of an element, empty if it has none."""
        return str(self._elements[kind][index].name)

    def line(self, kind: str, index: int) -> int:
        """The line of an element; 0 if it is in an included file, or MuJoCo does not know it."""
        found = LINE.search(self._elements[kind][index].info)
        return int(found[1]) if found else 0

    def key(self, kind: str, index: int) -> str:
        """How an element is named in errors and in the list of what was left out."""
        name = self.name(kind, index)
        if not name:
            return kind
        return f"{kind}[{name if name.isprintable() and len(name) <= LONGEST_NAME else quoted(name)}]"

    def origin(self, kind: str, index: int) -> Origin:
        """Where an element stands in the file."""
        return Origin(self.file, self.line(kind, index), self.key(kind, index))

    def leave_out(self, sentence: str, kind: str, index: int, detail: str = "") -> None:
        """Note that something of an element is not simulated, or is otherwise."""
        known, line = self._elements[kind][index].info, self.line(kind, index)
        where = f" (line {line})" if line else " (in an included file)" if known else ""
        self.reading.leave_out(sentence, f"{self.key(kind, index)}{where}{detail}")

    def disabled(self, flag: str) -> bool:
        """Whether a `<flag>` turns something off."""
        return bool(self.m.opt.disableflags & getattr(self.mujoco.mjtDisableBit, f"mjDSBL_{flag}"))


def pose(position: Array, quaternion: Array) -> Pose:
    """A pose of the compiled model."""
    return Pose(position.copy(), from_quaternion(quaternion))


def _without_needless(spec: Any) -> None:
    """Leave out what is only seen and read from files that may be missing, and the lengths that only muscles need."""
    spec.compiler.LRopt.mode = 0
    for light in spec.lights:
        light.texture = ""
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    for texture in list(spec.textures):
        spec.delete(texture)


@contextmanager
def _collected_warnings(mujoco: ModuleType) -> Iterator[list[str]]:
    """Collects what MuJoCo would print and write to a log file, or warn of."""
    found: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(found.append)
    try:
        with warnings.catch_warnings(record=True) as raised:
            warnings.simplefilter("always")
            yield found
    finally:
        mujoco.set_mju_user_warning(before)
    found += [text for text in (str(warning.message) for warning in raised) if text not in found]


def _problem(file: str, text: str) -> MechanismError:
    """The error of MuJoCo's compiler, with the line and the element that it names."""
    lines = [line for line in text.strip().splitlines() if line]
    message = re.sub(r"^(XML )?(Error: )*", "", lines[0])
    found, element = LINE.search(text), re.search(r"Element (?:name )?'([^']+)'", text)
    if text.startswith("XML parse error") and len(lines) > 1:
        wrong = re.search(r"Error=XML_(?:ERROR_)?(\w+)", lines[1])
        message = f"not valid XML: {wrong[1].lower().replace('_', ' ')}" if wrong else lines[1]
    line = int(found[1] or found[2]) if found else 0
    remedy = "" if line else "It stands in an included file, or MuJoCo names no line for it."
    return file_error(file, line, f"MuJoCo refuses it: {message}", remedy, key=element[1] if element else "")


def signed(value: float) -> str:
    """A number that may stand after an operator."""
    return f"({value!r})" if value < 0.0 else f"{value!r}"


def polynomial(coefficients: Sequence[float], x: str) -> str:
    """The sum c₀ + c₁ x + c₂ x² and so on."""
    powers = ("", f"*{x}", *(f"*{x}**{power}" for power in range(2, len(coefficients))))
    return " + ".join(signed(c) + power for c, power in zip(coefficients, powers, strict=False) if c) or "0"


def odd_polynomial(coefficients: Sequence[float], v: str) -> str:
    """c₁ v + c₂ v |v| + c₃ v³."""
    powers = (v, f"{v}*abs({v})", f"{v}**3")
    return " + ".join(f"{signed(c)}*{power}" for c, power in zip(coefficients, powers, strict=False) if c) or "0"


def weighted_sum(terms: Mapping[str, float], quantity: str) -> str:
    """Σ c q or Σ c q' of coordinates by name."""
    return " + ".join(f"{signed(factor)}*{in_expression(name)}.{quantity}" for name, factor in terms.items())
