"""The sensors of a mechanism file."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from mbd_sim.base.errors import InputError
from mbd_sim.files.schema.fields import (
    Angle,
    AnyNumber,
    Delay,
    Direction,
    Frequency,
    PositiveLength,
    QuantityField,
    Spec,
)

Probability = Annotated[float, QuantityField("", at_least=0, at_most=1)]
Distance = Annotated[float, QuantityField("m", at_least=0)]


def _whole(number: float) -> float:
    if math.isfinite(number) and number != round(number):  # nan: the problem is reported at a parameter
        raise InputError(f"is {number:g}", "Write a whole number.")
    return number


Count = Annotated[float, QuantityField("", at_least=1, at_most=1e12), AfterValidator(_whole)]
Seed = Annotated[float, QuantityField("", at_least=0, at_most=1e15), AfterValidator(_whole)]
AnyResolution = Annotated[float, QuantityField(None, above=0)]
_DENSITY = "standard deviation of the noise divided by √rate: its unit per √Hz"
_WALK = "standard deviation of the walking bias after one second"
_LIMIT = "largest magnitude"


class AngularVelocityErrorsSpec(Spec):
    """The errors of an angular velocity, in rad/s."""

    bias: Annotated[float, QuantityField("rad/s")] = 0.0
    bias_walk: Annotated[float, QuantityField("rad/s", at_least=0)] = Field(0.0, description=_WALK)
    noise_density: Annotated[float, QuantityField("rad/s", at_least=0)] = Field(0.0, description=_DENSITY)
    resolution: Annotated[float, QuantityField("rad/s", above=0)] | None = None
    limit: Annotated[float, QuantityField("rad/s", above=0)] | None = Field(None, description=_LIMIT)


class SpecificForceErrorsSpec(Spec):
    """The errors of a specific force, in m/s²."""

    bias: Annotated[float, QuantityField("m/s**2")] = 0.0
    bias_walk: Annotated[float, QuantityField("m/s**2", at_least=0)] = Field(0.0, description=_WALK)
    noise_density: Annotated[float, QuantityField("m/s**2", at_least=0)] = Field(0.0, description=_DENSITY)
    resolution: Annotated[float, QuantityField("m/s**2", above=0)] | None = None
    limit: Annotated[float, QuantityField("m/s**2", above=0)] | None = Field(None, description=_LIMIT)


class ForceErrorsSpec(Spec):
    """The errors of a force, in N."""

    bias: Annotated[float, QuantityField("N")] = 0.0
    bias_walk: Annotated[float, QuantityField("N", at_least=0)] = Field(0.0, description=_WALK)
    noise_density: Annotated[float, QuantityField("N", at_least=0)] = Field(0.0, description=_DENSITY)
    resolution: Annotated[float, QuantityField("N", above=0)] | None = None
    limit: Annotated[float, QuantityField("N", above=0)] | None = Field(None, description=_LIMIT)


class TorqueErrorsSpec(Spec):
    """The errors of a torque, in N·m."""

    bias: Annotated[float, QuantityField("N*m")] = 0.0
    bias_walk: Annotated[float, QuantityField("N*m", at_least=0)] = Field(0.0, description=_WALK)
    noise_density: Annotated[float, QuantityField("N*m", at_least=0)] = Field(0.0, description=_DENSITY)
    resolution: Annotated[float, QuantityField("N*m", above=0)] | None = None
    limit: Annotated[float, QuantityField("N*m", above=0)] | None = Field(None, description=_LIMIT)


class PositionErrorsSpec(Spec):
    """The errors of a position, in m."""

    bias: Annotated[float, QuantityField("m")] = 0.0
    bias_walk: Annotated[float, QuantityField("m", at_least=0)] = Field(0.0, description=_WALK)
    noise_density: Annotated[float, QuantityField("m", at_least=0)] = Field(0.0, description=_DENSITY)
    resolution: Annotated[float, QuantityField("m", above=0)] | None = None
    limit: Annotated[float, QuantityField("m", above=0)] | None = Field(None, description=_LIMIT)


class VelocityErrorsSpec(Spec):
    """The errors of a velocity, in m/s."""

    bias: Annotated[float, QuantityField("m/s")] = 0.0
    bias_walk: Annotated[float, QuantityField("m/s", at_least=0)] = Field(0.0, description=_WALK)
    noise_density: Annotated[float, QuantityField("m/s", at_least=0)] = Field(0.0, description=_DENSITY)
    resolution: Annotated[float, QuantityField("m/s", above=0)] | None = None
    limit: Annotated[float, QuantityField("m/s", above=0)] | None = Field(None, description=_LIMIT)


class OrientationErrorsSpec(Spec):
    """The errors of an orientation: a small rotation about the axes of the sensor, in rad."""

    bias: Angle = 0.0
    bias_walk: Annotated[float, QuantityField("rad", at_least=0)] = Field(0.0, description=_WALK)
    noise_density: Annotated[float, QuantityField("rad", at_least=0)] = Field(0.0, description=_DENSITY)


class SensorSpec(Spec):
    """The keys of all sensors; a measurement arrives `delay` later, unless it is lost."""

    rate: Frequency | None = Field(None, description="measurements per second; by default one for each step")
    delay: Delay = 0.0
    drop_out: Probability = Field(0.0, description="probability that a measurement is lost")


class ImuSpec(SensorSpec):
    """Angular velocity and specific force (at rest: 9.81 m/s² upward) of a frame, and its orientation on request."""

    type: Literal["imu"]
    at: str
    angular_velocity: AngularVelocityErrorsSpec = Field(
        default_factory=lambda: AngularVelocityErrorsSpec.model_validate({})
    )
    specific_force: SpecificForceErrorsSpec = Field(default={}, validate_default=True)
    orientation: OrientationErrorsSpec | None = Field(None, description="its errors; {} for none")


class AccelerometerSpec(SensorSpec, SpecificForceErrorsSpec):
    """The specific force at a point: the acceleration less that of gravity, in the axes of its frame."""

    type: Literal["accelerometer"]
    at: str


class ForceTorqueSpec(SensorSpec):
    """The force and torque that a joint transmits to its second part, in the axes of its frame there."""

    type: Literal["force_torque"]
    joint: str
    at: str | None = Field(None, description="another frame on that part; the torque is about its origin")
    force: ForceErrorsSpec = Field(default={}, validate_default=True)
    torque: TorqueErrorsSpec = Field(default={}, validate_default=True)


class EncoderSpec(SensorSpec):
    """The position of a coordinate in whole steps: of `resolution`, or `counts` to a turn."""

    type: Literal["encoder"]
    joint: str = Field(description="a joint, or one of its coordinates such as planar.x")
    resolution: AnyResolution | None = Field(None, description="m or rad")
    counts: Count | None = Field(None, description="steps to a turn")
    index: AnyNumber | None = Field(None, description="position of the index pulse, m or rad")
    bias: AnyNumber = 0.0
    noise_density: Annotated[float, QuantityField(None, at_least=0)] = Field(0.0, description=_DENSITY)

    @model_validator(mode="after")
    def _one_resolution(self) -> EncoderSpec:
        if (self.resolution is None) == (self.counts is None):
            given = "neither resolution nor counts" if self.counts is None else "resolution and counts"
            raise InputError(f"has {given}", "Give one of them.")
        return self


class TachometerSpec(SensorSpec):
    """The speed of a coordinate."""

    type: Literal["tachometer"]
    joint: str = Field(description="a joint, or one of its coordinates such as planar.x")
    bias: AnyNumber = 0.0
    bias_walk: Annotated[float, QuantityField(None, at_least=0)] = Field(0.0, description=_WALK)
    noise_density: Annotated[float, QuantityField(None, at_least=0)] = Field(0.0, description=_DENSITY)
    resolution: AnyResolution | None = None
    limit: AnyResolution | None = Field(None, description=_LIMIT)


class CurrentSpec(SensorSpec):
    """The current of an actuator with a DC motor."""

    type: Literal["current"]
    actuator: str
    bias: Annotated[float, QuantityField("A")] = 0.0
    bias_walk: Annotated[float, QuantityField("A", at_least=0)] = Field(0.0, description=_WALK)
    noise_density: Annotated[float, QuantityField("A", at_least=0)] = Field(0.0, description=_DENSITY)
    resolution: Annotated[float, QuantityField("A", above=0)] | None = None
    limit: Annotated[float, QuantityField("A", above=0)] | None = Field(None, description=_LIMIT)


class RangeSpec(SensorSpec):
    """The distance along x of a frame to a plane, or to a point in any direction."""

    type: Literal["range"]
    at: str
    plane: str | None = None
    normal: Direction = (0.0, 0.0, 1.0)
    point: str | None = None
    least: Distance = Field(0.0, description="distance below which the value is -infinity")
    most: PositiveLength = Field(description="distance above which the value is +infinity")
    field_of_view: Angle = 0.0
    radiation: Literal["ultrasound", "infrared"] = "infrared"
    bias: Annotated[float, QuantityField("m")] = 0.0
    bias_walk: Annotated[float, QuantityField("m", at_least=0)] = Field(0.0, description=_WALK)
    noise_density: Annotated[float, QuantityField("m", at_least=0)] = Field(0.0, description=_DENSITY)
    resolution: PositiveLength | None = None

    @model_validator(mode="after")
    def _one_target(self) -> RangeSpec:
        if (self.plane is None) == (self.point is None):
            given = "neither plane nor point" if self.plane is None else "plane and point"
            raise InputError(f"has {given}", "Give one of them, such as 'plane: ground.floor'.")
        if "normal" in self.model_fields_set and self.plane is None:
            raise InputError("normal has no effect without a plane", "Add 'plane', or remove 'normal'.")
        if self.least >= self.most:
            raise InputError(
                f"least {self.least:g} is not below most {self.most:g}", "Give a smaller least, or a larger most."
            )
        return self


class PoseSpec(SensorSpec):
    """The pose of a frame in ground's frame."""

    type: Literal["pose"]
    at: str
    position: PositionErrorsSpec = Field(default={}, validate_default=True)
    orientation: OrientationErrorsSpec = Field(default={}, validate_default=True)


class TwistSpec(SensorSpec):
    """The velocity of a point and the angular velocity of its part, in the axes of ground or of the `frame`."""

    type: Literal["twist"]
    at: str
    axes: Literal["ground", "frame"] = "ground"
    velocity: VelocityErrorsSpec = Field(default={}, validate_default=True)
    angular_velocity: AngularVelocityErrorsSpec = Field(
        default_factory=lambda: AngularVelocityErrorsSpec.model_validate({})
    )


class OdometrySpec(SensorSpec):
    """The pose of a frame in ground's frame, and its velocities in its own axes."""

    type: Literal["odometry"]
    at: str
    position: PositionErrorsSpec = Field(default={}, validate_default=True)
    orientation: OrientationErrorsSpec = Field(default={}, validate_default=True)
    velocity: VelocityErrorsSpec = Field(default={}, validate_default=True)
    angular_velocity: AngularVelocityErrorsSpec = Field(
        default_factory=lambda: AngularVelocityErrorsSpec.model_validate({})
    )


AnySensorSpec = Annotated[
    ImuSpec
    | AccelerometerSpec
    | ForceTorqueSpec
    | EncoderSpec
    | TachometerSpec
    | CurrentSpec
    | RangeSpec
    | PoseSpec
    | TwistSpec
    | OdometrySpec,
    Field(discriminator="type"),
]
