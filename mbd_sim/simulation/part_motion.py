"""Velocities and accelerations of the parts in a state, and the coordinates that give a free part a motion."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import casadi as ca
import numpy as np

from mbd_sim.geometry.pose import Array, Pose, identity_pose, unpack_poses
from mbd_sim.geometry.rotation import to_quaternion
from mbd_sim.mechanism.records import GROUND, Joint
from mbd_sim.simulation.compiled_model import Model, rotation_vector


class PartMotion(NamedTuple):
    """The motion of a part's frame in ground's frame and axes: pose, velocity of the origin, angular velocity, rates.

    Each is (3,), in m/s, rad/s, m/s² and rad/s².
    """

    pose: Pose
    velocity: Array
    angular_velocity: Array
    acceleration: Array
    angular_acceleration: Array


class PartMotions:
    """The motions of all parts of a model, exact to round-off: the poses are differentiated symbolically."""

    def __init__(self, model: Model) -> None:
        """Differentiate the poses twice along the motion; takes a second for mechanisms of many parts."""
        equations = model.equations
        self._names, self._inputs = model.part_names, model.inputs
        t, y, inputs = ca.SX.sym("t"), ca.SX.sym("y", len(model.start)), ca.SX.sym("inputs", len(model.inputs))
        rates = equations.rates.call([t, y, inputs])[0]
        (poses,) = equations.poses.call([t, y, inputs][: equations.poses.n_in()])

        def rate(expression: ca.SX) -> ca.SX:
            return ca.jtimes(expression, y, rates) + ca.jtimes(expression, t, ca.SX(1))

        first = rate(poses)
        outputs = [ca.densify(value) for value in (poses, first, rate(first))]
        self._function = ca.Function("part_motions", [t, y, inputs], outputs, {"cse": True})

    def at(self, time: float, y: Array, inputs: Array) -> dict[str, PartMotion]:
        """The motion of each part in a state y under inputs of the equations, at a time in s."""
        rows = [np.array(value).reshape(-1, 12) for value in self._function(time, y, inputs)]
        (places, rotations), (velocities, rotation_rates), (accelerations, second) = map(unpack_poses, rows)
        spin = _axial(rotation_rates @ np.swapaxes(rotations, 1, 2))
        spin_rate = _axial(second @ np.swapaxes(rotations, 1, 2))  # its symmetric part is that of ω × (ω × …)
        columns = (velocities, spin, accelerations, spin_rate)
        return {
            name: PartMotion(Pose(places[n], rotations[n]), *(values[n] for values in columns))
            for n, name in enumerate(self._names)
        }


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


def _axial(matrices: Array) -> Array:
    """The vectors (n, 3) ω of matrices (n, 3, 3) whose antisymmetric part is that of ω ×."""
    m = matrices
    return 0.5 * np.stack([m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]], axis=1)
