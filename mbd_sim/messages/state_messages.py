"""The messages that are published with each state; the table in `topics` says which of them are always published."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mbd_sim.geometry.pose import Array, identity_pose, unpack_poses
from mbd_sim.geometry.rotation import quaternions
from mbd_sim.mechanism.records import GROUND
from mbd_sim.messages.serialized_message import MessageBuilder, SerializedMessage
from mbd_sim.messages.snapshot import Snapshot
from mbd_sim.simulation.compiled_model import Model
from mbd_sim.simulation.joint_state_layout import joint_state_arrays, joint_state_names
from mbd_sim.simulation.state_records import Energies, Violation
from mbd_sim.urdf.urdf_writer import floating_joints


@dataclass(frozen=True, slots=True)
class StateWriter:
    """A message, and the function that writes a snapshot with its energies into it."""

    message: SerializedMessage
    write: Callable[[Snapshot, Energies], None]

    def payload(self, snapshot: Snapshot, energies: Energies) -> bytes:
        """The serialized message of a snapshot."""
        self.write(snapshot, energies)
        self.message.stamp(snapshot.clock_ns)
        return self.message.payload()


def joint_states(model: Model) -> StateWriter:
    """Positions, velocities and efforts; driven coordinates come last, with the force of their drive as effort."""
    names = joint_state_names(model)
    builder = MessageBuilder()
    builder.header()
    builder.texts(names)
    places = [builder.sequence(len(names)) for _ in range(3)]
    message = builder.message()
    position, velocity, effort = (message.view(place) for place in places)

    def write(snapshot: Snapshot, energies: Energies) -> None:
        position[:], velocity[:], effort[:] = joint_state_arrays(
            model, snapshot.time, snapshot.point.state, snapshot.point.inputs
        )

    return StateWriter(message, write)


def energies(model: Model) -> StateWriter:
    """The energy audit in J, labeled."""
    message, values = labeled_array(Energies._fields)

    def write(snapshot: Snapshot, energies: Energies) -> None:
        values[:] = energies

    return StateWriter(message, write)


def energy_values(model: Model) -> StateWriter:
    """The energy audit in J as positions by name, with a stamp: tools plot joint states by name, but not arrays."""
    builder = MessageBuilder()
    builder.header()
    builder.texts(Energies._fields)
    place = builder.sequence(len(Energies._fields))
    builder.integer(0)  # no velocities,
    builder.integer(0)  # no efforts
    message = builder.message()
    values = message.view(place)

    def write(snapshot: Snapshot, energies: Energies) -> None:
        values[:] = energies

    return StateWriter(message, write)


def constraint_violation(model: Model) -> StateWriter:
    """The largest violation of loops and constraints, in position and in velocity."""
    message, values = labeled_array(Violation._fields)

    def write(snapshot: Snapshot, energies: Energies) -> None:
        values[:] = model.violation(snapshot.time, snapshot.point.state, snapshot.point.inputs)

    return StateWriter(message, write)


def contact_states(model: Model) -> StateWriter:
    """One-sided elements and compliant contacts: gap, its rate and the normal force as position, velocity and effort.

    After each element that has friction comes an entry for each direction of that: its position is 1 while the contact
    slides, its velocity the slip and its effort the friction.
    """
    names = model.contact_entry_names()
    builder = MessageBuilder()
    builder.header()
    builder.texts(names)
    places = [builder.sequence(len(names)) for _ in range(3)]
    message = builder.message()
    columns = [message.view(place) for place in places]

    def write(snapshot: Snapshot, energies: Energies) -> None:
        rows = model.contact_entries(snapshot.time, snapshot.point.state, snapshot.point.inputs)
        for column, values in zip(columns, np.array(rows).reshape(-1, 3).T, strict=True):
            column[:] = values

    return StateWriter(message, write)


def joint_reactions(model: Model, frame_prefix: str) -> StateWriter:
    """The force and moment of each joint on its second part, in ground's axes, in the field `wrench`."""
    names = list(model.mechanism.all_joints)
    builder = MessageBuilder()
    builder.header(frame_prefix + GROUND)
    builder.texts(names)
    builder.integer(0)  # no transforms,
    builder.integer(0)  # no twists
    builder.integer(len(names))
    places = [builder.doubles(6) for _ in names]
    message = builder.message()
    rows = [message.view(place) for place in places]

    def write(snapshot: Snapshot, energies: Energies) -> None:
        reactions = model.reactions(snapshot.time, snapshot.point.state, snapshot.point.inputs)
        for row, reaction in zip(rows, reactions.values(), strict=True):
            row[:3], row[3:] = reaction.force, reaction.moment

    return StateWriter(message, write)


class SharedPoses:
    """The poses of all parts in the last snapshot, for the messages of one thread."""

    def __init__(self) -> None:
        self._snapshot: Snapshot | None = None
        self._rows = np.empty((0, 7))

    def rows(self, model: Model, snapshot: Snapshot) -> Array:
        """(parts, 7): see `ros_poses`."""
        if snapshot is not self._snapshot:
            self._rows = ros_poses(model.pose_array(snapshot.time, snapshot.point.state, snapshot.point.inputs))
            self._snapshot = snapshot
        return self._rows


def part_pose(model: Model, frame_prefix: str, part: str, poses: SharedPoses) -> StateWriter:
    """The pose of one part in ground's frame."""
    builder = MessageBuilder()
    builder.header(frame_prefix + GROUND)
    place = builder.doubles(7)
    message = builder.message()
    values, index = message.view(place), model.part_names.index(part)

    def write(snapshot: Snapshot, energies: Energies) -> None:
        values[:] = poses.rows(model, snapshot)[index]

    return StateWriter(message, write)


def transforms(model: Model, frame_prefix: str) -> StateWriter:
    """The transform from ground to each part."""
    builder = MessageBuilder()
    builder.integer(len(model.part_names))
    places = []
    for part in model.part_names:
        builder.header(frame_prefix + GROUND)
        builder.text(frame_prefix + part)
        places.append(builder.doubles(7))
    message = builder.message()
    rows = [message.view(place) for place in places]

    def write(snapshot: Snapshot, energies: Energies) -> None:
        poses = ros_poses(model.pose_array(snapshot.time, snapshot.point.state, snapshot.point.inputs))
        for row, values in zip(rows, poses, strict=True):
            row[:] = values

    return StateWriter(message, write)


def floating_transforms(model: Model, frame_prefix: str) -> StateWriter:
    """The transforms of the floating joints of `robot_description`, which robot_state_publisher does not publish."""
    joints = floating_joints(model.mechanism)
    builder = MessageBuilder()
    builder.integer(len(joints))
    places = []
    for joint in joints:
        builder.header(frame_prefix + joint.parent)
        builder.text(frame_prefix + joint.child)
        places.append(builder.doubles(7))
    message = builder.message()
    rows = [message.view(place) for place in places]

    def write(snapshot: Snapshot, energies: Energies) -> None:
        poses = {**model.poses(snapshot.time, snapshot.point.state, snapshot.point.inputs), GROUND: identity_pose()}
        for row, joint in zip(rows, joints, strict=True):
            pose = poses[joint.parent].inverse() @ poses[joint.part] @ joint.pose
            row[:3], row[3:] = pose.position, quaternions(pose.rotation[None])[0]

    return StateWriter(message, write)


def ros_poses(poses: Array) -> Array:
    """(n, 7): positions and quaternions (x, y, z, w) in ROS order, from the pose rows (n, 12) of `Model.pose_array`."""
    positions, rotations = unpack_poses(poses)
    return np.hstack([positions, quaternions(rotations)])


def labeled_array(labels: Sequence[str], sizes: Sequence[int] = ()) -> tuple[SerializedMessage, Array]:
    """An array message whose dimensions carry labels, as Rerun and PlotJuggler plot it, and a view of its numbers.

    :param sizes: how many numbers each label stands for; by default one.
    """
    sizes = sizes or [1] * len(labels)
    builder = MessageBuilder()
    builder.integer(len(labels))
    for label, size in zip(labels, sizes, strict=True):
        builder.text(label)
        builder.integer(size)
        builder.integer(1)  # stride
    builder.integer(0)  # offset of the data
    place = builder.sequence(sum(sizes))
    message = builder.message()
    return message, message.view(place)
