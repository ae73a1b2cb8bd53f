"""From a joint as written in a file to the record that the dynamics reads."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbd_sim.geometry import rotation as rot
from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.mechanism.expression import TimeExpression
from mbd_sim.mechanism.joint_types import JOINT_KINDS
from mbd_sim.mechanism.records import Joint, Limits
from mbd_sim.mechanism_file.builders.law_builder import damper_of, friction_of, law_of
from mbd_sim.mechanism_file.builders.rotation_builder import rotation_matrix
from mbd_sim.mechanism_file.schema import joint_schema as schema
from mbd_sim.mechanism_file.schema.base_schema import RotationSpec

PARALLEL = 1e-6  # sine of the angle below which two axes count as parallel


def joint_of(
    name: str, record: schema.AnyJointSpec, parent: str, parent_pose: Pose, child: str, child_pose: Pose
) -> Joint:
    """The joint between two placed frames."""
    count = JOINT_KINDS[record.type].nv
    axis, second = _axes(record)
    position, velocity = _start(record)
    limits, drive = getattr(record, "limits", None), getattr(record, "drive", None)
    return Joint(
        name=name,
        type=record.type,
        parent=parent,
        child=child,
        parent_pose=parent_pose,
        child_pose=child_pose,
        axis=axis,
        second=second,
        position=np.zeros(0) if drive else position,
        velocity=np.zeros(0) if drive else velocity,
        stiffness=_each(record, "stiffness", count),
        rest=_each(record, "rest", count),
        damping=_each(record, "damping", count),
        lead=getattr(record, "lead", 0.0),
        drive=_expressions(drive),
        limits=Limits(limits.lower, limits.upper, limits.stiffness, limits.damping) if limits else None,
        effort_limit=getattr(record, "effort_limit", None),
        velocity_limit=getattr(record, "velocity_limit", None),
        spring=law_of(found) if (found := getattr(record, "spring", None)) else None,
        damper=damper_of(found) if (found := getattr(record, "damper", None)) else None,
        friction=friction_of(found) if (found := getattr(record, "friction", None)) else None,
        fixed_in_assembly=() if drive else _given(record, count, "position", "orientation", not record.guess),
        fixed_speeds=() if drive else _given(record, count, "velocity", "angular_velocity", True),
        cut=record.cut,
    )


def parallel(first: tuple[float, ...], second: tuple[float, ...]) -> str:
    """That two directions are parallel, or ""."""
    sine = float(np.linalg.norm(np.cross(rot.unit(first), rot.unit(second))))
    return "the two directions are parallel" if sine < PARALLEL else ""


def _axes(record: schema.AnyJointSpec) -> tuple[Array, Array]:
    match record:
        case schema.UniversalJointSpec(axes=(first, second)):
            return rot.unit(first), rot.unit(second)
        case schema.PlanarJointSpec(axis=normal, x_axis=x_axis):
            axis = rot.unit(normal)
            if x_axis is None:
                return axis, rot.aligning_z(axis)[:, 0]
            along = rot.unit(x_axis)
            return axis, rot.unit(along - axis * (axis @ along))
        case schema.SphericalJointSpec() | schema.FixedJointSpec() | schema.FreeJointSpec():
            return np.zeros(3), np.zeros(3)
    return rot.unit(record.axis), np.zeros(3)


def _start(record: schema.AnyJointSpec) -> tuple[Array, Array]:
    match record:
        case schema.FixedJointSpec():
            return np.zeros(0), np.zeros(0)
        case schema.SphericalJointSpec():
            return _quaternion(record.orientation), np.array(record.angular_velocity)
        case schema.FreeJointSpec():
            position = np.concatenate([np.array(record.position), _quaternion(record.orientation)])
            return position, np.array([*record.velocity, *record.angular_velocity])
    return np.atleast_1d(np.array(record.position)), np.atleast_1d(np.array(record.velocity))


def _given(record: schema.AnyJointSpec, count: int, linear: str, angular: str, fixed: bool) -> tuple[bool, ...]:
    """For each degree of freedom, whether its start value is given and the assembly must keep it."""
    written = record.model_fields_set
    if isinstance(record, schema.FreeJointSpec):
        return (fixed and linear in written,) * 3 + (fixed and angular in written,) * 3
    return (fixed and bool({linear, angular} & written),) * count


def _quaternion(orientation: RotationSpec | None) -> Array:
    return rot.to_quaternion(rotation_matrix(orientation))


def _each(record: schema.AnyJointSpec, key: str, count: int) -> Array:
    """A value for each degree of freedom, of a list, of one number for all, or 0."""
    return np.array(np.broadcast_to(np.array(getattr(record, key, 0.0), dtype=float), (count,)))


def _expressions(drive: Any) -> tuple[TimeExpression, ...]:
    if drive is None:
        return ()
    return tuple(drive) if isinstance(drive, tuple) else (drive,)
