"""Joint coordinates and speeds by the names that expressions use: `crank`, `crank.position`, `crank.velocity`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from mbd_sim.errors import InputError, quoted
from mbd_sim.mechanism.expression import StateName
from mbd_sim.mechanism.joint_types import JOINT_KINDS, JointKind
from mbd_sim.mechanism.names import in_expression

POSITION, VELOCITY = ".position", ".velocity"


@dataclass(frozen=True)
class CoordinateNames:
    """The coordinates of a file's joints by name, and whether each has a position: an angular velocity has none.

    `effort_units` are the SI units of their efforts. `unreadable` are joints of an unknown type.
    """

    has_position: Mapping[str, bool] = field(default_factory=dict)
    effort_units: Mapping[str, str] = field(default_factory=dict)
    unreadable: frozenset[str] = frozenset()

    def resolve(self, name: str) -> StateName | None:
        """What a name in an expression stands for; None if it is no name of a coordinate or speed.

        :raises InputError: an angular velocity is used as a coordinate.
        """
        if any(name == joint or name.startswith(f"{joint}.") for joint in self.unreadable):
            return StateName(name, name, False)
        for suffix in (VELOCITY, POSITION, ""):
            coordinate = name.removesuffix(suffix)
            if not name.endswith(suffix) or coordinate not in self.has_position:
                continue
            if suffix != VELOCITY and not self.has_position[coordinate]:
                message = f"{quoted(coordinate)} is a component of an angular velocity: it has no position"
                raise InputError(message, f"For the speed write {in_expression(coordinate)}{VELOCITY}.")
            return StateName(name, coordinate, suffix == VELOCITY)
        return None

    def remedy_for_missing_quotes(self, expression: str) -> str:
        """What to do about a name such as shoulder-pitch that an expression has without quotes; "" if it has none."""
        found = [name for name in self.has_position if in_expression(name) != name and name in expression]
        return f"Put the name in quotes: {in_expression(found[0])}." if found else ""

    @property
    def suggestions(self) -> list[str]:
        """The names to which a misspelled one is compared."""
        speeds = [coordinate + VELOCITY for coordinate in self.has_position]
        return [*(name for name, has_position in self.has_position.items() if has_position), *speeds]


def coordinate_names(joints: Any) -> CoordinateNames:
    """The names for the `joints` of a file, as they are written."""
    found: dict[str, bool] = {}
    units: dict[str, str] = {}
    unreadable = set()
    for name, joint in joints.items() if isinstance(joints, dict) else ():
        kind = _kind(joint.get("type")) if isinstance(joint, dict) else None
        if kind is None:
            unreadable.add(name)
            continue
        for coordinate in kind.coordinates:
            found[name + coordinate.label] = kind.quaternion is None or not coordinate.rotation
            units[name + coordinate.label] = "N*m" if coordinate.rotation else "N"
    return CoordinateNames(found, units, frozenset(unreadable))


def _kind(written: Any) -> JointKind | None:
    return next((kind for name, kind in JOINT_KINDS.items() if name == written), None)
