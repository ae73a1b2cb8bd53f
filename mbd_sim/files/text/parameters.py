"""The names that expressions of a mechanism file use: its `parameters`, and the coordinates and speeds of joints.

Parameters may refer to each other in any order. The names of a joint's coordinate and speed are `crank`,
`crank.position` and `crank.velocity`.
"""

from __future__ import annotations

import keyword
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from mbd_sim.base.errors import InputError, Problem, listed, nearest, quoted
from mbd_sim.files.text.functions import Functions, dependencies_first, resolve_functions, users
from mbd_sim.files.text.units import factor, si_factor
from mbd_sim.files.text.values import parse_value, split_unit
from mbd_sim.mechanism.elements.joint_types import JOINT_KINDS, JointKind
from mbd_sim.mechanism.values.expression import CONSTANTS, HIDEABLE, RESERVED, TIME, StateName, names_in
from mbd_sim.mechanism.values.names import in_expression
from mbd_sim.mechanism.values.source import Source
from mbd_sim.mechanism.values.tables import Table

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


@dataclass
class Parameters:
    """The values of a file's parameters in SI units, the names of those that have none, and why they have none.

    `units` are those with which parameters are written. `functions` are those of the same file, and so are
    `coordinates` and `tables`, of which `unreadable_tables` are invalid. `ambiguous` are the names of joints that mean
    something else in expressions. If `lenient`, invalid numbers, which are reported already, count as unknown ones.
    """

    values: dict[str, float] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    ambiguous: frozenset[str] = frozenset()
    unresolved: set[str] = field(default_factory=set)
    problems: list[Problem] = field(default_factory=list)
    functions: Functions = field(default_factory=Functions)
    coordinates: CoordinateNames = field(default_factory=CoordinateNames)
    tables: dict[str, Table] = field(default_factory=dict)
    unreadable_tables: set[str] = field(default_factory=set)
    lenient: bool = False

    def unknown_in(self, value: str) -> bool:
        """Whether a value depends on a parameter or a function whose own problem is reported already."""
        if not (self.unresolved or self.functions.unresolved):
            return False
        expression, _ = split_unit(value)
        return self.functions.calls_invalid(expression) or bool(
            names_in(self.functions.expanded(expression), self.unresolved) & self.unresolved
        )

    def require_clear(self, expression: str, state: bool = False) -> None:
        """Refuse an expression with the name of a joint that is a constant too, or with a `state` the time.

        :raises InputError: which one.
        """
        doubtful = self.ambiguous if state else self.ambiguous - {TIME}
        if found := sorted(doubtful and names_in(expression, doubtful) & doubtful):
            what = "the time" if found[0] == TIME else "a constant"
            message = f"'{found[0]}' is {what} in expressions, and the name of a joint"
            raise InputError(message, f"Rename the joint, or write {found[0]}.position for its coordinate.")

    def unit_of(self, expression: str) -> str:
        """The unit of the parameter for which an expression stands, perhaps with a sign; "" if it is anything else."""
        return self.units.get(expression.strip("()+- "), "")

    def require_unit(self, expression: str, si_unit: str | None) -> None:
        """Refuse an expression that is a parameter with a unit that does not fit the quantity.

        :raises InputError: the parameter has another dimension, or another angle: a lead is per turn.
        """
        if si_unit is None or not (unit := self.unit_of(expression)):
            return
        name = expression.strip("()+- ")
        try:
            fits = factor(unit, si_unit) == si_factor(unit)
        except InputError as error:
            raise InputError(f"the parameter '{name}': {error.message}", error.remedy) from error
        if not fits:
            message = (
                f"the parameter '{name}' is in {unit}, and so counts per rad; a value in {si_unit} is expected here"
            )
            raise InputError(message, f"Write the parameter in {si_unit.partition('/')[0]}, without the angle.")

    def among(self, names: Collection[str]) -> dict[str, float]:
        """The values of those of the names that are parameters, in the order in which they were resolved."""
        return {name: self.values[name] for name in sorted(self.values.keys() & names, key=self._positions.__getitem__)}

    @cached_property
    def _positions(self) -> dict[str, int]:
        return {name: position for position, name in enumerate(self.values)}


def resolve_parameters(source: Source) -> Parameters:
    """Evaluate the file's `parameters`, each after those that it refers to."""
    functions = resolve_functions(source)
    joints, written = source.data.get("joints"), source.data.get("parameters")
    joint_names = frozenset(joints if isinstance(joints, dict) else ())
    ambiguous = joint_names & {*CONSTANTS, TIME} - (written.keys() if isinstance(written, dict) else set())
    result = Parameters(problems=list(functions.problems), functions=functions, ambiguous=ambiguous)
    if not isinstance(written, dict):
        return result

    def fail(name: str, error: InputError) -> None:
        result.problems.append(source.problem(("parameters", name), error.message, error.remedy, written[name]))
        result.unresolved.add(name)

    uses: dict[str, set[str]] = {}
    for name, value in written.items():
        try:
            uses[name] = _used_names(name, value, written, result)
        except InputError as error:
            fail(name, error)
    for name in dependencies_first(uses):
        value = written[name]
        calls_invalid = isinstance(value, str) and functions.calls_invalid(split_unit(value)[0])
        if calls_invalid or uses[name] & result.unresolved:
            result.unresolved.add(name)
            continue
        try:
            result.values[name] = parse_value(value, result.values, si_unit=None, functions=functions.expanded)
            if isinstance(value, str) and (unit := _unit(value, result)):
                result.units[name] = unit
        except InputError as error:
            fail(name, error)
    left = {name: used for name, used in uses.items() if name not in result.values and name not in result.unresolved}
    result.unresolved |= set(left)
    after_a_circle = set(dependencies_first(users(left)))
    circle = [name for name in left if name not in after_a_circle]
    for name in circle:
        message = f"parameters refer to each other in a circle: {listed(circle)}"
        fail(name, InputError(message, "Replace one of these references by a number."))
    return result


def _unit(value: str, parameters: Parameters) -> str:
    expression, unit = split_unit(value)
    return unit or parameters.unit_of(expression)


def _used_names(name: str, value: object, written: Mapping[str, object], parameters: Parameters) -> set[str]:
    if (name in RESERVED and name != HIDEABLE) or keyword.iskeyword(name):
        raise InputError(f"'{name}' is reserved in expressions", "Choose another name.")
    expression = parameters.functions.expanded(split_unit(value)[0]) if isinstance(value, str) else "0"
    parameters.require_clear(expression)
    used = names_in(expression, written)
    unknown = sorted(other for other in used if other not in written)
    if unknown:
        remedy = nearest(unknown[0], (other for other in written if other != name)) or "Define it under 'parameters'."
        raise InputError(f"unknown name {quoted(unknown[0])}", remedy)
    return used
