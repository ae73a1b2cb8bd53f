"""The joints of a mechanism as those of URDF and SDF: one for each coordinate, and those that mimic another."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import assert_never

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.linear_algebra import added
from mbd_sim.mechanism.elements.actuators import CoordinatePort
from mbd_sim.mechanism.elements.constraints import Coupling
from mbd_sim.mechanism.elements.joint_types import CommandedDrive
from mbd_sim.mechanism.elements.parts import Joint
from mbd_sim.mechanism.mechanism import Mechanism


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
    """A URDF joint: its type, its axis (3,) if it has one, and the joint that it mimics.

    Damping and friction are those of its coordinate, as are the `stiffness` of a spring and the position `rest` without
    its force.
    """

    name: str
    type: str
    axis: Array | None = None
    damping: float = 0.0
    friction: float = 0.0
    stiffness: float = 0.0
    rest: float = 0.0
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
            float(joint.damping[index]) + viscous,
            friction,
            float(joint.stiffness[index]),
            float(joint.rest[index]),
        )
        for index, (name, coordinate) in enumerate(zip(joint.motion_names, joint.kind.coordinates, strict=True))
    ]


def _type(joint: Joint, rotation: int) -> str:
    """The URDF type of a rotation, by the index of its coordinate. A screw's range is left out."""
    ends = (-math.inf, math.inf) if joint.kind.advances else range_of(joint, rotation)
    return "continuous" if ends == (-math.inf, math.inf) else "revolute"


def range_of(joint: Joint, coordinate: int) -> tuple[float, float]:
    """The range of a coordinate, by its index: that of its drive if this follows commands, infinite without one.

    A controller takes the shorter way round on a joint without a range, and a drive with one does not go that way.
    """
    if isinstance(joint.drive, CommandedDrive):
        return joint.drive.lower, joint.drive.upper
    limits = joint.limits_of(coordinate)
    return (limits.lower, limits.upper) if limits else (-math.inf, math.inf)


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
    value = coupling.value.at(0.0) - added(factor * ends[name].offset for name, factor in coupling.factors.items())
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
