"""The messages of sensors, one function for each type of message."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import assert_never

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.geometry.pose import Array
from mbd_sim.mechanism.elements.parts import GROUND
from mbd_sim.mechanism.elements.sensors import (
    Accelerometer,
    AnySensor,
    Encoder,
    ForceTorque,
    Imu,
    MotorCurrent,
    Odometry,
    PoseSensor,
    RangeFinder,
    Tachometer,
    TwistSensor,
    frame_id,
)
from mbd_sim.recordings.messages.cdr import MessageBuilder, SerializedMessage
from mbd_sim.simulation.kernel.sensors import INDEX, SensorModel, SensorReading

RADIATION = ("ultrasound", "infrared")  # in the order of the numbers in sensor_msgs/Range
_UNKNOWN = -1.0  # the first entry of a covariance whose quantity is not measured

Numbers = NDArray[np.float64] | NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class SensorWriter:
    """A message of a sensor, and the views of it into which a reading is written, by the name of the quantity."""

    message: SerializedMessage
    views: Mapping[str, Numbers]

    def payload(self, reading: SensorReading, time_ns: int) -> bytes:
        """The serialized message of a reading, stamped with the time of its sample in ns."""
        for name, view in self.views.items():
            values = reading.values[name]
            view[:] = values[[1, 2, 3, 0]] if len(values) == 4 else values  # of quaternions, w is the last in ROS
        self.message.stamp(time_ns)
        return self.message.payload()


def sensor_writer(sensors: SensorModel, number: int, frame_prefix: str) -> SensorWriter:
    """The message of a sensor by its number; frame names begin with a prefix."""
    sensor, deviations = sensors.sensors[number], sensors.errors[number].deviations
    return _Builder(frame_prefix, deviations**2).writer(sensor)


class _Builder:
    """Builds the message of one sensor; `variances` are those of the noise of all components, in order."""

    def __init__(self, frame_prefix: str, variances: Array) -> None:
        self._prefix, self._variances = frame_prefix, variances
        self._builder = MessageBuilder()
        self._fills: list[Callable[[SerializedMessage], None]] = []
        self._views: dict[str, Callable[[SerializedMessage], Numbers]] = {}

    def writer(self, sensor: AnySensor) -> SensorWriter:
        self._write_fields(sensor)
        message = self._builder.message()
        for fill in self._fills:
            fill(message)
        return SensorWriter(message, {name: view(message) for name, view in self._views.items()})

    def _write_fields(self, sensor: AnySensor) -> None:
        match sensor:
            case Imu():
                self._imu(sensor, sensor.orientation)
            case Accelerometer():
                self._imu(sensor, False)
            case ForceTorque():
                self._builder.header(self._prefix + frame_id(sensor))
                self._quantity("force")
                self._quantity("torque")
            case Encoder() | Tachometer():
                self._joint_state(sensor)
            case MotorCurrent():
                self._current(sensor)
            case RangeFinder():
                self._range(sensor)
            case PoseSensor():
                self._builder.header(self._prefix + GROUND)
                self._quantity("position")
                self._quantity("orientation", 4)
            case TwistSensor():
                self._builder.header(self._prefix + (frame_id(sensor) if sensor.in_frame else GROUND))
                self._quantity("velocity")
                self._quantity("angular_velocity")
            case Odometry():
                self._odometry(sensor)
            case _:
                assert_never(sensor)

    def _imu(self, sensor: Imu | Accelerometer, orientation: bool) -> None:
        self._builder.header(self._prefix + frame_id(sensor))
        turning = isinstance(sensor, Imu)
        first = 3 if turning else 0
        for name, size, measured, start in (
            ("orientation", 4, orientation, 6),
            ("angular_velocity", 3, turning, 0),
            ("specific_force", 3, True, first),
        ):
            if measured:
                self._quantity(name, size)
                self._constant(np.diag(self._variances[start : start + 3]))
            else:
                self._builder.doubles(size)
                self._constant(np.array([_UNKNOWN, *[0.0] * 8]))

    def _joint_state(self, sensor: Encoder | Tachometer) -> None:
        has_index = isinstance(sensor, Encoder) and sensor.index is not None
        names = [sensor.coordinate, f"{sensor.coordinate}.index"] if has_index else [sensor.coordinate]
        self._builder.header()
        self._builder.texts(names)
        if isinstance(sensor, Tachometer):
            self._builder.integer(0)  # no positions
        self._builder.integer(len(names))
        for name in ("velocity",) if isinstance(sensor, Tachometer) else ("position", INDEX)[: len(names)]:
            self._quantity(name, 1)
        if not isinstance(sensor, Tachometer):
            self._builder.integer(0)  # no velocities,
        self._builder.integer(0)  # no efforts

    def _current(self, sensor: MotorCurrent) -> None:
        self._builder.header()
        self._builder.texts([sensor.actuator])
        self._builder.integer(0)  # no positions,
        self._builder.integer(0)  # no velocities
        self._builder.integer(1)
        self._quantity("current", 1)

    def _range(self, sensor: RangeFinder) -> None:
        self._builder.header(self._prefix + frame_id(sensor))
        self._builder.byte(RADIATION.index(sensor.radiation))
        places = [self._builder.singles(1) for _ in range(5)]
        variance = float(self._variances[0])

        def fill(message: SerializedMessage) -> None:
            known = (sensor.field_of_view, sensor.least, sensor.most, 0.0, variance)
            for place, value in zip(places, known, strict=True):
                message.single_view(place)[:] = value

        self._fills.append(fill)
        self._views["distance"] = lambda message: message.single_view(places[3])

    def _odometry(self, sensor: Odometry) -> None:
        self._builder.header(self._prefix + GROUND)
        self._builder.text(self._prefix + frame_id(sensor))
        self._quantity("position")
        self._quantity("orientation", 4)
        self._constant(np.diag(self._variances[:6]))
        self._quantity("velocity")
        self._quantity("angular_velocity")
        self._constant(np.diag(self._variances[6:]))

    def _quantity(self, name: str, size: int = 3) -> None:
        place = self._builder.doubles(size)
        self._views[name] = lambda message: message.view(place)

    def _constant(self, values: Array) -> None:
        place = self._builder.doubles(values.size)

        def fill(message: SerializedMessage) -> None:
            message.view(place)[:] = values.ravel()

        self._fills.append(fill)
