"""The start of a mechanism as a keyframe of an MJCF."""

from __future__ import annotations

import numpy as np

from mbd_sim.dynamics.equations import Equations, derive
from mbd_sim.errors import MechanismError
from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.geometry.rotation import from_quaternion, to_quaternion
from mbd_sim.mjcf.mjcf_document import Document, add_element, text
from mbd_sim.mjcf.written_bodies import WrittenBody, WrittenJoint, lead_per_radian


def add_start(document: Document) -> None:
    """Write the assembled start as the keyframe `start`, unless the mechanism has no equations of motion."""
    try:
        equations = derive(document.mechanism)
    except MechanismError:
        document.leave_out("start", "there are no equations of motion")
        return
    q, u, layout = equations.start.q, equations.start.u, equations.layout
    positions, speeds = [], []
    for body in document.bodies.values():
        for written in body.joints:
            name = written.joint.name
            if written.joint.drive:
                position, speed = np.zeros(_size(written)), np.zeros(_size(written) - (not written.single))
            else:
                position, speed = _values(body, written, q[layout.q[name]], u[layout.u[name]])
            positions.append(position)
            speeds.append(speed)
    if positions:
        values = {"qpos": text(np.concatenate(positions)), "qvel": text(np.concatenate(speeds))}
        if commands := _commands(document, equations):
            values["ctrl"] = text(np.array(commands))
        add_element(document.section("keyframe"), "key", {"name": "start", **values})


def _commands(document: Document, equations: Equations) -> list[float]:
    """The first command of each actuator that is written, before others arrive."""
    inputs, span = equations.inputs_without_commands, equations.inputs.commands
    first, found = span.start, {}
    for taker in document.mechanism.commanded:
        found[taker.name] = float(inputs[first])
        first += len(taker.channels)
    return [found[element.attrib["name"]] for element in document.root.findall("actuator/*")]


def _size(written: WrittenJoint) -> int:
    return {"ball": 4, "free": 7}.get(written.kind, 1)


def _values(body: WrittenBody, written: WrittenJoint, q: Array, u: Array) -> tuple[Array, Array]:
    """qpos and qvel of a joint of MuJoCo, from the coordinates and speeds of ours."""
    joint = written.joint
    if written.single:
        factor = lead_per_radian(joint) if written.name == f"{joint.name}.travel" else 1.0
        index = written.index
        return factor * q[index : index + 1], factor * u[index : index + 1]
    turn, spin = from_quaternion(q[-4:]), u[-3:]
    if joint.reversed:
        turn, spin = turn.T, -turn @ spin
    axes = written.frame.rotation
    if written.kind == "ball":
        return to_quaternion(axes @ turn @ axes.T), axes @ spin
    inner = written.frame.inverse()  # the body in the second frame of the joint
    base = joint.parent_pose
    pose = base @ Pose(q[:3], turn) @ inner
    velocity = base.rotation @ (u[:3] + turn @ np.cross(spin, inner.position))
    return np.concatenate([pose.position, to_quaternion(pose.rotation)]), np.concatenate([velocity, axes @ spin])
