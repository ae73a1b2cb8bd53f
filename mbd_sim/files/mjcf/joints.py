"""The joints of a compiled MJCF.

A joint of MuJoCo is placed in the frame of its body, and moves it from where it is at `ref`. The coordinates here are
MuJoCo's: at `ref`, the body has the pose that the file gives.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mbd_sim.base.geometry.pose import Pose
from mbd_sim.base.geometry.rotation import about, to_quaternion
from mbd_sim.files.mjcf.compiled_model import CompiledModel
from mbd_sim.files.xml.reading import rows

FREE, BALL, SLIDE, HINGE = range(4)  # mjtJoint
SINGLE = (SLIDE, HINGE)
TYPES = {FREE: "free", BALL: "spherical", SLIDE: "prismatic", HINGE: "revolute"}


def joint_record(model: CompiledModel, joint: int, place: Pose) -> tuple[dict[str, Any], Pose, Pose]:
    """The record of a joint without `between`, its frame on the inner part, and that on the outer one.

    :param place: the pose of the outer part in the inner one, at `ref`.
    """
    m, kind = model.m, int(model.m.jnt_type[joint])
    record: dict[str, Any] = {"type": TYPES[kind]}
    still = np.eye(3)
    anchor = Pose(m.jnt_pos[joint].copy(), still)
    if kind == FREE:
        position, turned = rows(place.position), {"quaternion": rows(to_quaternion(place.rotation))}
        record |= (
            {"position": position, "orientation": turned} if np.any(place.rotation != still) or any(position) else {}
        )
        pose_at_rest = {"at": position, "rotate": turned}
        if stiffness := _stiffness(model, joint):
            record |= {"stiffness": [stiffness] * 6, "rest": pose_at_rest}
        if damping := _damping(model, joint):
            record["damping"] = [damping] * 6
        return record, Pose(np.zeros(3), still), Pose(np.zeros(3), still)
    if kind == BALL:
        if stiffness := _stiffness(model, joint):
            record["stiffness"] = stiffness
        if damping := _damping(model, joint):
            record["damping"] = damping
        if m.jnt_limited[joint] and not model.disabled("LIMIT"):
            model.leave_out("ranges of ball joints, past which they turn here", "joint", joint)
        return record, place @ anchor, anchor
    axis, ref = m.jnt_axis[joint].copy(), float(m.qpos0[m.jnt_qposadr[joint]])
    record["axis"] = rows(axis)
    _add_single(model, joint, record, ref)
    back = Pose(np.zeros(3), about(axis, -ref)) if kind == HINGE else Pose(-ref * axis, still)
    return record, place @ anchor @ back, anchor


def _add_single(model: CompiledModel, joint: int, record: dict[str, Any], ref: float) -> None:
    m, dof = model.m, int(model.m.jnt_dofadr[joint])
    if ref:
        record["position"] = ref
    if stiffness := _stiffness(model, joint):
        rest = float(m.qpos_spring[m.jnt_qposadr[joint]])
        record |= {"stiffness": stiffness} | ({"rest": rest} if rest else {})
    if damping := _damping(model, joint):
        record["damping"] = damping
    if (friction := float(m.dof_frictionloss[dof])) and not model.disabled("FRICTIONLOSS"):
        record["friction"] = {"coulomb": friction}
    lower, upper = map(float, m.jnt_range[joint])
    if m.jnt_limited[joint] and not model.disabled("LIMIT") and lower < upper:
        record["limits"] = {"lower": lower, "upper": upper}


def _stiffness(model: CompiledModel, joint: int) -> float:
    """The linear stiffness, unless it is negative or a polynomial, which become forces."""
    linear = float(model.m.jnt_stiffness[joint])
    return 0.0 if model.disabled("SPRING") or has_spring_force(model, joint) else linear


def _damping(model: CompiledModel, joint: int) -> float:
    linear = float(model.m.dof_damping[model.m.jnt_dofadr[joint]])
    return 0.0 if model.disabled("DAMPER") or linear < 0.0 else linear


def has_spring_force(model: CompiledModel, joint: int) -> bool:
    """Whether the spring of a joint is one that its record cannot express."""
    return bool(model.m.jnt_stiffness[joint] < 0.0 or np.any(model.m.jnt_stiffnesspoly[joint]))
