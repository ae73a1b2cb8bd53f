"""The messages that are published with each state; the table in `topics` says which of them are always published."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from geometry_msgs.msg import Point, Pose, PoseStamped, Transform, TransformStamped, Vector3, Wrench
from sensor_msgs.msg import JointState, MultiDOFJointState
from std_msgs.msg import Float64MultiArray, Header, MultiArrayDimension, MultiArrayLayout

from mbd_sim.geometry.pose import Array, unpack_poses
from mbd_sim.geometry.rotation import quaternions
from mbd_sim.mechanism.records import GROUND
from mbd_sim.ros.message_template import STAMP, MessageTemplate, slot
from mbd_sim.ros.message_types import message_type
from mbd_sim.ros.snapshots import Snapshot
from mbd_sim.simulation.compiled_model import Energies, Model, Violation
from mbd_sim.simulation.joint_state_layout import joint_state_arrays, joint_state_names

TF_MESSAGE = "tf2_msgs/msg/TFMessage"  # of a package that the ROS wheels lack: imported only on request


class StateWriter(NamedTuple):
    """A message, and the function that writes a snapshot with its energies into it."""

    template: MessageTemplate
    write: Callable[[Snapshot, Energies], None]

    def payload(self, snapshot: Snapshot, energies: Energies) -> bytes:
        """The serialized message of a snapshot."""
        self.write(snapshot, energies)
        self.template.stamp(snapshot.clock_ns)
        return self.template.payload()


def joint_states(model: Model) -> StateWriter:
    """Positions, velocities and efforts; driven coordinates come last, with the force of their drive as effort."""
    names = list(joint_state_names(model))
    rows = [[slot(row)] + [0.0] * (len(names) - 1) if names else [] for row in range(3)]
    header = Header(stamp=STAMP)
    message = JointState(header=header, name=names, position=rows[0], velocity=rows[1], effort=rows[2])
    template = MessageTemplate(message)
    position, velocity, effort = (template.doubles(row, len(names)) for row in range(3))

    def write(snapshot: Snapshot, energies: Energies) -> None:
        position[:], velocity[:], effort[:] = joint_state_arrays(model, snapshot.time, snapshot.y, snapshot.inputs)

    return StateWriter(template, write)


def energies(model: Model) -> StateWriter:
    """The energy audit in J, labeled."""
    template, values = labeled_array(Energies._fields)

    def write(snapshot: Snapshot, energies: Energies) -> None:
        values[:] = energies

    return StateWriter(template, write)


def constraint_violation(model: Model) -> StateWriter:
    """The largest violation of loops and constraints, in position and in velocity."""
    template, values = labeled_array(Violation._fields)

    def write(snapshot: Snapshot, energies: Energies) -> None:
        values[:] = model.violation(snapshot.time, snapshot.y, snapshot.inputs)

    return StateWriter(template, write)


def joint_reactions(model: Model, frame_prefix: str) -> StateWriter:
    """The force and moment of each joint on its second part, in ground's axes, in the field `wrench`."""
    names = list(model.mechanism.all_joints)
    wrenches = [Wrench(force=Vector3(x=slot(index))) for index in range(len(names))]
    header = Header(stamp=STAMP, frame_id=frame_prefix + GROUND)
    template = MessageTemplate(MultiDOFJointState(header=header, joint_names=names, wrench=wrenches))
    rows = [template.doubles(index, 6) for index in range(len(names))]

    def write(snapshot: Snapshot, energies: Energies) -> None:
        reactions = model.reactions(snapshot.time, snapshot.y, snapshot.inputs)
        for row, reaction in zip(rows, reactions.values(), strict=True):
            row[:3], row[3:] = reaction.force, reaction.moment

    return StateWriter(template, write)


def part_pose(model: Model, frame_prefix: str, part: str) -> StateWriter:
    """The pose of one part in ground's frame."""
    pose = Pose(position=Point(x=slot(0)))
    template = MessageTemplate(PoseStamped(header=Header(stamp=STAMP, frame_id=frame_prefix + GROUND), pose=pose))
    values, index = template.doubles(0, 7), model.part_names.index(part)

    def write(snapshot: Snapshot, energies: Energies) -> None:
        values[:] = ros_poses(model.pose_array(snapshot.time, snapshot.y, snapshot.inputs))[index]

    return StateWriter(template, write)


def transforms(model: Model, frame_prefix: str) -> StateWriter:
    """The transform from ground to each part.

    :raises ImportError: tf2_msgs is not installed.
    """
    header = Header(stamp=STAMP, frame_id=frame_prefix + GROUND)
    stamped = [
        TransformStamped(
            header=header, child_frame_id=frame_prefix + part, transform=Transform(translation=Vector3(x=slot(index)))
        )
        for index, part in enumerate(model.part_names)
    ]
    template = MessageTemplate(message_type(TF_MESSAGE)(transforms=stamped))
    rows = [template.doubles(index, 7) for index in range(len(stamped))]

    def write(snapshot: Snapshot, energies: Energies) -> None:
        poses = ros_poses(model.pose_array(snapshot.time, snapshot.y, snapshot.inputs))
        for row, values in zip(rows, poses, strict=True):
            row[:] = values

    return StateWriter(template, write)


def ros_poses(poses: Array) -> Array:
    """(n, 7): positions and quaternions (x, y, z, w) in ROS order, from the pose rows (n, 12) of `Model.pose_array`."""
    positions, rotations = unpack_poses(poses)
    return np.hstack([positions, quaternions(rotations)])


def labeled_array(labels: Sequence[str]) -> tuple[MessageTemplate, Array]:
    """An array message whose dimensions carry labels, as Rerun and PlotJuggler plot it, and a view of its numbers."""
    layout = MultiArrayLayout(dim=[MultiArrayDimension(label=label, size=1, stride=1) for label in labels])
    data = [slot(0)] + [0.0] * (len(labels) - 1) if labels else []
    template = MessageTemplate(Float64MultiArray(layout=layout, data=data))
    return template, template.doubles(0, len(labels))
