"""Sensors as plain records: what they measure, where, when, and with which errors.

Their rates and delays are converted here to periods and delays in numbers of steps.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Literal

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.short_repr import record, short_repr
from mbd_sim.mechanism.elements.parts import PartFrame


@dataclass(frozen=True, slots=True)
class Quantity:
    """A quantity that a sensor measures: its key, its SI unit, and the names of its components."""

    name: str
    unit: str
    components: tuple[str, ...] = ("x", "y", "z")


ANGULAR_VELOCITY = Quantity("angular_velocity", "rad/s")
SPECIFIC_FORCE = Quantity("specific_force", "m/s²")
ORIENTATION = Quantity("orientation", "rad")  # its errors are small rotations about the axes of the sensor
POSITION = Quantity("position", "m")
VELOCITY = Quantity("velocity", "m/s")
FORCE = Quantity("force", "N")
TORQUE = Quantity("torque", "N·m")
DISTANCE = Quantity("distance", "m", ("",))
CURRENT = Quantity("current", "A", ("",))


@dataclass(frozen=True)
class ErrorModel:
    """The errors of a quantity in its SI unit; they add up in this order, the same for each component.

    `bias` is constant. `bias_walk` K in unit/√s lets the bias walk: after a time T its standard deviation is K √T.
    `noise_density` N in unit/√Hz is white noise of the standard deviation N √rate, so that the Allan deviation at an
    averaging time τ is N/√τ. Then the value is rounded to a multiple of the `resolution` (0: not), and limited to
    ±`limit`.
    """

    bias: float = 0.0
    bias_walk: float = 0.0
    noise_density: float = 0.0
    resolution: float = 0.0
    limit: float = math.inf

    __repr__ = short_repr


EXACT = ErrorModel()


@dataclass(frozen=True)
class Sampling:
    """When a sensor measures: at `rate` in Hz, None for each step, from time zero.

    A measurement arrives `delay` s later, unless it is lost, with the probability `drop_out`.
    """

    rate: float | None = None
    delay: float = 0.0
    drop_out: float = 0.0

    __repr__ = short_repr


@record
class Sensor(ABC):
    """What all sensors have in common; `errors` has an entry for each of the `quantities`.

    `kind` is the type in mechanism files, `message_type` that of its ROS messages.
    """

    kind: ClassVar[str]
    message_type: ClassVar[str]
    name: str
    sampling: Sampling
    errors: tuple[ErrorModel, ...]

    def __init_subclass__(cls, *, kind: str, message_type: str) -> None:
        cls.kind, cls.message_type = kind, message_type

    @property
    @abstractmethod
    def quantities(self) -> tuple[Quantity, ...]:
        """What it measures, in order."""


@record
class Imu(Sensor, kind="imu", message_type="sensor_msgs/msg/Imu"):
    """Angular velocity and specific force of a frame, in its axes, and on request its orientation in ground's frame.

    The specific force is the acceleration less that of gravity: at rest it is 9.81 m/s² upward.
    """

    at: PartFrame
    orientation: bool

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """What it measures."""
        return (ANGULAR_VELOCITY, SPECIFIC_FORCE, *((ORIENTATION,) if self.orientation else ()))


@record
class Accelerometer(Sensor, kind="accelerometer", message_type="sensor_msgs/msg/Imu"):
    """The specific force at a point, in the axes of its frame."""

    at: PartFrame

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """What it measures."""
        return (SPECIFIC_FORCE,)


@record
class ForceTorque(Sensor, kind="force_torque", message_type="geometry_msgs/msg/WrenchStamped"):
    """The load that a joint transmits to its second part, about and in the axes of a frame `at` there."""

    joint: str
    at: PartFrame

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """What it measures."""
        return (FORCE, TORQUE)


@record
class Encoder(Sensor, kind="encoder", message_type="sensor_msgs/msg/JointState"):
    """The position of a coordinate in whole steps of the resolution, rounded down.

    With an `index` (m or rad), a second number is 1 within the step that contains this position, and 0 elsewhere; with
    `counts` per turn, in each turn.
    """

    coordinate: str
    unit: str
    resolution: float
    counts: int | None
    index: float | None

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """What it measures; the errors are those of the position."""
        return (Quantity("position", self.unit, ("",)),)


@record
class Tachometer(Sensor, kind="tachometer", message_type="sensor_msgs/msg/JointState"):
    """The speed of a coordinate."""

    coordinate: str
    unit: str

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """What it measures."""
        return (Quantity("velocity", f"{self.unit}/s", ("",)),)


@record
class MotorCurrent(Sensor, kind="current", message_type="sensor_msgs/msg/JointState"):
    """The current of an actuator with a DC motor."""

    actuator: str

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """What it measures."""
        return (CURRENT,)


@record
class RangeFinder(Sensor, kind="range", message_type="sensor_msgs/msg/Range"):
    """The distance from the origin of `at` to a plane along x of this frame, or to a point in any direction.

    The plane goes through the `target` with this `normal` (3,) in the axes of its part; without a normal the target is
    a point. Below `least` the distance is -∞, above `most`, and where the beam does not meet the plane, it is +∞.
    `field_of_view` in rad is only passed on.
    """

    at: PartFrame
    target: PartFrame
    normal: Array | None
    least: float
    most: float
    field_of_view: float
    radiation: Literal["ultrasound", "infrared"]

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """What it measures."""
        return (DISTANCE,)


@record
class PoseSensor(Sensor, kind="pose", message_type="geometry_msgs/msg/PoseStamped"):
    """The pose of a frame in ground's frame."""

    at: PartFrame

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """What it measures."""
        return (POSITION, ORIENTATION)


@record
class TwistSensor(Sensor, kind="twist", message_type="geometry_msgs/msg/TwistStamped"):
    """The velocity of a point and the angular velocity of its part, in ground's axes or in those `in_frame`."""

    at: PartFrame
    in_frame: bool

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """What it measures."""
        return (VELOCITY, ANGULAR_VELOCITY)


@record
class Odometry(Sensor, kind="odometry", message_type="nav_msgs/msg/Odometry"):
    """The pose of a frame in ground's frame, and its velocities in its own axes."""

    at: PartFrame

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """What it measures."""
        return (POSITION, ORIENTATION, VELOCITY, ANGULAR_VELOCITY)


FrameSensor = Imu | Accelerometer | ForceTorque | RangeFinder | PoseSensor | TwistSensor | Odometry
CoordinateSensor = Encoder | Tachometer
FramelessSensor = CoordinateSensor | MotorCurrent
AnySensor = FrameSensor | FramelessSensor


def frame_id(sensor: FrameSensor) -> str:
    """The name of the sensor's frame: that of its part where it is the part's own, or else `<sensor>_frame`."""
    return sensor.at.part if sensor.at.is_of_part else f"{sensor.name}_frame"


RATE_ROUND_OFF = 1e-9  # relative, of rates and delays that are computed or have units


class SamplingError(InputError):
    """A rate or a delay that is not a whole number of steps; `key` is its key."""

    def __init__(self, key: str, message: str, remedy: str) -> None:
        super().__init__(message, remedy)
        self.key = key


@dataclass(frozen=True)
class SamplingSteps:
    """A sensor measures every `period` steps; a measurement arrives `delay` steps later."""

    period: int
    delay: int


def steps_of(sampling: Sampling, step: float) -> SamplingSteps:
    """The period and the delay in steps of `step` s.

    :raises SamplingError: they are not whole numbers of steps; the nearest possible values are named.
    """
    return SamplingSteps(_period(sampling.rate, step), _delay(sampling.delay, step))


def _period(rate: float | None, step: float) -> int:
    if rate is None:
        return 1
    ratio = 1.0 / (rate * step)
    if ratio < 1.0 - RATE_ROUND_OFF:
        raise SamplingError(
            "rate",
            f"{rate:.12g} Hz is more than one measurement for each step of {step:g} s",
            f"Write at most {1.0 / step:.12g} Hz, or choose a smaller step.",
        )
    period = round(ratio)
    if abs(ratio - period) > RATE_ROUND_OFF * ratio:
        rates = " or ".join(f"{1.0 / (count * step):.12g} Hz" for count in (math.ceil(ratio), math.floor(ratio)))
        raise SamplingError(
            "rate",
            f"the period of {rate:.12g} Hz is not a whole number of steps of {step:g} s",
            f"The nearest rates are {rates}.",
        )
    return period


def _delay(delay: float, step: float) -> int:
    count = round(delay / step)
    if abs(delay / step - count) > RATE_ROUND_OFF * max(1, count):
        whole = math.floor(delay / step)
        delays = " or ".join(f"{number * step:.12g} s" for number in (whole, whole + 1))
        raise SamplingError(
            "delay",
            f"{delay:.12g} s is not a whole number of steps of {step:g} s",
            f"The nearest delays are {delays}.",
        )
    return count
