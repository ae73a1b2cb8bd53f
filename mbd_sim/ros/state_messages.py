"""The messages that tell a state: joints and energies always; reactions, violations and poses where asked for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from geometry_msgs.msg import Point, Pose, PoseStamped, Vector3, Wrench
from rclpy.node import Node
from sensor_msgs.msg import JointState, MultiDOFJointState
from std_msgs.msg import Float64MultiArray, Header, MultiArrayDimension, MultiArrayLayout

from mbd_sim.geometry.pose import Array, unpack_poses
from mbd_sim.geometry.rotation import quaternions
from mbd_sim.mechanism.records import GROUND
from mbd_sim.ros import qos
from mbd_sim.ros.message_template import STAMP, Template, slot
from mbd_sim.ros.publisher import Output
from mbd_sim.ros.snapshots import Snapshot
from mbd_sim.ros.topic_names import topic_names
from mbd_sim.simulation.compiled_model import Energies, Model, Violation
from mbd_sim.simulation.joint_state_layout import joint_state_arrays, joint_state_names


class Telling(NamedTuple):
    """A topic, and what writes a snapshot into its message."""

    output: Output
    template: Template
    write: Callable[[Snapshot], object]


def joint_states(node: Node, model: Model) -> Telling:
    """Positions, velocities and efforts; the driven coordinates come last, with the force of their drive."""
    names = joint_state_names(model)
    first = [[slot(row)] + [0.0] * (len(names) - 1) if names else [] for row in range(3)]
    header = Header(stamp=STAMP)
    template = Template(
        JointState(header=header, name=list(names), position=first[0], velocity=first[1], effort=first[2])
    )
    position, velocity, effort = (template.doubles(row, len(names)) for row in range(3))

    def write(snapshot: Snapshot) -> None:
        position[:], velocity[:], effort[:] = joint_state_arrays(model, snapshot.time, snapshot.y, snapshot.inputs)

    return Telling(Output(node, JointState, "joint_states", qos.STATE), template, write)


def energies(node: Node, model: Model) -> Telling:
    """The energy audit; `write` returns it."""
    template, values = labelled(Energies._fields)

    def write(snapshot: Snapshot) -> Energies:
        found = model.energies(snapshot.time, snapshot.y, snapshot.start_energy, snapshot.inputs)
        values[:] = found
        return found

    return Telling(Output(node, Float64MultiArray, "energies", qos.STATE), template, write)


def constraint_violation(node: Node, model: Model) -> Telling:
    """How far loops and constraints are off, in position and in velocity."""
    template, values = labelled(Violation._fields)

    def write(snapshot: Snapshot) -> None:
        values[:] = model.violation(snapshot.time, snapshot.y, snapshot.inputs)

    return Telling(Output(node, Float64MultiArray, "constraint_violation", qos.STATE), template, write)


def joint_reactions(node: Node, model: Model, prefix: str) -> Telling:
    """The force and moment through each joint, on its second part, in ground's axes: in the field `wrench`."""
    names = list(model.mechanism.all_joints)
    wrenches = [Wrench(force=Vector3(x=slot(index))) for index in range(len(names))]
    message = MultiDOFJointState(
        header=Header(stamp=STAMP, frame_id=prefix + GROUND), joint_names=names, wrench=wrenches
    )
    template = Template(message)
    rows = [template.doubles(index, 6) for index in range(len(names))]

    def write(snapshot: Snapshot) -> None:
        found = model.reactions(snapshot.time, snapshot.y, snapshot.inputs)
        for row, reaction in zip(rows, found.values(), strict=True):
            row[:3], row[3:] = reaction.force, reaction.moment

    return Telling(Output(node, MultiDOFJointState, "joint_reactions", qos.STATE), template, write)


def part_poses(node: Node, model: Model, parts: Sequence[str], prefix: str) -> list[Telling]:
    """The pose of each of some parts in ground's frame, on a topic of its own."""
    topics = topic_names(model.part_names)
    return [_part_pose(node, model, name, f"~/poses/{topics[name]}", prefix) for name in parts]


def _part_pose(node: Node, model: Model, name: str, topic: str, prefix: str) -> Telling:
    pose = Pose(position=Point(x=slot(0)))
    template = Template(PoseStamped(header=Header(stamp=STAMP, frame_id=prefix + GROUND), pose=pose))
    values, index = template.doubles(0, 7), model.part_names.index(name)

    def write(snapshot: Snapshot) -> None:
        values[:] = placed(model.pose_array(snapshot.time, snapshot.y, snapshot.inputs))[index]

    return Telling(Output(node, PoseStamped, topic, qos.STATE), template, write)


def placed(poses: Array) -> Array:
    """(n, 7): position and quaternion (x, y, z, w), as ROS has them, of rows (n, 12) of `Model.pose_array`."""
    positions, rotations = unpack_poses(poses)
    return np.hstack([positions, quaternions(rotations)])


def labelled(labels: Sequence[str]) -> tuple[Template, Array]:
    """An array of numbers whose dimensions carry their names, as Rerun and PlotJuggler plot it; and its numbers."""
    layout = MultiArrayLayout(dim=[MultiArrayDimension(label=label, size=1, stride=1) for label in labels])
    data = [slot(0)] + [0.0] * (len(labels) - 1) if labels else []
    template = Template(Float64MultiArray(layout=layout, data=data))
    return template, template.doubles(0, len(labels))
