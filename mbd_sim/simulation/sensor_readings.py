"""The sensors of a simulation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from mbd_sim import simulation
from mbd_sim.geometry.pose import Array
from mbd_sim.simulation.run_state import RunState

if TYPE_CHECKING:
    from mbd_sim.simulation.sensor_model import SensorModel, SensorReading
    from mbd_sim.simulation.sensor_samples import Arrival, SensorSamples

NO_SAMPLES = np.empty((0, 0))


class SensorReadings(RunState):
    """The part of a `Simulation` that samples its state for the sensors of the mechanism."""

    sensor_model: SensorModel | None = None
    _samples: SensorSamples | None = None

    def sensors(self) -> Mapping[str, SensorReading]:
        """The last measurement of each sensor that has arrived, by name; sensors without any yet are left out.

        A sensor measures at time zero and then at its rate, with the inputs that have acted up to that moment. The same
        run gives the same noise, also after a reset, a restored snapshot, or in another process.
        """
        if self.sensor_model is None or self._samples is None:
            return {}
        return {
            sensor.name: self.sensor_model.reading(number, sample)
            for number, (sensor, sample) in enumerate(
                zip(self.sensor_model.sensors, self._samples.latest(), strict=True)
            )
            if sample is not None
        }

    @property
    def arrivals(self) -> list[Arrival]:
        """The measurements that arrive at the present step."""
        return [] if self._samples is None else self._samples.arrivals()

    def steps_to_arrival(self, at_most: int) -> int:
        """The number of steps to the next measurement that may arrive, or fewer."""
        return at_most if self._samples is None else self._samples.steps_to_arrival(at_most)

    @property
    def samples(self) -> Array:
        """The sampled states that the present and later measurements depend on: see `SensorSamples.table`."""
        return NO_SAMPLES if self._samples is None else self._samples.table()

    def _prepare_sensors(self) -> None:
        """Compile the sensors, if there are any.

        :raises MechanismError: a period or a delay is not a whole number of steps.
        """
        if self.mechanism.sensors:
            sensors = self.sensor_model = simulation.SensorModel(self.model, self.mechanism, self.step_size)
            assert self.model.sensor_readers
            self._samples = simulation.SensorSamples(sensors.timings, sensors.noises, self._memory)

    def _sampled(self, parts: Iterator[int] | Sequence[int]) -> Iterator[int] | Sequence[int]:
        """Numbers of steps, divided where a sensor measures."""
        return parts if self._samples is None else self._samples.divided(parts)

    def _restart_samples(self, table: Array | None = None, *, keep: bool = False) -> None:
        """Begin with the samples of a table, or with those of the present state; `keep` the earlier ones."""
        if self._samples is None:
            return
        if table is not None:
            self._samples.load(table)
            return
        if not keep:
            self._samples.clear()
        self._samples.take()
