"""Builds the joints of a mechanism from their records in the file, with their laws.

The laws are those of springs, dampers and friction.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, assert_never

import numpy as np

from mbd_sim.base.geometry import rotation as rot
from mbd_sim.base.geometry.batch import array
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.linear_algebra import norm, product
from mbd_sim.files.builders.bodies.shapes import rotation_matrix
from mbd_sim.files.builders.context import BuildContext, attachment
from mbd_sim.files.schema import joints as schema
from mbd_sim.files.schema import laws
from mbd_sim.files.schema.fields import RotationSpec
from mbd_sim.mechanism.elements.forces import Bushing
from mbd_sim.mechanism.elements.joint_types import JOINT_KINDS, CommandedDrive
from mbd_sim.mechanism.elements.parts import Joint, Limits
from mbd_sim.mechanism.values.expression import TimeExpression
from mbd_sim.mechanism.values.laws import ELONGATION, ElasticLaw, Expressed, Friction, PowerLaw, Varying
from mbd_sim.mechanism.values.source import Location
from mbd_sim.mechanism.values.tables import tabulated

LARGEST_ELONGATION = 20.0  # m or rad, up to which the potential of an expression is exact
REGULARIZATION_BELOW_ONE = 1e-2  # m/s or rad/s, of powers below 1, whose slope at rest is infinite
REGULARIZATION = 1e-30  # m/s or rad/s, of all other powers: none but for the derivatives at rest


def build_elastic_law(spec: laws.ForceCurveSpec | laws.TorqueCurveSpec) -> ElasticLaw | Varying:
    """The law of a spring in a joint."""
    return build_curve(spec.force, spec.table, -LARGEST_ELONGATION, LARGEST_ELONGATION)


def build_curve(
    force: TimeExpression | None, table: list[tuple[float, float]] | None, lower: float, upper: float
) -> ElasticLaw | Varying:
    """The law of an expression, or else of a table; the expression's potential is exact from `lower` to `upper`."""
    if force is not None and force.variables - {ELONGATION}:
        return Varying(force)
    if force is not None:
        return Expressed(force, lower, upper)
    elongations, forces = zip(*(table or ()), strict=True)
    return tabulated(elongations, forces)


def build_power_law(spec: laws.LinearPowerSpec | laws.TorsionPowerSpec) -> PowerLaw:
    """The law of a damper."""
    default = REGULARIZATION_BELOW_ONE if spec.exponent < 1.0 else REGULARIZATION
    return PowerLaw(spec.coefficient, spec.exponent, spec.regularization or default)


def build_friction(spec: laws.LinearFrictionSpec | laws.TorsionFrictionSpec) -> Friction:
    """The law of dry friction."""
    if spec.coefficient is not None:
        lever = getattr(spec, "radius", None) or 1.0
        static = spec.coefficient if spec.static_coefficient is None else spec.static_coefficient
        coefficients = lever * spec.coefficient, lever * static
        return Friction(0.0, 0.0, math.inf, spec.viscous, spec.regularization, True, *coefficients)
    assert spec.coulomb is not None
    static = spec.coulomb if spec.static is None else spec.static
    stribeck = math.inf if spec.stribeck_velocity is None else spec.stribeck_velocity
    return Friction(spec.coulomb, static, stribeck, spec.viscous, spec.regularization, spec.sticking)


PARALLEL = 1e-6  # sine of the angle below which two axes count as parallel


def build_joint(name: str, spec: schema.AnyJointSpec, context: BuildContext) -> Joint | None:
    """A joint between two frames of parts; None, with a problem, if its ends or axes are invalid."""
    location: Location = ("joints", name)
    frames = [context.frame((*location, "between", index), text) for index, text in enumerate(spec.between)]
    if frames[0] is None or frames[1] is None:
        return None
    (parent, parent_pose), (child, child_pose) = frames[0], frames[1]
    if parent == child:
        context.report((*location, "between"), f"connects '{parent}' with itself", "Name two different parts.")
        return None
    if spec.type == "universal" and _are_parallel(*spec.axes):
        message = "the two directions are parallel"
        context.report((*location, "axes"), message, "Give two axes that are not parallel, usually at a right angle.")
        return None
    if spec.type == "planar" and spec.x_axis and _are_parallel(spec.axis, spec.x_axis):
        message = "the two directions are parallel"
        context.report((*location, "x_axis"), message, "Give another direction, usually at a right angle to the axis.")
        return None
    return _joint(name, spec, parent, parent_pose, child, child_pose)


def _joint(name: str, spec: schema.AnyJointSpec, parent: str, parent_pose: Pose, child: str, child_pose: Pose) -> Joint:
    nv, orients = JOINT_KINDS[spec.type].nv, JOINT_KINDS[spec.type].quaternion is not None
    axis, second = _axes(spec)
    position, velocity = _start_values(spec)
    drive = getattr(spec, "drive", None)
    fixed = (False,) * nv if spec.guess else _is_given(spec, nv, "position", "orientation")
    spring, damper, friction = (getattr(spec, key, None) for key in ("spring", "damper", "friction"))
    return Joint(
        name=name,
        type=spec.type,
        parent=parent,
        child=child,
        parent_pose=parent_pose,
        child_pose=child_pose,
        axis=axis,
        second=second,
        position=np.zeros(0) if drive else position,
        velocity=np.zeros(0) if drive else velocity,
        stiffness=np.zeros(nv) if orients else _per_coordinate(spec, "stiffness", nv),
        rest=np.zeros(nv) if orients else _per_coordinate(spec, "rest", nv),
        damping=_per_coordinate(spec, "damping", nv),
        lead=getattr(spec, "lead", 0.0),
        drive=_drive(name, drive),
        limits=_limits(getattr(spec, "limits", None)),
        effort_limit=getattr(spec, "effort_limit", None),
        velocity_limit=getattr(spec, "velocity_limit", None),
        spring=build_elastic_law(spring) if spring else None,
        damper=build_power_law(damper) if damper else None,
        friction=build_friction(friction) if friction else None,
        fixed_in_assembly=() if drive else fixed,
        fixed_speeds=() if drive else _is_given(spec, nv, "velocity", "angular_velocity"),
        cut=spec.cut,
        compliance=spec.compliance,
    )


def joint_bushing(joint: Joint, spec: schema.AnyJointSpec) -> Bushing | None:
    """The springs of a joint with orientations instead of angles, between its frames; None if it has none."""
    match spec:
        case schema.SphericalJointSpec(rest=rotation):
            rest = Pose(np.zeros(3), rotation_matrix(rotation))
            stiffness = np.concatenate([np.zeros(3), _per_coordinate(spec, "stiffness", 3)])
        case schema.FreeJointSpec(rest=pose):
            rest = Pose(np.zeros(3), np.eye(3)) if pose is None else Pose(array(pose.at), rotation_matrix(pose.rotate))
            stiffness = _per_coordinate(spec, "stiffness", 6)
        case _:
            return None
    if not stiffness.any():
        return None
    frames = joint.parent_pose @ rest, joint.child_pose
    ends = [attachment((part, frame)) for part, frame in zip((joint.parent, joint.child), frames, strict=True)]
    axes = frames[0].rotation, frames[1].rotation
    return Bushing(joint.name, ends[0], ends[1], *axes, np.diag(stiffness), np.zeros((6, 6)), in_joint=True)


def with_stops(joint: Joint) -> Joint:
    """The joint with rigid stops at those of its limits that would not act."""
    acting = tuple(
        limits
        if limits is None or limits.stiffness is not None or limits.restitution is not None
        else replace(limits, restitution=0.0)
        for limits in joint.limits
    )
    return replace(joint, limits=acting)


def _limits(given: Any) -> tuple[Limits | None, ...]:
    """The limits of each coordinate; () without any."""
    each = given if isinstance(given, tuple) else (given,)
    limits = tuple(
        None if spec is None else Limits(spec.lower, spec.upper, spec.stiffness, spec.damping, spec.restitution)
        for spec in each
    )
    return limits if any(limits) else ()


def _are_parallel(first: tuple[float, ...], second: tuple[float, ...]) -> bool:
    return norm(np.cross(rot.unit(first), rot.unit(second))) < PARALLEL


def _axes(spec: schema.AnyJointSpec) -> tuple[Array, Array]:
    """The `axis` and the `second` direction of a joint, see `Joint`."""
    match spec:
        case schema.UniversalJointSpec(axes=(first, second)):
            return rot.unit(first), rot.unit(second)
        case schema.PlanarJointSpec(axis=normal, x_axis=x_axis):
            axis = rot.unit(normal)
            if x_axis is None:
                return axis, rot.aligning_z(axis)[:, 0]
            along = rot.unit(x_axis)
            return axis, rot.unit(along - axis * (product(axis, along)))
        case (
            schema.RevoluteJointSpec(axis=direction)
            | schema.PrismaticJointSpec(axis=direction)
            | schema.ScrewJointSpec(axis=direction)
            | schema.CylindricalJointSpec(axis=direction)
        ):
            return rot.unit(direction), np.zeros(3)
        case schema.SphericalJointSpec() | schema.FixedJointSpec() | schema.FreeJointSpec():
            return np.zeros(3), np.zeros(3)
        case _:
            assert_never(spec)


def _start_values(spec: schema.AnyJointSpec) -> tuple[Array, Array]:
    """The q (nq,) and u (nv,) of a joint at the start."""
    match spec:
        case schema.FixedJointSpec():
            return np.zeros(0), np.zeros(0)
        case schema.SphericalJointSpec():
            return _quaternion(spec.orientation), array(spec.angular_velocity)
        case schema.FreeJointSpec():
            position = np.concatenate([array(spec.position), _quaternion(spec.orientation)])
            return position, array([*spec.velocity, *spec.angular_velocity])
        case _:
            return _listed(spec.position), _listed(spec.velocity)


def _is_given(spec: schema.AnyJointSpec, nv: int, linear: str, angular: str) -> tuple[bool, ...]:
    """For each degree of freedom, whether the file gives its start value, under the key `linear` or `angular`."""
    written = spec.model_fields_set
    if isinstance(spec, schema.FreeJointSpec):
        return (linear in written,) * 3 + (angular in written,) * 3
    return (bool({linear, angular} & written),) * nv


def _quaternion(orientation: RotationSpec | None) -> Array:
    return rot.to_quaternion(rotation_matrix(orientation))


def _per_coordinate(spec: schema.AnyJointSpec, key: str, nv: int) -> Array:
    """A value for each degree of freedom: from a list, from one number for all, or 0."""
    value = getattr(spec, key, 0.0)
    return _listed(value if isinstance(value, tuple) else (value,) * nv)


def _listed(value: Any) -> Array:
    """An array (n,) of n numbers, or of one."""
    listed: Array = array(value if isinstance(value, tuple) else (value,))
    return listed


def _drive(name: str, drive: Any) -> tuple[TimeExpression, ...] | CommandedDrive:
    if drive is None:
        return ()
    if isinstance(drive, TimeExpression):
        return (drive,)
    if isinstance(drive, tuple):
        return drive
    return CommandedDrive(
        name=name,
        controls=drive.command,
        bandwidth=drive.bandwidth,
        velocity_limit=math.inf if drive.velocity_limit is None else drive.velocity_limit,
        acceleration_limit=math.inf if drive.acceleration_limit is None else drive.acceleration_limit,
        lower=-math.inf if drive.lower is None else drive.lower,
        upper=math.inf if drive.upper is None else drive.upper,
        start=drive.position,
    )
