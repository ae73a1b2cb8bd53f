"""The joints of a mechanism as SDF has them: types, links, frames, axes, and what acts about these.

A joint of an SDF has a frame on its child, and its coordinate is 0 where the file places the links: what acts on a
coordinate is written with its offset.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.geometry.rotation import about
from mbd_sim.files.urdf.motions import Mimic, motions_of, range_of
from mbd_sim.mechanism.elements.joint_types import CommandedDrive, JointType
from mbd_sim.mechanism.elements.parts import Joint

NATIVE: Mapping[JointType, str] = {"fixed": "fixed", "spherical": "ball", "universal": "universal"}


@dataclass(frozen=True, eq=False)
class WrittenAxis:
    """An axis (3,) in the frame of its joint, and what acts about or along it, in SDF's coordinate."""

    direction: Array
    stiffness: float = 0.0
    rest: float = 0.0
    damping: float = 0.0
    friction: float = 0.0
    lower: float | None = None
    upper: float | None = None
    mimic: Mimic | None = None
    coordinate: str = ""


@dataclass(frozen=True, eq=False)
class SdfJoint:
    """A joint: its type, its links, its frame in the child link, its axes, and its limits of effort and velocity."""

    name: str
    type: str
    parent: str
    child: str
    frame: Pose
    axes: tuple[WrittenAxis, ...] = ()
    lead: float = 0.0
    effort: float | None = None
    velocity: float | None = None


@dataclass(eq=False)
class Chain:
    """The SDF joints for a joint, and the links between them with their poses in the world."""

    joints: list[SdfJoint] = field(default_factory=list)
    links: dict[str, Pose] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class LinkPoses:
    """Where the links are: the `poses` of the parts in the world, and the coordinates there by name."""

    poses: Mapping[str, Pose]
    offsets: Mapping[str, float]

    def frame(self, part: str, pose: Pose) -> Pose:
        """The pose in the world of a frame of a part."""
        return self.poses[part] @ pose if part in self.poses else pose


def native_type(joint: Joint) -> str:
    """The type of SDF for a joint with all its coordinates; "" if it has none."""
    return "screw" if joint.kind.advances else NATIVE.get(joint.type, "")


def written_chain(joint: Joint, placement: LinkPoses, mimics: Mapping[str, Mimic]) -> Chain:
    """The joints for a joint of the tree. One of several coordinates that SDF does not know becomes several."""
    inner, outer = (joint.child_pose, joint.parent_pose) if joint.reversed else (joint.parent_pose, joint.child_pose)
    if native_type(joint):
        return Chain([_native(joint, placement, inner, outer, joint.reversed, mimics)])
    chain, parent = Chain(), joint.inboard
    frame, motions = placement.frame(joint.inboard, inner), motions_of(joint)
    for motion in motions:
        assert motion.axis is not None
        value, last = placement.offsets[motion.name], motion is motions[-1]
        step = Pose(value * motion.axis, np.eye(3))
        if motion.type != "prismatic":
            step = Pose(np.zeros(3), about(motion.axis, value))
        frame = frame @ step
        child = joint.outboard_part if last else f"{motion.name}_link"
        place = outer if last else Pose(np.zeros(3), np.eye(3))
        axis = _axis(joint, motion.name, motion.axis, placement, mimics)
        single = len(motions) == 1
        chain.joints.append(
            SdfJoint(
                motion.name,
                "prismatic" if motion.type == "prismatic" else "revolute",
                parent,
                child,
                place,
                (axis,),
                effort=joint.effort_limit if single else None,
                velocity=_velocity_limit(joint) if single else None,
            )
        )
        if not last:
            chain.links[child] = frame
        parent = child
    return chain


def written_closing(joint: Joint, placement: LinkPoses) -> SdfJoint | None:
    """A joint that closes a loop; None if SDF does not know its type."""
    if native_type(joint):
        return _native(joint, placement, joint.parent_pose, joint.child_pose, False, {})
    if joint.type in ("revolute", "prismatic"):
        axis = WrittenAxis(joint.axis)
        return SdfJoint(joint.name, joint.type, joint.parent, joint.child, joint.child_pose, (axis,))
    return None


def _native(
    joint: Joint, placement: LinkPoses, inner: Pose, outer: Pose, is_reversed: bool, mimics: Mapping[str, Mimic]
) -> SdfJoint:
    parent, child = (joint.child, joint.parent) if is_reversed else (joint.parent, joint.child)
    sign = -1.0 if is_reversed else 1.0
    axes: list[WrittenAxis] = []
    if joint.type == "universal":
        names, directions = [*joint.motion_names], [joint.axis, joint.second]
        if is_reversed:
            names, directions = names[::-1], directions[::-1]
        relative = placement.frame(child, outer).rotation.T @ placement.frame(parent, inner).rotation
        turned = (
            relative @ directions[0],
            directions[1],
        )  # the first axis is fixed in the parent, the second in the child
        axes = [_axis(joint, name, sign * one, placement, mimics) for name, one in zip(names, turned, strict=True)]
    elif joint.kind.advances:
        axes = [_axis(joint, joint.name, sign * joint.axis, placement, mimics)]
    return SdfJoint(
        joint.name,
        native_type(joint),
        parent,
        child,
        outer,
        tuple(axes),
        joint.lead,
        joint.effort_limit,
        _velocity_limit(joint),
    )


def _velocity_limit(joint: Joint) -> float | None:
    """The largest speed of a joint, or of its drive if this follows commands; None without one."""
    limit = joint.drive.velocity_limit if isinstance(joint.drive, CommandedDrive) else joint.velocity_limit
    return None if limit is None or math.isinf(limit) else limit


def _axis(joint: Joint, name: str, direction: Array, placement: LinkPoses, mimics: Mapping[str, Mimic]) -> WrittenAxis:
    """What acts on a coordinate, with its offset taken from rest and limits. A closing joint has no coordinate."""
    if name not in placement.offsets:
        return WrittenAxis(direction)
    index, offset = joint.motion_names.index(name), placement.offsets[name]
    lower, upper = (None if math.isinf(bound) else bound - offset for bound in range_of(joint, index))
    if joint.drive:
        return WrittenAxis(direction, lower=lower, upper=upper, coordinate=name)
    friction, mimic = joint.friction, mimics.get(name)
    if mimic is not None:
        moved = mimic.offset + mimic.multiplier * placement.offsets[mimic.joint] - offset
        mimic = replace(mimic, offset=moved)
    return WrittenAxis(
        direction,
        float(joint.stiffness[index]),
        float(joint.rest[index]) - offset,
        float(joint.damping[index]) + (friction.viscous if friction else 0.0),
        friction.coulomb if friction else 0.0,
        lower,
        upper,
        mimic,
        name,
    )
