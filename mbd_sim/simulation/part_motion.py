"""The motions of named points, and the coordinates that give a free part a motion."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbd_sim.geometry.pose import Array, Pose, identity_pose
from mbd_sim.geometry.rotation import rotation_vector, to_quaternion
from mbd_sim.mechanism.attachments import resolve_reference
from mbd_sim.mechanism.records import GROUND, Joint, Mechanism
from mbd_sim.simulation.compiled_model import Model
from mbd_sim.simulation.motions import PartMotion


def named_frame(mechanism: Mechanism, frame: str) -> tuple[str, Pose]:
    """The part, or ground, that `part` or `part.point` names, and the pose of the point in it.

    :raises InputError: there is no such part or point.
    """
    return resolve_reference(frame, points_of(mechanism))


def points_of(mechanism: Mechanism) -> dict[str, Mapping[str, Pose]]:
    """The points of the parts and of ground."""
    return {**{name: part.points for name, part in mechanism.parts.items()}, GROUND: mechanism.ground_points}


def motion_of(model: Model, mechanism: Mechanism, frame: str, time: float, y: Array, inputs: Array) -> PartMotion:
    """The motion of the frame `part` or `part.point` in ground's frame and axes.

    :param mechanism: that of the model, or a variant with the live values among the inputs.
    :raises InputError: there is no such part or point.
    """
    part, pose = named_frame(mechanism, frame)
    if part == GROUND:
        return PartMotion(pose, *np.zeros((4, 3)))
    return model.part_motions(time, y, inputs)[part].of(pose)


def free_joint_of(model: Model, part: str) -> Joint | None:
    """The joint that lets a part move in any direction; None if there is none."""
    joints = model.mechanism.joints.values()
    return next((one for one in joints if one.type == "free" and not one.drive and one.outboard == part), None)


def free_joint_values(
    model: Model, joint: Joint, motions: Mapping[str, PartMotion]
) -> tuple[dict[str, float], dict[str, float]]:
    """The positions and speeds, by the names of coordinates, of a free joint whose parts have the given motions."""
    frames = [
        _frame(motions, end, pose) for end, pose in ((joint.parent, joint.parent_pose), (joint.child, joint.child_pose))
    ]
    (inboard, v_F, w_F), (outboard, v_M, w_M) = frames
    offset = outboard.position - inboard.position
    relative = inboard.rotation.T @ outboard.rotation
    turn = rotation_vector(to_quaternion(relative))
    positions = np.concatenate([inboard.rotation.T @ offset, turn])
    linear = inboard.rotation.T @ (v_M - v_F - np.cross(w_F, offset))
    speeds = np.concatenate([linear, outboard.rotation.T @ (w_M - w_F)])
    names = model.coordinate_names[model.layout.u[joint.name]]
    return dict(zip(names, positions.tolist(), strict=True)), dict(zip(names, speeds.tolist(), strict=True))


def _frame(motions: Mapping[str, PartMotion], part: str, pose: Pose) -> tuple[Pose, Array, Array]:
    """The pose, velocity and angular velocity of a frame of a part, or of ground, in ground's frame."""
    if part == GROUND:
        return identity_pose() @ pose, np.zeros(3), np.zeros(3)
    motion = motions[part]
    velocity = motion.velocity + np.cross(motion.angular_velocity, motion.pose.rotation @ pose.position)
    return motion.pose @ pose, velocity, motion.angular_velocity
