"""The URDF joints that represent a joint of a mechanism: one for each coordinate, and those that mimic another."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import assert_never

from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.constraints import Coupling
from mbd_sim.mechanism.records import Joint, Mechanism


@dataclass(frozen=True)
class Mimic:
    """A coordinate equal to `multiplier` times the coordinate of `joint`, plus `offset` in m or rad."""

    joint: str
    multiplier: float
    offset: float = 0.0


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
            follower = Mimic(joint.name, joint.lead / (2.0 * math.pi))
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
    return "revolute" if joint.limits_of(rotation) and joint.type != "screw" else "continuous"


def mimics_of(mechanism: Mechanism) -> dict[str, Mimic]:
    """The mimics for constant couplings of two coordinates; no coordinate mimics one that mimics another."""
    found: dict[str, Mimic] = {}
    joints = [joint for joint in mechanism.joints.values() if joint.axis.any() and not joint.splits]
    single = {name for joint in joints for name in joint.coordinate_names}
    for constraint in mechanism.constraints:
        if not isinstance(constraint, Coupling) or len(constraint.factors) != 2 or not _is_constant(constraint):
            continue
        if not single.issuperset(constraint.factors):
            continue
        for leader, follower in (tuple(constraint.factors), tuple(constraint.factors)[::-1]):
            leaders = {mimic.joint for mimic in found.values()}
            if follower not in found and follower not in leaders and leader not in found:
                factor = constraint.factors[follower]
                offset = constraint.value.at(0.0) / factor
                found[follower] = Mimic(leader, -constraint.factors[leader] / factor, offset)
                break
    return found


def _is_constant(coupling: Coupling) -> bool:
    return not coupling.value.variables
