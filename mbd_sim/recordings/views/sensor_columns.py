"""The recorded measurements of sensors as arrays, each sensor at its own times."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.recordings.messages import cdr
from mbd_sim.recordings.messages.cdr import Message
from mbd_sim.recordings.messages.definitions import names_by_topic
from mbd_sim.recordings.run.reader import Recording, TopicRole, topic_roles

_UNKNOWN = -1.0  # the first entry of a covariance in sensor_msgs/Imu whose quantity is not measured
_QUATERNION = ("qx", "qy", "qz", "qw")
_AXES = ("x", "y", "z")
_UNITS = {
    "angular_velocity": "rad/s",
    "specific_force": "m/s²",
    "orientation": "",
    "position": "m",
    "velocity": "m/s",
    "force": "N",
    "torque": "N·m",
    "distance": "m",
    "current": "A",
    "index": "",
}
_IN_NAMES = str.maketrans({"/": "_", "·": "", "²": "2"})

Values = Mapping[str, Sequence[float]]  # by quantity


@dataclass(frozen=True, eq=False)
class MeasuredQuantity:
    """The measurements (k, components) of a quantity, with its SI unit and the names of the components."""

    unit: str
    components: tuple[str, ...]
    values: Array


@dataclass(frozen=True, eq=False)
class SensorTable:
    """The measurements of a sensor in the order of their arrival.

    `times` (k,) are those of arrival and `sampled` (k,) those of the samples, in s. `rows` (k,) are the first states
    that are not earlier than the arrival.
    """

    times: Array
    sampled: Array
    rows: np.ndarray
    quantities: Mapping[str, MeasuredQuantity]

    def held(self, states: int, resets: Sequence[int]) -> dict[str, Array]:
        """Columns (states,) by name and unit: the last measurement that has arrived since the last reset, or nan."""
        last = np.full(states, -1)
        shown = self.rows < states
        last[self.rows[shown]] = np.flatnonzero(shown)
        last = np.maximum.accumulate(last)
        restarted = np.zeros(states, dtype=int)
        restarted[list(resets)] = list(resets)
        restarted = np.maximum.accumulate(restarted)
        valid = (last >= 0) & (self.rows[last] >= restarted)
        found = {"time_s": np.where(valid, self.sampled[last], np.nan)}
        for name, measured in self.quantities.items():
            suffix = f"_{measured.unit.translate(_IN_NAMES)}" if measured.unit else ""
            for component, column in zip(measured.components, measured.values.T, strict=True):
                own = f"{name}_{component}" if component else name
                found[own + suffix] = np.where(valid, column[last], np.nan)
        return found


@dataclass
class SensorTables:
    """Collects the messages of the sensors of a run."""

    recording: Recording
    _readers: dict[str, Callable[[Any], Values]] = field(default_factory=dict)
    _found: dict[str, list[tuple[int, int, int, Values]]] = field(default_factory=dict)
    _mechanism: Mechanism | None = None
    _names: Mapping[str, str] = field(default_factory=dict)  # by the words in topics

    def __post_init__(self) -> None:
        roles = topic_roles(self.recording.topics)
        for name, role in roles.items():
            if role is TopicRole.SENSORS and (reader := _READERS.get(self.recording.topics[name].type)) is not None:
                self._readers[name] = reader
        if self._readers and (mechanism := self.recording.mechanism) is not None:
            self._mechanism = mechanism
            self._names = names_by_topic(sensor.name for sensor in mechanism.sensors)

    def add(self, message: Message, states: Sequence[tuple[int, int]]) -> None:
        """Decode a message, if it is of a sensor.

        :param states: the stamps of the states before it: time in ns and sequence number.
        """
        if message.topic not in self._readers:
            return
        sensor, stamp, values = self.read(message)
        row = len(states) - (1 if states and states[-1][0] == message.time_ns else 0)
        self._found.setdefault(sensor, []).append((message.time_ns, stamp, row, values))

    def read(self, message: Message) -> tuple[str, int, Values]:
        """The sensor of a message, the time of its sample in ns, and the values.

        :raises KeyError: it is not of a sensor.
        """
        reader, decoded = self._readers[message.topic], self.recording.decoded(message)
        stamp = decoded.stamp_ns if isinstance(decoded, cdr.JointStates) else _stamp_ns(decoded)
        topic = message.topic.rpartition("/")[2]
        return self._names.get(topic, topic), stamp, reader(decoded)

    def tables(self, start_ns: int) -> dict[str, SensorTable]:
        """The measurements by the name of the sensor; times are counted from `start_ns`."""
        units = _coordinate_units(self._mechanism)
        found = {}
        for name, messages in sorted(self._found.items()):
            times, stamps, rows, values = zip(*messages, strict=True)
            quantities = {
                quantity: _measured(quantity, [one[quantity] for one in values], units.get(name))
                for quantity in values[0]
            }
            arrival, sampled = ((np.array(column) - start_ns) * 1e-9 for column in (times, stamps))
            found[name] = SensorTable(arrival, sampled, np.array(rows), quantities)
        return found


def _measured(quantity: str, values: Sequence[Sequence[float]], unit: str | None) -> MeasuredQuantity:
    table = np.array(values, dtype=float)
    components = {1: ("",), 3: _AXES, 4: _QUATERNION}[table.shape[1]]
    own = unit if unit and quantity in ("position", "velocity") and table.shape[1] == 1 else None
    return MeasuredQuantity(_UNITS[quantity] if own is None else own, components, table)


def _coordinate_units(mechanism: Mechanism | None) -> dict[str, str]:
    """The units of sensors that measure one quantity of a coordinate, by name."""
    sensors = mechanism.sensors if mechanism else ()
    return {sensor.name: sensor.quantities[0].unit for sensor in sensors if len(sensor.quantities) == 1}


def _stamp_ns(message: Any) -> int:
    return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)


def _vector(vector: Any) -> tuple[float, float, float]:
    return (vector.x, vector.y, vector.z)


def _quaternion(turned: Any) -> tuple[float, float, float, float]:
    return (turned.x, turned.y, turned.z, turned.w)


def _imu(message: Any) -> Values:
    found: dict[str, Sequence[float]] = {}
    if message.orientation_covariance[0] != _UNKNOWN:
        found["orientation"] = _quaternion(message.orientation)
    if message.angular_velocity_covariance[0] != _UNKNOWN:
        found["angular_velocity"] = _vector(message.angular_velocity)
    return found | {"specific_force": _vector(message.linear_acceleration)}


def _wrench(message: Any) -> Values:
    return {"force": _vector(message.wrench.force), "torque": _vector(message.wrench.torque)}


def _joint(message: cdr.JointStates) -> Values:
    position, velocity, effort = (values.tolist() for values in message[3:])
    found = {"position": position[:1], "index": position[1:], "velocity": velocity, "current": effort}
    return {name: values for name, values in found.items() if values}


def _pose(message: Any) -> Values:
    return {"position": _vector(message.pose.position), "orientation": _quaternion(message.pose.orientation)}


def _twist(message: Any) -> Values:
    return {"velocity": _vector(message.twist.linear), "angular_velocity": _vector(message.twist.angular)}


_READERS: Mapping[str, Callable[[Any], Values]] = {
    "sensor_msgs/msg/Imu": _imu,
    "geometry_msgs/msg/WrenchStamped": _wrench,
    "sensor_msgs/msg/JointState": _joint,
    "sensor_msgs/msg/Range": lambda message: {"distance": (message.range,)},
    "geometry_msgs/msg/PoseStamped": _pose,
    "geometry_msgs/msg/TwistStamped": _twist,
    "nav_msgs/msg/Odometry": lambda message: {**_pose(message.pose), **_twist(message.twist)},
}
