"""Builds the sensors of a mechanism from their records in the file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import assert_never

from pydantic import BaseModel

from mbd_sim.base.errors import listed, nearest, quoted
from mbd_sim.base.geometry import rotation as rot
from mbd_sim.base.linear_algebra import product
from mbd_sim.files.builders.context import BuildContext
from mbd_sim.files.schema import sensors as schema
from mbd_sim.mechanism.elements import sensors as records
from mbd_sim.mechanism.elements.actuators import Actuator
from mbd_sim.mechanism.elements.joint_types import JointCoordinate
from mbd_sim.mechanism.elements.parts import Joint, PartFrame
from mbd_sim.mechanism.elements.sensors import AnySensor, ErrorModel, Sampling, SamplingError, steps_of
from mbd_sim.mechanism.values.source import Location

POINT = "."


def build_sensors(
    specs: Mapping[str, schema.AnySensorSpec], actuators: Sequence[Actuator], step: float, context: BuildContext
) -> tuple[AnySensor, ...]:
    """The sensors of a file; invalid ones are left out and reported to `context`.

    :param actuators: those that are valid.
    :param step: in s, of which periods and delays are multiples; nan: it is unknown.
    """
    builder = _SensorBuilder(actuators, context)
    built = []
    for name, spec in specs.items():
        sampling = Sampling(spec.rate, spec.delay, spec.drop_out)
        if not math.isnan(step + (spec.rate or 0.0) + spec.delay):  # not reported already
            _check_sampling(("sensors", name), sampling, step, context)
        if (sensor := builder.build(name, spec, sampling)) is not None:
            _check_frame_name(sensor, context)
            built.append(sensor)
    return tuple(built)


def measured_joints(sensors: Sequence[AnySensor], joints: Mapping[str, Joint]) -> set[str]:
    """The joints whose coordinates sensors measure."""
    measured = {sensor.coordinate for sensor in sensors if isinstance(sensor, records.CoordinateSensor)}
    return {joint.name for joint in joints.values() if measured & set(joint.motion_names)}


def _check_sampling(where: Location, sampling: Sampling, step: float, context: BuildContext) -> None:
    try:
        steps_of(sampling, step)
    except SamplingError as error:
        context.report((*where, error.key), error.message, error.remedy)


def _check_frame_name(sensor: AnySensor, context: BuildContext) -> None:
    if not isinstance(sensor, records.FramelessSensor) and not sensor.at.is_of_part:
        name = records.frame_id(sensor)
        if name in context.points_by_part:
            context.report(("sensors", sensor.name), f"its frame would be named like the part '{name}'", "Rename it.")


class _SensorBuilder:
    """Builds sensors one by one; problems are reported to the context."""

    def __init__(self, actuators: Sequence[Actuator], context: BuildContext) -> None:
        self._joints, self._context = context.joints or {}, context
        self._actuators = {actuator.name: actuator for actuator in actuators}

    def build(self, name: str, spec: schema.AnySensorSpec, sampling: Sampling) -> AnySensor | None:
        where: Location = ("sensors", name)
        match spec:
            case schema.EncoderSpec() | schema.TachometerSpec():
                return self._on_coordinate(name, spec, sampling)
            case schema.ForceTorqueSpec():
                return self._force_torque(name, spec, sampling)
            case schema.CurrentSpec():
                return self._current(name, spec, sampling)
            case schema.RangeSpec():
                return self._range(name, spec, sampling)
        at = self._frame((*where, "at"), spec.at)
        if at is None:
            return None
        match spec:
            case schema.ImuSpec():
                errors = _errors(spec.angular_velocity, spec.specific_force, spec.orientation)
                return records.Imu(name, sampling, errors, at, spec.orientation is not None)
            case schema.AccelerometerSpec():
                return records.Accelerometer(name, sampling, _errors(spec), at)
            case schema.PoseSpec():
                return records.PoseSensor(name, sampling, _errors(spec.position, spec.orientation), at)
            case schema.TwistSpec():
                errors = _errors(spec.velocity, spec.angular_velocity)
                return records.TwistSensor(name, sampling, errors, at, spec.axes == "frame")
            case schema.OdometrySpec():
                errors = _errors(spec.position, spec.orientation, spec.velocity, spec.angular_velocity)
                return records.Odometry(name, sampling, errors, at)
            case _:
                assert_never(spec)

    def _frame(self, where: Location, reference: str) -> PartFrame | None:
        frame = self._context.frame(where, reference)
        return None if frame is None else PartFrame(*frame)

    def _joint(self, where: Location, name: str) -> Joint | None:
        """A joint of the file; None, with a problem unless the joints of the file could not be read."""
        if name not in self._joints and self._context.joints is not None:
            known = [joint for joint in self._joints if joint]
            self._context.report(where, f"there is no joint {quoted(name)}", nearest(name, known))
        return self._joints.get(name)

    def _force_torque(self, name: str, spec: schema.ForceTorqueSpec, sampling: Sampling) -> AnySensor | None:
        joint = self._joint(("sensors", name, "joint"), spec.joint)
        if joint is None:
            return None
        at = PartFrame(joint.child, joint.child_pose)
        if spec.at is not None:
            where: Location = ("sensors", name, "at")
            frame = self._frame(where, spec.at)
            if frame is not None and frame.part != joint.child:
                message = f"{quoted(spec.at)} is not on the second part of the joint"
                self._context.report(where, message, f"Name '{joint.child}' or a point of it.")
            at = frame or at
        return records.ForceTorque(name, sampling, _errors(spec.force, spec.torque), joint.name, at)

    def _current(self, name: str, spec: schema.CurrentSpec, sampling: Sampling) -> AnySensor | None:
        where: Location = ("sensors", name, "actuator")
        written = self._context.source.data.get("actuators")
        known = list(written) if isinstance(written, dict) else []
        if spec.actuator not in known:
            remedy = nearest(spec.actuator, known) or "Add it under 'actuators'."
            self._context.report(where, f"there is no actuator {quoted(spec.actuator)}", remedy)
        if (actuator := self._actuators.get(spec.actuator)) is None:
            return None
        if not actuator.motor.electric:
            self._context.report(where, f"'{spec.actuator}' has no current", "Name an actuator of the type 'dc_motor'.")
            return None
        return records.MotorCurrent(name, sampling, _errors(spec), spec.actuator)

    def _range(self, name: str, spec: schema.RangeSpec, sampling: Sampling) -> AnySensor | None:
        where: Location = ("sensors", name)
        key, reference = ("plane", spec.plane) if spec.plane is not None else ("point", spec.point)
        at, target = self._frame((*where, "at"), spec.at), self._frame((*where, key), reference or "")
        if at is None or target is None:
            return None
        if at.part == target.part:
            self._context.report((*where, key), f"is on '{at.part}' like the sensor", "Name another part.")
            return None
        normal = None if spec.plane is None else product(target.pose.rotation, rot.unit(spec.normal))
        limits = spec.least, spec.most, spec.field_of_view
        return records.RangeFinder(name, sampling, _errors(spec), at, target, normal, *limits, spec.radiation)

    def _on_coordinate(
        self, name: str, spec: schema.EncoderSpec | schema.TachometerSpec, sampling: Sampling
    ) -> AnySensor | None:
        where: Location = ("sensors", name)
        found = self._coordinate((*where, "joint"), spec.joint)
        if found is None:
            return None
        coordinate, kind = found
        unit = kind.unit if isinstance(spec, schema.EncoderSpec) else f"{kind.unit}/s"
        keys = ("bias", "bias_walk", "noise_density", "resolution", "limit", "index")
        wrong_units = [key for key in keys if not self._context.has_unit((*where, key), unit)]
        if wrong_units:
            return None
        if isinstance(spec, schema.TachometerSpec):
            return records.Tachometer(name, sampling, _errors(spec), coordinate, kind.unit)
        if spec.counts is not None and not kind.rotation:
            self._context.report((*where, "counts"), f"'{spec.joint}' does not turn", "Give 'resolution' in m.")
            return None
        if kind.rotation and spec.resolution is not None and spec.resolution > math.pi:
            problem = f"{spec.resolution:g} rad is more than half a turn"
            remedy = "Give the steps of a turn as 'counts', or a smaller resolution."
            self._context.report((*where, "resolution"), problem, remedy)
            return None
        # Counts from a parameter that has a problem are not a number.
        counts = None if spec.counts is None or math.isnan(spec.counts) else round(spec.counts)
        resolution = spec.resolution or 2.0 * math.pi / (counts or 1)
        errors = (ErrorModel(spec.bias, 0.0, spec.noise_density),)
        return records.Encoder(name, sampling, errors, coordinate, kind.unit, resolution, counts, spec.index)

    def _coordinate(self, where: Location, reference: str) -> tuple[str, JointCoordinate] | None:
        """The name and the kind of the coordinate that `joint` or `joint.label` names."""
        owners = [name for name in self._joints if reference == name or reference.startswith(f"{name}{POINT}")]
        joint = self._joint(where, max(owners, key=len, default=reference.partition(POINT)[0]))
        if joint is None:
            return None
        scalar = {
            name: coordinate
            for name, coordinate in zip(joint.motion_names, joint.kind.coordinates, strict=True)
            if not (joint.kind.quaternion is not None and coordinate.rotation)
        }
        if reference in scalar:
            return reference, scalar[reference]
        problem = f"{quoted(reference)} is not a coordinate that can be measured"
        remedy = f"Name one of {listed(list(scalar))}." if scalar else f"A {joint.type} joint has none; use a 'pose'."
        self._context.report(where, problem, remedy)
        return None


def _errors(*specs: BaseModel | None) -> tuple[ErrorModel, ...]:
    """The errors of each quantity; a key that it does not have or that is not given has no effect."""
    return tuple(
        ErrorModel(
            bias=getattr(spec, "bias", 0.0),
            bias_walk=getattr(spec, "bias_walk", 0.0),
            noise_density=getattr(spec, "noise_density", 0.0),
            resolution=getattr(spec, "resolution", None) or 0.0,
            limit=getattr(spec, "limit", None) or math.inf,
        )
        for spec in specs
        if spec is not None
    )
