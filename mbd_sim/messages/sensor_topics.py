"""The messages of all sensors of a run, with the names of their topics."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.sensors import Encoder
from mbd_sim.messages.sensor_messages import sensor_writer
from mbd_sim.messages.topics import for_each_sensor
from mbd_sim.simulation.compiled_model import Model
from mbd_sim.simulation.sensor_model import INDEX, SensorModel, SensorReading
from mbd_sim.simulation.sensor_samples import Arrival, StateSample


class Measured(NamedTuple):
    """A measurement of a sensor as the message of a topic, and as such."""

    topic: str
    payload: bytes
    sensor: str
    reading: SensorReading


class SensorMessages:
    """Serializes measurements; for one thread."""

    def __init__(self, model: Model, step_size: float, frame_prefix: str = "") -> None:
        """Prepare the messages for steps of `step_size` s; frame names begin with a prefix."""
        sensors = self._sensors = SensorModel(model, model.mechanism, step_size)
        self.names = [topic.name for topic in for_each_sensor(sensors.sensors)]
        self.writers = [sensor_writer(sensors, number, frame_prefix) for number in range(len(sensors.sensors))]
        self._delays_ns = [timing.delay * round(step_size * 1e9) for timing in sensors.timings]

    def prepare(self, y: Array, inputs: Array) -> None:
        """Derive and import everything that measurements need, by those of one state."""
        for number, writer in enumerate(self.writers):
            writer.payload(self._sensors.reading(number, StateSample(0, y, inputs)), 0)

    def measured(self, arrivals: Sequence[Arrival], clock_ns: int) -> Iterator[Measured]:
        """The measurements that arrive at a time in ns; the stamp of their messages is the time of the sample."""
        for number, sample in arrivals:
            reading = self._sensors.reading(number, sample)
            payload = self.writers[number].payload(reading, clock_ns - self._delays_ns[number])
            yield Measured(self.names[number], payload, self._sensors.sensors[number].name, reading)

    def rounding(self, number: int, quantity: str) -> float:
        """By how much a value of a sensor may change because the value before rounding changes in its last bits."""
        sensor = self._sensors.sensors[number]
        if isinstance(sensor, Encoder):
            return 1.0 if quantity == INDEX else sensor.resolution
        by_name = {one.name: errors for one, errors in zip(sensor.quantities, sensor.errors, strict=True)}
        return by_name[quantity].resolution
