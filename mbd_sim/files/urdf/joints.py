"""The joints of a URDF: converted to joints of a mechanism file, `<mimic>` to couplings, and the way back.

A joint of a mechanism is represented by URDF joints, one for each coordinate, and those that mimic another.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, assert_never

from mbd_sim.base.errors import nearest, quoted
from mbd_sim.base.geometry.pose import Array
from mbd_sim.files.text.xml import Element, Reading, placed
from mbd_sim.files.urdf.links import Origins
from mbd_sim.mechanism.elements.actuators import CoordinatePort
from mbd_sim.mechanism.elements.constraints import Coupling
from mbd_sim.mechanism.elements.parts import Joint
from mbd_sim.mechanism.mechanism import Mechanism

TYPES = {
    "fixed": "fixed",
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
    "planar": "planar",
    "floating": "free",
}
AXIAL = ("revolute", "continuous", "prismatic")
X = [1.0, 0.0, 0.0]  # URDF's axis where none is given


def joint_of(reading: Reading, joint: Element, key: str, origins: Origins) -> tuple[dict[str, Any], dict[str, Any]]:
    """The joint's record without `between`, and the keys that place its frame on the parent link."""
    kind = joint.attributes.get("type", "")
    if kind not in TYPES:
        message = f"unknown type {quoted(kind)}" if kind else "'type' is missing"
        reading.report(joint, f"{key}.type", message, nearest(kind, TYPES))
    record: dict[str, Any] = {"type": TYPES.get(kind, "fixed")}
    pose = placed(*reading.pose(joint, key))
    if kind in (*AXIAL, "planar"):
        record["axis"] = _axis(reading, joint, key, origins)
    if kind in AXIAL:
        record |= _limit(reading, joint, kind, key, origins) | _dynamics(reading, joint, key, origins)
    elif kind in ("planar", "floating"):
        for tag in ("limit", "dynamics"):
            if joint.first(tag):
                reading.leave_out(f"<{tag}> of {kind} joints", key)
    for tag in ("calibration", "safety_controller"):
        if joint.first(tag):
            reading.leave_out(f"<{tag}>", key)
    return record, pose


def _axis(reading: Reading, joint: Element, key: str, origins: Origins) -> list[float]:
    axis = joint.first("axis")
    if axis is None:
        return X
    origins[("axis",)] = reading.origin(axis, f"{key}.axis")
    xyz = reading.numbers(axis, "xyz", f"{key}.axis", 3)
    if xyz is not None and not any(xyz):
        reading.report(axis, f"{key}.axis.xyz", "must not be zero", "Write for example 0 0 1.", axis.attributes["xyz"])
        return X
    return xyz or X


def _limit(reading: Reading, joint: Element, kind: str, key: str, origins: Origins) -> dict[str, Any]:
    limit = joint.first("limit")
    if limit is None:
        if kind != "continuous":
            reading.leave_out(f"{kind} joints without <limit>, taken as unlimited", key)
        return {}
    where = f"{key}.limit"
    record: dict[str, Any] = {}
    for name in ("limits", "effort_limit", "velocity_limit"):
        origins[(name,)] = reading.origin(limit, where)
    lower, upper = (reading.number(limit, name, where) or 0.0 for name in ("lower", "upper"))
    if kind != "continuous":
        if lower > upper:
            message = f"lower {lower:g} is above upper {upper:g}"
            reading.report(limit, where, message, "Swap them.")
        elif lower == upper:
            reading.leave_out("limits without a range between them, taken as unlimited", key)
        else:
            record["limits"] = {"lower": lower, "upper": upper}
    for name in ("effort", "velocity"):
        value = reading.number(limit, name, where)
        if value is not None and value < 0.0:
            reading.report(limit, f"{where}.{name}", "must not be negative", "Write its size.", f"{value:g}")
        elif value:
            record[f"{name}_limit"] = value
        elif value == 0.0:
            reading.leave_out(f"{name} limits of 0, taken as unlimited", key)
    return record


def _dynamics(reading: Reading, joint: Element, key: str, origins: Origins) -> dict[str, Any]:
    dynamics = joint.first("dynamics")
    record: dict[str, Any] = {}
    if dynamics is None:
        return record
    where = f"{key}.dynamics"
    for name in ("damping", "friction"):
        origins[(name,)] = reading.origin(dynamics, where)
        value = reading.number(dynamics, name, where)
        if value is not None and value < 0.0:
            reading.report(dynamics, f"{where}.{name}", "must not be negative", "Write its size.", f"{value:g}")
        elif value:
            record[name] = value if name == "damping" else {"coulomb": value}
    return record


def mimic_of(
    reading: Reading, joint: Element, key: str, names: dict[str, str], kinds: dict[str, str]
) -> dict[str, Any] | None:
    """The coupling that a joint's `<mimic>` means: q = multiplier · q' + offset, with q' of the other joint.

    :param names: the name in the mechanism of each joint that is connected.
    :param kinds: the URDF type of every joint.
    """
    mimic = joint.first("mimic")
    if mimic is None:
        return None
    where, own, other = f"{key}.mimic", joint.attributes["name"], mimic.attributes.get("joint", "")
    if kinds[own] == "fixed":
        reading.leave_out("<mimic> of fixed joints", key)
        return None
    if other not in kinds:
        message = f"there is no joint {quoted(other)}" if other else "'joint' is missing"
        reading.report(mimic, f"{where}.joint", message, nearest(other, set(kinds) - {own}))
        return None
    if other not in names:
        return None  # its own problems are reported
    if other == own:
        reading.report(mimic, f"{where}.joint", "a joint cannot mimic itself", "Name another joint.", other)
        return None
    if unfit := [name for name in (own, other) if kinds[name] not in AXIAL]:
        remedy = f"Only {', '.join(AXIAL)} joints can."
        reading.report(mimic, where, f"{quoted(unfit[0])} has no single coordinate to mimic", remedy)
        return None
    multiplier, offset = (reading.number(mimic, name, where) for name in ("multiplier", "offset"))
    multiplier = 1.0 if multiplier is None else multiplier
    if multiplier == 0.0:
        message = "is 0, so this joint does not follow the other one"
        reading.report(
            mimic, f"{where}.multiplier", message, "Give a nonzero multiplier, or make it a fixed joint.", "0"
        )
        return None
    return {
        "type": "coupling",
        "terms": {names[own]: 1.0, names[other]: -multiplier},
        **({"value": offset} if offset else {}),
        "follower": names[own],
    }


@dataclass(frozen=True)
class Mimic:
    """A coordinate equal to `multiplier` times the coordinate of `joint`, plus `offset` in m or rad.

    `constraint` is the name of the coupling, or "" within a joint.
    """

    joint: str
    multiplier: float
    offset: float = 0.0
    constraint: str = ""


@dataclass(frozen=True, eq=False)
class Motion:
    """A URDF joint: its type, its axis (3,) if it has one, its damping and friction, and the joint that it mimics."""

    name: str
    type: str
    axis: Array | None = None
    damping: float = 0.0
    friction: float = 0.0
    mimic: Mimic | None = None


def motions_of(joint: Joint) -> list[Motion]:
    """The URDF joints that represent a joint, from its inboard to its outboard side."""
    match joint.type:
        case "fixed":
            return [Motion(joint.name, "fixed")]
        case "spherical" | "free":
            return [Motion(joint.name, "floating")]
        case "revolute" | "prismatic" | "cylindrical" | "universal" | "planar":
            motions = _single_motions(joint)
        case "screw":
            follower = Mimic(joint.name, joint.travel)
            motions = [
                *_single_motions(joint),
                Motion(f"{joint.name}.travel", "prismatic", joint.axis, mimic=follower),
            ]
        case _:
            assert_never(joint.type)
    if joint.reversed:
        motions = [replace(motion, axis=-motion.axis) for motion in reversed(motions) if motion.axis is not None]
    return motions


def _single_motions(joint: Joint) -> list[Motion]:
    """A URDF joint for each coordinate."""
    friction = joint.friction.coulomb if joint.friction else 0.0
    viscous = joint.friction.viscous if joint.friction else 0.0
    return [
        Motion(
            name,
            _type(joint, index) if coordinate.rotation else "prismatic",
            joint.direction(coordinate),
            float(damping) + viscous,
            friction,
        )
        for index, (name, coordinate, damping) in enumerate(
            zip(joint.motion_names, joint.kind.coordinates, joint.damping, strict=True)
        )
    ]


def _type(joint: Joint, rotation: int) -> str:
    """The URDF type of a rotation, by the index of its coordinate. A screw's range is left out."""
    return "revolute" if joint.limits_of(rotation) and not joint.kind.advances else "continuous"


def mimics_of(mechanism: Mechanism) -> dict[str, Mimic]:
    """The mimics by follower, for constant couplings of two coordinates.

    Followers that a file declares have the leader that it names, which may follow another one. Of the others, such as
    gears, one coordinate leads all that are coupled with it: one with an actuator, or else the first.
    """
    found: dict[str, Mimic] = {}
    couplings = [one for one in mechanism.constraints if isinstance(one, Coupling) and _is_mimic(one, mechanism)]
    leading = {one.port.coordinate for one in mechanism.actuators if isinstance(one.port, CoordinatePort)}
    driven = set(mechanism.driven_names)
    for coupling in sorted(couplings, key=lambda one: one.follower is None):
        ends = {name: Mimic(name, 1.0) for name in coupling.factors}
        if coupling.follower is None:
            ends = {name: _followed(end, found) for name, end in ends.items()}
        last = coupling.follower if coupling.follower not in driven else None
        last = last or next((name for name, end in reversed(ends.items()) if end.joint not in leading | driven), "")
        leader, follower = sorted(ends, key=lambda name: name == last)
        if ends[follower].joint not in found and _followed(ends[leader], found).joint != ends[follower].joint:
            found[ends[follower].joint] = _mimic(coupling, ends, leader, follower)
    declared = {coupling.name for coupling in couplings if coupling.follower is not None}
    return {name: one if one.constraint in declared else _followed(one, found) for name, one in found.items()}


def _mimic(coupling: Coupling, ends: Mapping[str, Mimic], leader: str, follower: str) -> Mimic:
    """The mimic of the coordinate in which `ends` gives the follower, of the one in which it gives the leader."""
    slopes = {name: factor * ends[name].multiplier for name, factor in coupling.factors.items()}
    value = coupling.value.at(0.0) - sum(factor * ends[name].offset for name, factor in coupling.factors.items())
    return Mimic(ends[leader].joint, -slopes[leader] / slopes[follower], value / slopes[follower], coupling.name)


def _followed(mimic: Mimic, mimics: Mapping[str, Mimic]) -> Mimic:
    """The mimic in terms of the joint that leads the chain of mimics."""
    while (outer := mimics.get(mimic.joint)) is not None:
        offset = mimic.offset + mimic.multiplier * outer.offset
        mimic = replace(mimic, joint=outer.joint, multiplier=mimic.multiplier * outer.multiplier, offset=offset)
    return mimic


def _is_mimic(coupling: Coupling, mechanism: Mechanism) -> bool:
    """Whether a coupling is an equation of two coordinates that are URDF joints, with a constant value."""
    joints = [joint for joint in mechanism.joints.values() if joint.axis.any() and not joint.splits]
    single = {name for joint in joints for name in joint.motion_names}
    exact = coupling.play is None and coupling.bound is None and not coupling.value.variables
    moves_by_itself = coupling.factors.keys() <= set(mechanism.driven_names)
    return exact and len(coupling.factors) == 2 and single.issuperset(coupling.factors) and not moves_by_itself
