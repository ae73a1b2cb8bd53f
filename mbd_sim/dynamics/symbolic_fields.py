"""Which fields of the records the equations of motion read, and which of their numbers can be symbols."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from mbd_sim.dynamics.links import Link
from mbd_sim.geometry.batch import Batch
from mbd_sim.geometry.pose import Pose
from mbd_sim.mechanism import constraints as c
from mbd_sim.mechanism.actuators import Actuator, DcMotor, EffortMotor, Servo
from mbd_sim.mechanism.contacts import Ball, Barrel, Cushion, Rim
from mbd_sim.mechanism.cylinders import Cylinder, Gas, Oil
from mbd_sim.mechanism.expression import TimeExpression
from mbd_sim.mechanism.force_elements import Bushing, Spring
from mbd_sim.mechanism.laws import Expressed, Friction, GreenStrain, Linear, PowerLaw
from mbd_sim.mechanism.one_sided import ContactLaw, Play
from mbd_sim.mechanism.records import Attachment, Joint, Limits, Mechanism, Part
from mbd_sim.mechanism.sensors import AnySensor, RangeFinder
from mbd_sim.mechanism.tables import Curve, Surface

if TYPE_CHECKING:
    from mbd_sim.dynamics.symbolic_parameters import Path

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
    Cylinder: ("areas", "dead_volumes", "retracted", "stroke", "supply", "tank", "transition"),
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
    Barrel: ("radius",),
    RangeFinder: ("normal",),
    Cushion: ("stiffness", "damping", "friction", "regularization"),
}
# The fields of each record on which the equations do not depend.
_UNREAD: Mapping[type, tuple[str, ...]] = {
    Mechanism: (
        "name", "description", "parameters", "source", "method", "step", "rest_speed", "ground_points", "tree",
        "sensor_seed",
        "bases", "moved",
    ),
    Part: ("inertia", "points", "shapes"),  # the inertia is read from the link
    Joint: ("position", "velocity", "fixed_in_assembly", "fixed_speeds", "effort_limit", "compliance"),
    Link: ("q", "u", "disturbance"),
    Actuator: ("start",),
    Cylinder: ("pressures",),
    **dict.fromkeys(get_args(AnySensor), ("name", "sampling", "errors")),
}  # fmt: skip


@cache
def structure_of(kind: type) -> Literal["record", "mapping", "sequence", "number", "constant"]:
    """How the equations read values of a type."""
    if issubclass(kind, Expressed | Curve | Surface):  # whose potential or slopes are computed beforehand
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


def add_leaves(record: Any, path: Path, symbolic: bool, found: list[tuple[Path, Any, bool]]) -> None:
    """Append to `found` the path and value of each leaf of nested records, and whether it can be a symbol."""
    kind: type = type(record)
    match structure_of(kind):
        case "record":
            for name, can_be_symbolic in read_fields(kind):
                add_leaves(getattr(record, name), (*path, name), can_be_symbolic, found)
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
