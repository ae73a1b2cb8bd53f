"""The messages that are published with each state, written from the state of a run at a tick.

The table in `topics` says which of them are always published. Accelerations are those of the coordinates, and of parts
and their points.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Flag, auto

import numpy as np

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array, Pose, identity_pose, unpack_poses
from mbd_sim.base.geometry.rotation import aligning_z, quaternions, to_quaternion
from mbd_sim.base.linear_algebra import cross
from mbd_sim.files.checks.override import with_values
from mbd_sim.files.urdf.writer import floating_joints
from mbd_sim.mechanism.elements.parts import GROUND
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.names import readings, reference
from mbd_sim.recordings.messages.cdr import MessageBuilder, SerializedMessage
from mbd_sim.simulation.kernel.sensors import Arrival
from mbd_sim.simulation.model.model import Model
from mbd_sim.simulation.model.state_records import Energies, Violation
from mbd_sim.simulation.run.moving_points import named_frame
from mbd_sim.simulation.run.run_point import RunPoint, joint_state_arrays, joint_state_names


class Due(Flag):
    """The messages that are due with a snapshot."""

    NONE = 0
    STATE = auto()
    CLOCK = auto()
    MARKERS = auto()
    VIEW = auto()  # the Rerun scene
    SENSORS = auto()
    RECORDING = auto()  # a recording begins, continues in another file, or ends here
    ALL = STATE | CLOCK | MARKERS | VIEW
    NEW = ALL | SENSORS  # of a state that has not been measured before


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The `point` of a run at a tick.

    `ticks` counts the steps since the node or the recording started, across resets. `clock_ns` is the simulated clock,
    `time` the mechanism's time in s. `repeated` says that nothing has changed since the last snapshot.
    `arrivals` are measurements of sensors that arrive at this tick. `taken` is the time in s of the steady clock, where
    a state that is published late may be left out for a newer one; infinite, where all are published.
    """

    ticks: int
    clock_ns: int
    time: float
    point: RunPoint
    due: Due = Due.STATE
    repeated: bool = False
    arrivals: Sequence[Arrival] = ()
    taken: float = math.inf

    @property
    def now(self) -> tuple[float, Array, Array]:
        """Time, state and inputs, as the readings of a `Model` take them."""
        return self.time, self.point.state, self.point.inputs


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


def _joint_state(names: Sequence[str], columns: int = 3) -> tuple[SerializedMessage, list[Array]]:
    """A `sensor_msgs/JointState` with its first columns filled: positions, velocities and efforts."""
    builder = MessageBuilder()
    builder.header()
    builder.texts(names)
    places = [builder.sequence(len(names) if column < columns else 0) for column in range(3)]
    message = builder.message()
    return message, [message.view(place) for place in places[:columns]]


def _transform_message(frames: Sequence[tuple[str, str]], frame_prefix: str) -> tuple[SerializedMessage, list[Array]]:
    """A `tf2_msgs/TFMessage` for pairs of a frame and one in it, and the pose (7,) of each."""
    builder = MessageBuilder()
    builder.integer(len(frames))
    places = []
    for parent, child in frames:
        builder.header(frame_prefix + parent)
        builder.text(frame_prefix + child)
        places.append(builder.doubles(7))
    message = builder.message()
    return message, [message.view(place) for place in places]


def joint_states(model: Model, frame_prefix: str = "") -> StateWriter:
    """Positions, velocities and efforts; driven coordinates come last, with the force of their drive as effort."""
    message, (position, velocity, effort) = _joint_state(joint_state_names(model))

    def write(snapshot: Snapshot, energies: Energies) -> None:
        position[:], velocity[:], effort[:] = joint_state_arrays(model, *snapshot.now)

    return StateWriter(message, write)


def energies(model: Model, frame_prefix: str = "") -> StateWriter:
    """The energy audit in J, labeled."""
    message, values = labeled_array(Energies._fields)

    def write(snapshot: Snapshot, energies: Energies) -> None:
        values[:] = energies

    return StateWriter(message, write)


def energy_values(model: Model, frame_prefix: str = "") -> StateWriter:
    """The energy audit in J as positions by name, with a stamp: tools plot joint states by name, but not arrays."""
    message, (values,) = _joint_state(Energies._fields, columns=1)

    def write(snapshot: Snapshot, energies: Energies) -> None:
        values[:] = energies

    return StateWriter(message, write)


def constraint_violation(model: Model, frame_prefix: str = "") -> StateWriter:
    """The largest violation of loops and constraints, in position and in velocity."""
    message, values = labeled_array(Violation._fields)

    def write(snapshot: Snapshot, energies: Energies) -> None:
        values[:] = model.violation(*snapshot.now)

    return StateWriter(message, write)


def contact_states(model: Model, frame_prefix: str = "") -> StateWriter:
    """One-sided elements and compliant contacts: gap, its rate and the normal force as position, velocity and effort.

    After each element that has friction comes an entry for each direction of that: its position is 1 while the contact
    slides, its velocity the slip and its effort the friction.
    """
    message, columns = _joint_state(model.contact_readings.entry_names())

    def write(snapshot: Snapshot, energies: Energies) -> None:
        rows = model.contact_readings.entries(*snapshot.now)
        for column, values in zip(columns, np.array(rows).reshape(-1, 3).T, strict=True):
            column[:] = values

    return StateWriter(message, write)


def contact_forces(model: Model, frame_prefix: str) -> StateWriter:
    """Each contact that has a place, in ground's frame: where and along which normal it touches, and its force.

    The `transforms` have the points, and rotations that turn z into the normals; the `wrench` are the forces on the
    first part, zero while a contact is open.
    """
    names = model.contact_readings.placed_names()
    builder = MessageBuilder()
    builder.header(frame_prefix + GROUND)
    builder.texts(names)
    builder.integer(len(names))
    poses = [builder.doubles(7) for _ in names]
    builder.integer(0)  # no twists
    builder.integer(len(names))
    wrenches = [builder.doubles(6) for _ in names]
    message = builder.message()
    rows = [(message.view(pose), message.view(wrench)) for pose, wrench in zip(poses, wrenches, strict=True)]

    def write(snapshot: Snapshot, energies: Energies) -> None:
        places = model.contact_readings.places(*snapshot.now)
        for (pose, wrench), (point, force, normal) in zip(rows, places, strict=True):
            w, x, y, z = to_quaternion(aligning_z(normal))
            pose[:], wrench[:3] = (*point, x, y, z, w), force

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
        reactions = model.reactions(*snapshot.now)
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
            self._rows = ros_poses(model.pose_array(*snapshot.now))
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
    message, rows = _transform_message([(GROUND, part) for part in model.part_names], frame_prefix)

    def write(snapshot: Snapshot, energies: Energies) -> None:
        poses = ros_poses(model.pose_array(*snapshot.now))
        for row, values in zip(rows, poses, strict=True):
            row[:] = values

    return StateWriter(message, write)


def floating_transforms(model: Model, frame_prefix: str) -> StateWriter:
    """The transforms of the floating joints of `robot_description`, which robot_state_publisher does not publish."""
    joints = floating_joints(model.mechanism)
    message, rows = _transform_message([(joint.parent, joint.child) for joint in joints], frame_prefix)

    def write(snapshot: Snapshot, energies: Energies) -> None:
        poses = {**model.poses(*snapshot.now), GROUND: identity_pose()}
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


COORDINATES = "coordinates"  # stands for all coordinates
ALL = "*"


class AccelerationMessages:
    """The accelerations that are requested, as labels and numbers.

    With `coordinates` in the request, those of the joint states come first, in their order, m/s² or rad/s². The
    acceleration of each frame has three numbers, in m/s² and ground's axes.
    """

    def __init__(self, model: Model, requested: Sequence[str]) -> None:
        """Find what the names stand for: `coordinates`, parts, points as `part.point`; `*` are all of them.

        :raises InputError: there is no such part or point.
        """
        names = [COORDINATES, *_frames(model.mechanism)] if ALL in requested else list(dict.fromkeys(requested))
        self._model = model
        self.coordinates = joint_state_names(model) if COORDINATES in names else ()
        self._frames = [name for name in names if name != COORDINATES]
        self._live: Mapping[str, float] = {}
        self._place_frames(model.mechanism)

    @property
    def labels(self) -> tuple[str, ...]:
        """A label for each coordinate and each frame."""
        return (*self.coordinates, *self._frames)

    @property
    def sizes(self) -> list[int]:
        """How many numbers each label stands for."""
        return [1] * len(self.coordinates) + [3] * len(self._frames)

    def _place_frames(self, mechanism: Mechanism) -> None:
        """Find the number of each frame's part, and its origin (3,) in that part."""
        frames = [_moving_frame(mechanism, name) for name in self._frames]
        self._parts = [self._model.part_names.index(part) for part, _ in frames]
        self._origins = np.array([pose.position for _, pose in frames]).reshape(-1, 3)

    def write(self, values: Array, time: float, y: Array, inputs: Array, live: Mapping[str, float]) -> None:
        """Write the accelerations (n,) in a state; the places of points follow the live values by key."""
        if self._frames and live != self._live:
            self._live = live
            self._place_frames(with_values(self._model.mechanism, live))
        first = len(self.coordinates)
        if first:
            values[:first] = self._model.accelerations(time, y, inputs)
        if self._frames:
            _, rotations = unpack_poses(self._model.pose_array(time, y, inputs)[self._parts])
            arms = np.einsum("nij,nj->ni", rotations, self._origins)
            _, turning, acceleration, angular = self._model.motion_rows(time, y, inputs)[self._parts].swapaxes(0, 1)
            found = acceleration + cross(angular, arms) + cross(turning, cross(turning, arms))
            values[first:] = found.reshape(-1)


def accelerations(model: Model, frame_prefix: str, requested: Sequence[str]) -> StateWriter:
    """The requested accelerations, labeled: see `AccelerationMessages`.

    :raises InputError: there is no such part or point.
    """
    source = AccelerationMessages(model, requested)
    message, values = labeled_array(source.labels, source.sizes)

    def write(snapshot: Snapshot, energies: Energies) -> None:
        source.write(values, *snapshot.now, snapshot.point.live)

    return StateWriter(message, write)


def requested_by(model: Model, labels: Sequence[str]) -> list[str]:
    """The names that give a message these labels."""
    coordinates = joint_state_names(model)
    if labels and tuple(labels[: len(coordinates)]) == coordinates:
        return [COORDINATES, *labels[len(coordinates) :]]
    return list(labels)


def _frames(mechanism: Mechanism) -> list[str]:
    return [
        name
        for part in mechanism.parts.values()
        for name in (reference(part.name), *(reference(part.name, point) for point in part.points))
    ]


def _moving_frame(mechanism: Mechanism, name: str) -> tuple[str, Pose]:
    named = [first for first, _ in readings(name)]
    if any(one in mechanism.all_joints for one in named) and not any(one in mechanism.parts for one in named):
        raise InputError(f"'{name}' is a joint", f"Write '{COORDINATES}' for the accelerations of all joints.")
    part, pose = named_frame(mechanism, name)
    if part == GROUND:
        raise InputError(f"'{name}' is on ground, which does not move", "Name a part, or a point of one.")
    return part, pose
