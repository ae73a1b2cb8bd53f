"""Random mechanisms with joints and constraints that change nothing, beside the same mechanisms without them.

Shafts in up to five bearings, doors on a hinge and a ball joint, telescopes, carriages on rails, parts that are welded
twice, rods, planes and couplings within rigid groups; alone, and as the crank of a four-bar or of a spatial linkage.
All of them on random axes, in random orders of the lists, and in random units.
"""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np

from mbd_sim.base.geometry import rotation as rot

KINDS = ("shaft", "door", "telescope", "carriage", "welds", "strut", "plane", "coupling", "four_bar", "spatial")


@dataclass(frozen=True)
class Pair:
    """The texts of a mechanism `with_extra` joints or constraints, and of one `without` them; and its freedoms.

    `length` is the unit of length in m in which the numbers of order one were written.
    """

    with_extra: str
    without: str
    freedoms: int
    length: float


class _Writer:
    def __init__(self, rng: np.random.Generator, length: float, mass: float) -> None:
        self.rng, self.length, self.mass = rng, length, mass
        self.turn = rot.from_quaternion(_unit(rng, 4))
        self.parts: dict[str, dict[str, object]] = {}
        self.ground: dict[str, object] = {}
        self.joints: dict[str, dict[str, object]] = {}
        self.constraints: dict[str, dict[str, object]] = {}
        self.extra: set[str] = set()
        self.count = 0

    def vector(self, *components: float) -> list[float]:
        """A vector in a world that is turned."""
        return [float(x) for x in self.turn @ np.array(components)]

    def at(self, *components: float) -> list[float]:
        """The same for a point in units of length."""
        return [self.length * x for x in self.vector(*components)]

    def part(self, name: str) -> str:
        """A part of random inertia, whose frame is that of ground at the start."""
        center = self.rng.uniform(-0.5, 0.5, 3)
        moments = np.diag(self.rng.uniform(1.0, 1.5, 3))
        axes = rot.from_quaternion(_unit(self.rng, 4))
        inertia = self.mass * self.length**2 * (axes @ moments @ axes.T)
        entries = ("xx", 0, 0), ("yy", 1, 1), ("zz", 2, 2), ("xy", 0, 1), ("xz", 0, 2), ("yz", 1, 2)
        self.parts[name] = {
            "mass": self.mass * self.rng.uniform(1.0, 3.0),
            "center": self.at(*center),
            "inertia": {key: float(inertia[i, j]) for key, i, j in entries},
            "points": {},
        }
        return name

    def point(self, part: str, at: list[float]) -> str:
        """A point of a part or of ground, at a place at the start."""
        self.count += 1
        points = self.ground if part == "ground" else self.parts[part]["points"]
        assert isinstance(points, dict)
        points[f"p{self.count}"] = at
        return f"{part}.p{self.count}"

    def joint(self, name: str, kind: str, one: str, other: str, at: list[float], **keys: object) -> None:
        """A joint between two parts at a place at the start."""
        self.joints[name] = {"type": kind, "between": [self.point(one, at), self.point(other, at)], **keys}

    def extra_joint(self, kind: str, one: str, other: str, at: list[float], **keys: object) -> None:
        """A joint that changes nothing."""
        name = f"extra{len(self.extra)}"
        self.joint(name, kind, one, other, at, **keys)
        self.extra.add(name)

    def extra_constraint(self, record: dict[str, object]) -> None:
        """A constraint that changes nothing."""
        name = f"extra{len(self.extra)}"
        self.constraints[name] = record
        self.extra.add(name)

    def text(self, with_extra: bool) -> str:
        """The mechanism; its lists are in another order with extra elements."""
        joints, constraints = (
            {name: record for name, record in records.items() if with_extra or name not in self.extra}
            for records in (self.joints, self.constraints)
        )
        gravity = [self.length * x for x in (1.3, -4.0, -8.0)]
        found: dict[str, object] = {"mechanism": "redundant", "gravity": gravity, "ground": {"points": self.ground}}
        found["parts"] = self._shuffled(self.parts) if with_extra else self.parts
        found["joints"] = self._shuffled(joints) if with_extra else joints
        if constraints:
            found["constraints"] = self._shuffled(constraints) if with_extra else constraints
        return json.dumps(found)

    def _shuffled(self, records: dict[str, dict[str, object]]) -> dict[str, dict[str, object]]:
        names = list(records)
        return {names[index]: records[names[index]] for index in self.rng.permutation(len(names))}


def _unit(rng: np.random.Generator, size: int) -> np.ndarray:
    vector = rng.normal(size=size)
    return vector / np.linalg.norm(vector)


def redundant_pair(rng: np.random.Generator, kind: str, length: float = 1.0, mass: float = 1.0) -> Pair:
    """A random mechanism of a kind, with numbers of the order of the given units in m and kg."""
    writer = _Writer(rng, length, mass)
    return Pair(*_TEXTS[kind](writer), length=length)


def _finished(writer: _Writer, freedoms: int) -> tuple[str, str, int]:
    return writer.text(True), writer.text(False), freedoms


def _bearings(writer: _Writer, one: str, other: str, count: int) -> None:
    """Extra bearings on the axis z through the origin; one of them may hold along the axis."""
    for _ in range(count):
        kind = str(writer.rng.choice(["revolute", "cylindrical", "spherical"]))
        keys = {} if kind == "spherical" else {"axis": writer.vector(0.0, 0.0, 1.0)}
        writer.extra_joint(kind, one, other, writer.at(0.0, 0.0, writer.rng.uniform(-2.0, 2.0)), **keys)


def _shaft(writer: _Writer) -> tuple[str, str, int]:
    writer.part("a")
    axis = writer.vector(0.0, 0.0, 1.0)
    writer.joint("main", "revolute", "ground", "a", writer.at(0.0, 0.0, 0.0), axis=axis, velocity=2.0)
    _bearings(writer, "ground", "a", int(writer.rng.integers(1, 5)))
    return _finished(writer, 1)


def _door(writer: _Writer) -> tuple[str, str, int]:
    writer.part("a")
    axis = writer.vector(0.0, 0.0, 1.0)
    writer.joint("main", "revolute", "ground", "a", writer.at(0.0, 0.0, 0.0), axis=axis, velocity=2.0)
    writer.extra_joint("spherical", "ground", "a", writer.at(0.0, 0.0, writer.rng.uniform(0.5, 2.0)))
    return _finished(writer, 1)


def _telescope(writer: _Writer) -> tuple[str, str, int]:
    for name in "ab":
        writer.part(name)
    axis = writer.vector(0.0, 0.0, 1.0)
    speed = writer.length
    writer.joint("main", "prismatic", "ground", "a", writer.at(0.1, 0.2, 0.3), axis=axis, velocity=speed)
    writer.joint("inner", "prismatic", "a", "b", writer.at(0.4, 0.1, 0.9), axis=axis, velocity=-0.5 * speed)
    writer.extra_joint("prismatic", "ground", "b", writer.at(*writer.rng.uniform(-1.0, 1.0, 3)), axis=axis)
    if writer.rng.random() < 0.5:
        writer.extra_joint("cylindrical", "a", "b", writer.at(*writer.rng.uniform(-1.0, 1.0, 3)), axis=axis)
    return _finished(writer, 2)


def _carriage(writer: _Writer) -> tuple[str, str, int]:
    writer.part("a")
    axis = writer.vector(0.0, 0.0, 1.0)
    writer.joint("main", "prismatic", "ground", "a", writer.at(0.0, 0.0, 0.0), axis=axis, velocity=writer.length)
    for _ in range(int(writer.rng.integers(1, 3))):
        kind = str(writer.rng.choice(["prismatic", "cylindrical"]))
        writer.extra_joint(kind, "ground", "a", writer.at(*writer.rng.uniform(-1.0, 1.0, 3)), axis=axis)
    return _finished(writer, 1)


def _rigid_group(writer: _Writer) -> None:
    """Two parts that are welded together and hang from ground by a universal joint."""
    for name in "ab":
        writer.part(name)
    axes = [writer.vector(1.0, 0.0, 0.0), writer.vector(0.0, 1.0, 0.2)]
    writer.joint("main", "universal", "ground", "a", writer.at(0.1, 0.0, 0.2), axes=axes, velocity=[1.0, 2.0])
    writer.joint("weld", "fixed", "a", "b", writer.at(0.5, 0.2, 0.1))


def _welds(writer: _Writer) -> tuple[str, str, int]:
    _rigid_group(writer)
    writer.extra_joint("fixed", "a", "b", writer.at(*writer.rng.uniform(-1.0, 1.0, 3)))
    kind = str(writer.rng.choice(["revolute", "spherical", "prismatic", "fixed"]))
    keys = {"axis": writer.vector(*_unit(writer.rng, 3))} if kind in ("revolute", "prismatic") else {}
    writer.extra_joint(kind, "b", "a", writer.at(*writer.rng.uniform(-1.0, 1.0, 3)), **keys)
    return _finished(writer, 2)


def _strut(writer: _Writer) -> tuple[str, str, int]:
    _rigid_group(writer)
    for _ in range(int(writer.rng.integers(1, 4))):
        ends = [np.array(writer.at(*writer.rng.uniform(-1.0, 1.0, 3))) for _ in range(2)]
        between = [writer.point(part, end.tolist()) for part, end in zip("ab", ends, strict=True)]
        length = float(np.linalg.norm(ends[1] - ends[0]))
        writer.extra_constraint({"type": "distance", "between": between, "length": length})
    return _finished(writer, 2)


def _plane(writer: _Writer) -> tuple[str, str, int]:
    _rigid_group(writer)
    normal = _unit(writer.rng, 3)
    first = writer.rng.uniform(-1.0, 1.0, 3)
    second = first + np.cross(normal, writer.rng.uniform(-1.0, 1.0, 3))
    points = [writer.point(part, writer.at(*place)) for part, place in (("a", first), ("b", second))]
    writer.extra_constraint(
        {"type": "on_plane", "point": points[0], "plane": points[1], "normal": writer.vector(*normal)}
    )
    return _finished(writer, 2)


def _coupling(writer: _Writer) -> tuple[str, str, int]:
    for name in "abc":
        writer.part(name)
        axis = writer.vector(*_unit(writer.rng, 3))
        keys = {"velocity": 1.0} if name == "a" else {}
        writer.joint(
            f"j{name}", "revolute", "ground", name, writer.at(*writer.rng.uniform(-1, 1, 3)), axis=axis, **keys
        )
    one, other = writer.rng.uniform(0.5, 2.0, 2).tolist()
    writer.constraints["k1"] = {"type": "coupling", "terms": {"ja": 1.0, "jb": -one}}
    writer.constraints["k2"] = {"type": "coupling", "terms": {"jb": 1.0, "jc": -other}}
    writer.extra_constraint({"type": "coupling", "terms": {"ja": 1.0, "jc": -one * other}})
    return _finished(writer, 1)


def _linkage(writer: _Writer, places: list[tuple[float, float, float]], last: str) -> None:
    """A crank a, a coupler b and a rocker c on hinges along z, closed by a joint of the given type."""
    axis = writer.vector(0.0, 0.0, 1.0)
    for name in "abc":
        writer.part(name)
    bodies, points = ["ground", "a", "b", "c", "ground"], [writer.at(*place) for place in places]
    writer.joint("main", "revolute", "ground", "a", points[0], axis=axis, velocity=2.0)
    writer.joint("second", "revolute", "a", "b", points[1], axis=axis)
    keys = {} if last == "spherical" else {"axis": axis}
    writer.joint("third", last, bodies[2], bodies[3], points[2], **keys)
    writer.joint("fourth", "revolute", bodies[3], bodies[4], points[3], axis=axis)


def _four_bar(writer: _Writer) -> tuple[str, str, int]:
    height = writer.rng.uniform(-0.3, 0.3, 4)
    plane = [(0.0, 0.0), (0.3, 0.2), (1.0, 0.9), (1.2, 0.0)]
    places = [(x + 0.05 * writer.rng.normal(), y, z) for (x, y), z in zip(plane, height, strict=True)]
    places[0] = (0.0, 0.0, 0.0)
    _linkage(writer, places, "revolute")
    _bearings(writer, "ground", "a", int(writer.rng.integers(1, 3)))
    _double_pin(writer, places[1], "a", "b")
    return _finished(writer, 1)


def _double_pin(writer: _Writer, place: tuple[float, float, float], one: str, other: str) -> None:
    """A second hinge on the axis of the one at this place."""
    beside = (place[0], place[1], place[2] + writer.rng.uniform(0.2, 0.5))
    writer.extra_joint("revolute", one, other, writer.at(*beside), axis=writer.vector(0.0, 0.0, 1.0))


def _spatial(writer: _Writer) -> tuple[str, str, int]:
    """A crank and a rocker on skew axes with a rod between them, whose length is a distance."""
    for name in "ac":
        writer.part(name)
    axis, across = writer.vector(0.0, 0.0, 1.0), writer.vector(*_unit(writer.rng, 3))
    writer.joint("main", "revolute", "ground", "a", writer.at(0.0, 0.0, 0.0), axis=axis, velocity=2.0)
    writer.joint("fourth", "revolute", "ground", "c", writer.at(1.5, 0.3, 0.2), axis=across)
    ends = [np.array(writer.at(0.25, 0.1, 0.1)), np.array(writer.at(1.4, 1.1, 0.4))]
    between = [writer.point(part, end.tolist()) for part, end in zip("ac", ends, strict=True)]
    length = float(np.linalg.norm(ends[1] - ends[0]))
    writer.constraints["rod"] = {"type": "distance", "between": between, "length": length}
    _bearings(writer, "ground", "a", int(writer.rng.integers(1, 4)))
    return _finished(writer, 1)


_TEXTS = {
    "shaft": _shaft, "door": _door, "telescope": _telescope, "carriage": _carriage, "welds": _welds,
    "strut": _strut, "plane": _plane, "coupling": _coupling, "four_bar": _four_bar, "spatial": _spatial,
}  # fmt: skip
