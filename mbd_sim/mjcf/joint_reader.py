"""Joints of an MJCF as joints of a mechanism file.

A joint of MuJoCo is placed in the frame of its body, and moves it from where it is at `ref`. The coordinates here are
MuJoCo's: at `ref`, the body has the pose that the file gives.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.geometry.rotation import about, unit
from mbd_sim.mjcf.body_tree import Body, Placed
from mbd_sim.mjcf.compiler_options import Context
from mbd_sim.mjcf.geoms import rotated
from mbd_sim.mjcf.items import Item
from mbd_sim.urdf.value_reader import rows

TYPES = {"hinge": "revolute", "slide": "prismatic", "ball": "spherical", "free": "free"}
SINGLE = ("hinge", "slide")  # one coordinate


@dataclass(frozen=True, eq=False)
class BodyJoint:
    """A joint of a body: its kind in MJCF, the frames at which it acts in both parts, its record without `between`.

    `anchor` is its frame in the body, `base` that on the other side, in the body's frame where it is at `ref`.
    """

    item: Item
    name: str
    kind: str
    anchor: Pose
    base: Pose
    record: dict[str, Any]
    ref: float = 0.0

    @property
    def single(self) -> bool:
        """Whether it has one coordinate, which has its name."""
        return self.kind in SINGLE


def joint_of(context: Context, body: Body, placed: Placed, disabled: frozenset[str]) -> BodyJoint:
    """The joint of an element; `disabled` are the forces that `<flag>` turns off."""
    item = placed.item
    kind = "free" if item.element.tag == "freejoint" else item.choice("type", TYPES, "hinge")
    if kind == "free":
        if body.parent != 0 or len(body.joints) > 1:
            message = "a free joint must be the only one of its body, and the body must be in the world"
            item.report("", message, "Move the body, or use slides and a ball.")
        return BodyJoint(item, placed.name, kind, Pose(np.zeros(3), np.eye(3)), body.pose, _free(item, body, disabled))
    position = placed.frame.position + placed.frame.rotation @ np.array(item.numbers("pos", 3) or [0.0, 0.0, 0.0])
    anchor = Pose(position, np.eye(3))
    if kind == "ball":
        return BodyJoint(item, placed.name, kind, anchor, anchor, _ball(item, disabled))
    axis = _axis(item, placed.frame.rotation)
    scale = context.compiler.angle if kind == "hinge" else 1.0
    ref = scale * item.number("ref")
    back = Pose(np.zeros(3), about(axis, -ref)) if kind == "hinge" else Pose(-ref * axis, np.eye(3))
    record = _single(context, item, kind, axis, scale, ref, disabled)
    return BodyJoint(item, placed.name, kind, anchor, anchor @ back, record, ref)


def _axis(item: Item, frame: Array) -> Array:
    axis = np.array(item.numbers("axis", 3) or [0.0, 0.0, 1.0])
    if not np.any(axis):
        item.report("axis", "must not be zero", "Write for example 0 0 1.")
        return np.array([0.0, 0.0, 1.0])
    return frame @ unit(axis)


def _single(
    context: Context, item: Item, kind: str, axis: Array, scale: float, ref: float, disabled: frozenset[str]
) -> dict[str, Any]:
    record: dict[str, Any] = {"type": TYPES[kind], "axis": rows(axis)}
    if ref:
        record["position"] = ref
    if (stiffness := item.number_from_zero("stiffness")) and "spring" not in disabled:
        rest = scale * item.number("springref")
        record |= {"stiffness": stiffness} | ({"rest": rest} if rest else {})
    if (damping := item.number_from_zero("damping")) and "damper" not in disabled:
        record["damping"] = damping
    if (friction := item.number_from_zero("frictionloss")) and "frictionloss" not in disabled:
        record["friction"] = {"coulomb": friction}
    if item.limited("limited", "range", context.compiler.autolimits) and "limit" not in disabled:
        lower, upper = (scale * value for value in item.numbers("range", 2) or [0.0, 0.0])
        if lower < upper:
            record["limits"] = {"lower": lower, "upper": upper}
        else:
            item.report("range" if item.has("range") else "", "has no lower limit below an upper one", "Give 'range'.")
    return record


def _ball(item: Item, disabled: frozenset[str]) -> dict[str, Any]:
    record: dict[str, Any] = {"type": "spherical"}
    if (stiffness := item.number_from_zero("stiffness")) and "spring" not in disabled:
        record["stiffness"] = stiffness
    if (damping := item.number_from_zero("damping")) and "damper" not in disabled:
        record["damping"] = damping
    _omit(item, "frictionloss", "range", "armature")
    return record


def _free(item: Item, body: Body, disabled: frozenset[str]) -> dict[str, Any]:
    record: dict[str, Any] = {"type": "free"}
    pose = ({"at": rows(body.pose.position)} if np.any(body.pose.position) else {}) | rotated(body.pose)
    if "at" in pose:
        record["position"] = pose["at"]
    if "rotate" in pose:
        record["orientation"] = pose["rotate"]
    if item.element.tag == "freejoint":
        return record
    if (stiffness := item.number_from_zero("stiffness")) and "spring" not in disabled:
        record |= {"stiffness": [stiffness] * 6} | ({"rest": pose} if pose else {})
    if (damping := item.number_from_zero("damping")) and "damper" not in disabled:
        record["damping"] = [damping] * 6
    _omit(item, "frictionloss", "armature")
    return record


def _omit(item: Item, *names: str) -> None:
    """Note attributes that the joint has and cannot have here."""
    for name in names:
        limited = name != "range" or item.text("limited", "auto") != "false"
        if item.has(name) and limited and any(item.numbers(name, 1, 2) or ()):
            item.leave_out(f"{name} of ball and free joints")
