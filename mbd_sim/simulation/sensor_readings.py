"""The sensors of a simulation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.simulation.compiled_model import Model
from mbd_sim.simulation.kernel_memory import KernelMemory

if TYPE_CHECKING:
    from mbd_sim.simulation.sensor_model import SensorModel, SensorReading
    from mbd_sim.simulation.sensor_samples import Arrival, SensorSamples

NO_SAMPLES = np.empty((0, 0))


class RunSensors:
    """Samples the state of a simulation for the sensors of its mechanism, if it has any: then `model` is not None."""

    model: SensorModel | None = None
    _samples: SensorSamples | None = None

    def __init__(self, model: Model, mechanism: Mechanism, step: float, memory: KernelMemory) -> None:
        """Compile the sensors; `step` is in s.

        :raises MechanismError: a period or a delay is not a whole number of steps.
        """
        if mechanism.sensors:
            from mbd_sim.simulation.sensor_model import SensorModel
            from mbd_sim.simulation.sensor_samples import SensorSamples

            self.model = SensorModel(model, mechanism, step)
            self._samples = SensorSamples(self.model.timings, self.model.noises, memory)

    def readings(self) -> Mapping[str, SensorReading]:
        """The last measurement of each sensor that has arrived, by name."""
        if self.model is None or self._samples is None:
            return {}
        pairs = zip(self.model.sensors, self._samples.latest(), strict=True)
        return {
            sensor.name: self.model.reading(number, sample)
            for number, (sensor, sample) in enumerate(pairs)
            if sample is not None
        }

    def arrivals(self) -> list[Arrival]:
        """The measurements that arrive at the present step."""
        return [] if self._samples is None else self._samples.arrivals()

    def steps_to_arrival(self, at_most: int) -> int:
        """The number of steps to the next measurement that may arrive, or fewer."""
        return at_most if self._samples is None else self._samples.steps_to_arrival(at_most)

    def table(self) -> Array:
        """The sampled states: see `SensorSamples.table`."""
        return NO_SAMPLES if self._samples is None else self._samples.table()

    def divided(self, parts: Iterator[int] | Sequence[int]) -> Iterator[int] | Sequence[int]:
        """Numbers of steps, divided where a sensor measures."""
        return parts if self._samples is None else self._samples.divided(parts)

    def restart(self, table: Array | None = None, *, keep: bool = False) -> None:
        """Begin with the samples of a table, or with those of the present state; `keep` the earlier ones."""
        if self._samples is None:
            return
        if table is not None:
            self._samples.load(table)
            return
        if not keep:
            self._samples.clear()
        self._samples.take()
