"""Numbers of a mechanism's records replaced by symbols, so that one set of equations serves many values.

A number is identified by its path through the records. Tables here say which fields the equations of motion read, and
which of their numbers can be symbols. `equation_data` reads these numbers, and the rest of what the equations depend
on, such as directions of axes and tables of springs. `with_symbols` replaces the numbers by symbols.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, Literal, get_args

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.geometry.batch import Batch, of_all
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.dynamics.kinematics.links import Link, build_links
from mbd_sim.mechanism.elements import constraints as c
from mbd_sim.mechanism.elements.actuators import Actuator, DcMotor, EffortMotor, FluidCylinder, Gas, Oil, Servo
from mbd_sim.mechanism.elements.constraints import ContactLaw, Play
from mbd_sim.mechanism.elements.contacts import Ball, Barrel, ComplianceLaw, Contact, EllipsoidBody, PlanarBody, Rim
from mbd_sim.mechanism.elements.forces import Bushing, Spring
from mbd_sim.mechanism.elements.parts import Attachment, Joint, Limits, Part
from mbd_sim.mechanism.elements.sensors import AnySensor, RangeFinder
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.expression import TimeExpression
from mbd_sim.mechanism.values.laws import Expressed, Friction, GreenStrain, Linear, PowerLaw
from mbd_sim.mechanism.values.tables import BicubicSurface, Curve

Path = tuple[str | int, ...]

ARRAY_ROUND_OFF = (
    1e-14  # relative to the largest number of an array, of equal numbers that were computed in different ways
)


class StructureError(ValueError):
    """A mechanism differs from another one by more than the values of its parameters."""


@dataclass(frozen=True, eq=False)
class EquationData:
    """Everything that the equations of a mechanism depend on.

    `free` (k,) are the numbers that can be symbols, at `paths`; `fixed` is everything else, by path.
    """

    paths: tuple[Path, ...]
    free: Array
    fixed: Mapping[Path, Any]

    def size_near(self, index: int) -> float:
        """The largest magnitude in the array of a free number, or its own where it is in none."""
        path = self.paths[index]
        if not isinstance(path[-1], int):
            return abs(float(self.free[index]))
        first, last = index, index + 1
        while first and self.paths[first - 1][:-1] == path[:-1]:
            first -= 1
        while last < len(self.paths) and self.paths[last][:-1] == path[:-1]:
            last += 1
        return float(np.max(np.abs(self.free[first:last])))


@dataclass(frozen=True, eq=False)
class SymbolicParameters:
    """The numbers of a mechanism that are symbols in its equations, and their values.

    Free number `indices[i]` of the `data` is parameter `columns[i]` of n. Numbers that always agree, such as both ends
    of one length, share a parameter. `base` (n,) are the values in the mechanism itself.
    """

    data: EquationData
    indices: NDArray[np.intp]
    columns: NDArray[np.intp]
    base: Array

    @cached_property
    def symbols(self) -> ca.SX:
        """The symbols (n,)."""
        return ca.SX.sym("p", len(self.base))

    def values_in(self, data: EquationData) -> Array:
        """The values (n,) of a mechanism that is known to differ in no other number."""
        values = self.base.copy()
        values[self.columns] = data.free[self.indices]
        return values

    def checked_values_in(self, data: EquationData) -> Array:
        """The values (n,) of another mechanism of the same structure.

        Numbers may differ by round-off: the two halves of an inertia that is turned into the axes of a joint are equal
        for some values of a length, and differ in the last bit for others.

        :raises StructureError: it differs in more than these parameters.
        """
        _require_same_structure(self.data, data)
        values = self.values_in(data)
        expected = self.data.free.copy()
        expected[self.indices] = values[self.columns]
        for index in np.flatnonzero(expected != data.free).tolist():
            if not abs(expected[index] - data.free[index]) <= ARRAY_ROUND_OFF * data.size_near(index):
                path = _dotted(data.paths[index])
                raise StructureError(f"{path} differs, which is not among the values that can change")
        return values


def equation_data(mechanism: Mechanism) -> EquationData:
    """Read everything that the equations of a mechanism depend on."""
    paths, free, fixed = _read(mechanism)
    return EquationData(paths, np.concatenate([np.zeros(0), *free]), fixed)


def equation_data_of_variants(mechanism: Mechanism, valid: NDArray[np.bool_]) -> list[EquationData]:
    """Read the equation data of each of the k variants of a mechanism whose numbers are batches.

    :param valid: (k,) of these batches; variants that differ in data that cannot be symbols are marked.
    """
    paths, free, fixed = _read(mechanism)
    for path, leaf in fixed.items():
        if isinstance(leaf, Batch):
            leaf.require(np.all((leaf.values == leaf.values[0]).reshape(len(valid), -1), axis=1))
            fixed[path] = leaf.values[0] if leaf.shape else leaf.values[0].item()
    columns = [of_all(leaf, len(valid)).reshape(len(valid), -1) for leaf in free]
    return [EquationData(paths, row, fixed) for row in np.concatenate([np.zeros((len(valid), 0)), *columns], axis=1)]


def _read(mechanism: Mechanism) -> tuple[tuple[Path, ...], list[Any], dict[Path, Any]]:
    """The paths of the numbers that can be symbols, arrays (n,) or batches of these numbers, and the rest by path."""
    paths: list[Path] = []
    free: list[Any] = []
    fixed: dict[Path, Any] = {}
    # Imported here because it knows the records of everything that few mechanisms have.
    leaves: list[tuple[Path, Any, bool]] = []
    add_leaves((mechanism, tuple(build_links(mechanism))), (), False, leaves)
    for path, leaf, symbolic in leaves:
        if not symbolic:
            fixed[path] = leaf
        else:
            is_array = isinstance(leaf, np.ndarray) or (isinstance(leaf, Batch) and leaf.shape)
            paths += [(*path, index) for index in range(math.prod(leaf.shape))] if is_array else [path]
            free.append(leaf if isinstance(leaf, Batch) else np.ravel(leaf).astype(float))
    return tuple(paths), free, fixed


def no_parameters() -> SymbolicParameters:
    """Parameters of equations in which all numbers are constants."""
    none = np.zeros(0, dtype=np.intp)
    return SymbolicParameters(EquationData((), np.zeros(0), {}), none, none, np.zeros(0))


def varying_parameters(base: EquationData, others: Sequence[EquationData]) -> SymbolicParameters:
    """The parameters in which some mechanisms differ from each other, with the values of the `base`.

    :raises StructureError: they differ in data that cannot be symbols.
    """
    for other in others:
        _require_same_structure(base, other)
    table = np.array([base.free, *(other.free for other in others)])
    indices = np.flatnonzero(np.any(table != table[0], axis=0))
    column_of: dict[bytes, int] = {}
    columns = [column_of.setdefault(table[:, index].tobytes(), len(column_of)) for index in indices]
    values = np.zeros(len(column_of))
    values[columns] = base.free[indices]
    return SymbolicParameters(base, indices, np.array(columns, dtype=np.intp), values)


def with_symbols(mechanism: Mechanism, parameters: SymbolicParameters) -> tuple[Mechanism, list[Link]]:
    """The mechanism and its links, with symbols in place of the parameters."""
    links = tuple(build_links(mechanism))
    if not len(parameters.base):
        return mechanism, list(links)
    symbols = {
        parameters.data.paths[index]: parameters.symbols[int(column)]
        for index, column in zip(parameters.indices, parameters.columns, strict=True)
    }
    prefixes = {path[:length] for path in symbols for length in range(len(path) + 1)}
    mechanism, links = _replaced((mechanism, links), (), symbols, prefixes)
    return mechanism, list(links)


def _require_same_structure(base: EquationData, other: EquationData) -> None:
    if other.paths is base.paths and other.fixed is base.fixed:
        return
    if other.paths != base.paths:
        raise StructureError("it has different parts, joints or forces")
    for path, leaf in other.fixed.items():
        if not _same(leaf, base.fixed.get(path)):
            raise StructureError(f"{_named(path, other.fixed)} differs, which is built into the equations")


def _replaced(record: Any, path: Path, symbols: Mapping[Path, ca.SX], prefixes: set[Path]) -> Any:
    """The record with the leaves at the paths of `symbols` replaced; `prefixes` are all paths that lead to one."""
    if path not in prefixes:
        return record
    if path in symbols:
        return symbols[path]
    if isinstance(record, np.ndarray):
        matrix = ca.SX(ca.DM(record))
        for index, entry in enumerate(np.ndindex(record.shape)):
            if (symbol := symbols.get((*path, index))) is not None:
                matrix[entry] = symbol
        return matrix
    if isinstance(record, Mapping):
        return {key: _replaced(value, (*path, key), symbols, prefixes) for key, value in record.items()}
    if isinstance(record, tuple):
        return tuple(_replaced(value, (*path, index), symbols, prefixes) for index, value in enumerate(record))
    changed = {
        field.name: _replaced(getattr(record, field.name), (*path, field.name), symbols, prefixes)
        for field in dataclasses.fields(record)
        if (*path, field.name) in prefixes
    }
    return dataclasses.replace(record, **changed)


def _same(one: Any, other: Any) -> bool:
    return bool(np.array_equal(one, other)) if isinstance(one, np.ndarray) else bool(one == other)


def _dotted(path: Path) -> str:
    """A path for a message, without its first step, which separates the mechanism from its links."""
    return ".".join(str(step) for step in path[1:])


def _named(path: Path, leaves: Mapping[Path, Any]) -> str:
    """A path for a message, in which records of a list, such as contacts, are named and not counted."""
    steps = [leaves.get((*path[: place + 1], "name"), step) for place, step in enumerate(path)]
    return _dotted(tuple(steps))


# The fields of each record whose numbers can be symbols; records not listed have none.
_SYMBOLIC: Mapping[type, tuple[str, ...]] = {
    Mechanism: ("gravity",),
    Part: ("mass", "center"),
    Link: ("inertia",),
    Pose: ("position", "rotation"),
    Joint: ("stiffness", "rest", "damping"),
    Limits: ("lower", "upper", "stiffness", "damping", "restitution"),
    ContactLaw: ("restitution", "friction", "static_friction"),
    Play: ("half", "restitution"),
    Linear: ("stiffness",),
    GreenStrain: ("stiffness", "length"),
    PowerLaw: ("coefficient",),
    Friction: (
        "coulomb",
        "static",
        "stribeck_velocity",
        "viscous",
        "regularization",
        "coefficient",
        "static_coefficient",
    ),
    Spring: ("length", "damping", "mass"),
    EffortMotor: ("effort_limit", "gear", "rotor_inertia"),
    DcMotor: (
        "torque_constant",
        "resistance",
        "inductance",
        "voltage_limit",
        "current_limit",
        "gear",
        "efficiency",
        "rotor_inertia",
        "coulomb",
        "viscous",
        "regularization",
        "bandwidth",
    ),
    FluidCylinder: ("areas", "dead_volumes", "retracted", "stroke", "supply", "tank", "transition"),
    Oil: ("bulk_modulus", "valve", "leakage"),
    Gas: ("exponent", "valve", "critical_ratio", "leakage"),
    Servo: ("kp", "ki", "kd", "feedforward", "limit", "tracking_time", "rate_limit"),
    Bushing: ("stiffness", "damping"),
    Attachment: ("point",),
    TimeExpression: ("names",),
    c.Rolling: ("radius",),
    c.Clutch: ("static",),
    Ball: ("radius",),
    Rim: ("radius", "length"),
    EllipsoidBody: ("radii",),
    Barrel: ("radius",),
    RangeFinder: ("normal",),
    ComplianceLaw: ("stiffness", "damping", "friction", "regularization"),
}
# The fields of each record on which the equations do not depend.
_UNREAD: Mapping[type, tuple[str, ...]] = {
    Mechanism: (
        "name", "description", "parameters", "source", "method", "step", "rest_speed", "ground_points", "tree",
        "sensor_seed",
        "bases", "moved", "ranges",
    ),
    Part: ("inertia", "points", "shapes", "collisions"),  # the inertia is read from the link, shapes from contacts
    Joint: ("position", "velocity", "fixed_in_assembly", "fixed_speeds", "effort_limit", "compliance"),
    Link: ("q", "u", "disturbance"),
    Actuator: ("start",),
    FluidCylinder: ("pressures",),
    **dict.fromkeys(get_args(AnySensor), ("name", "sampling", "errors")),
}  # fmt: skip


@cache
def structure_of(kind: type) -> Literal["record", "mapping", "sequence", "number", "constant"]:
    """How the equations read values of a type."""
    if issubclass(kind, Expressed | Curve | BicubicSurface):  # whose potential or slopes are computed beforehand
        return "constant"
    if dataclasses.is_dataclass(kind):
        return "record"
    if issubclass(kind, Mapping):
        return "mapping"
    if issubclass(kind, tuple | list):
        return "sequence"
    return "number" if issubclass(kind, float | int | np.ndarray | Batch) else "constant"


@cache
def read_fields(kind: type) -> tuple[tuple[str, bool], ...]:
    """The fields of a record on which the equations depend, and whether their numbers can be symbols."""
    names = [field.name for field in dataclasses.fields(kind) if field.name not in _UNREAD.get(kind, ())]
    return tuple((name, name in _SYMBOLIC.get(kind, ())) for name in names)


def _has_features(contact: Contact) -> bool:
    """Whether features are computed from the sizes of both bodies, which are then numbers and no symbols."""
    has_slots = contact.slots > 0 and not isinstance(contact.first, Ball)  # which touches cylinders without them too
    return has_slots or any(isinstance(body, PlanarBody) for body in (contact.first, contact.second))


def add_leaves(record: Any, path: Path, symbolic: bool, found: list[tuple[Path, Any, bool]]) -> None:
    """Append to `found` the path and value of each leaf of nested records, and whether it can be a symbol."""
    kind: type = type(record)
    match structure_of(kind):
        case "record":
            fixed = ("first", "second") if isinstance(record, Contact) and _has_features(record) else ()
            for name, can_be_symbolic in read_fields(kind):
                first = len(found)
                add_leaves(getattr(record, name), (*path, name), can_be_symbolic, found)
                if name in fixed:
                    found[first:] = [(*leaf[:2], False) for leaf in found[first:]]
        case "mapping":
            for key, value in record.items():
                add_leaves(value, (*path, key), symbolic, found)
        case "sequence":
            for index, value in enumerate(record):
                add_leaves(value, (*path, index), symbolic, found)
        case "number":
            found.append((path, record, symbolic))
        case "constant":
            found.append((path, record, False))
