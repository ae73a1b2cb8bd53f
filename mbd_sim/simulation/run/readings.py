"""Readings of a simulation: those of compiled functions, and those of its sensors.

Compiled functions are bound to the memory of the simulation, each when it is first read.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.simulation.kernel.memory import KernelMemory
from mbd_sim.simulation.model.model import Model
from mbd_sim.simulation.model.state_records import Reaction

if TYPE_CHECKING:
    from mbd_sim.simulation.kernel.sensors import Arrival, SensorModel, SensorReading, SensorSamples


# Instructions of derivatives up to which they are compiled, within about a second. Larger ones would take some seconds,
# which pay off after ten thousand calls; to compile them then would change the bits of results from call to call.
COMPILED = 15_000


class CompiledReadings:
    """Functions of the present state of a simulation; None where a reading is not compiled."""

    def __init__(self, model: Model, memory: KernelMemory) -> None:
        self._model, self._memory = model, memory
        self._arrays = memory.y, memory.inputs

    @cached_property
    def poses(self) -> Callable[[], dict[str, Pose]]:
        """The pose of each part in ground's frame."""
        memory, names = self._memory, self._model.part_names
        reader = memory.reader("poses", len(names) * 12)
        return reader.bound_records(memory.clock, memory.arguments("poses"), names, Pose, ((3,), (3, 3)))

    @cached_property
    def derivatives(self) -> Callable[[], Array] | None:
        """The derivatives of the equations; None if compiling them would take too long."""
        function = self._model.equations.derivatives
        if function.n_instructions() > COMPILED:
            return None
        return self._model.on_request.derivatives().bound(self._memory.clock, self._arrays, (-1, function.size1_out(0)))

    @cached_property
    def multipliers(self) -> Callable[[], Array] | None:
        """The multipliers of all rows; None with contacts, or if they are not read by a compiled function."""
        model = self._model
        if model.one_sided is not None or not model.compiles_multipliers:
            return None
        return model.on_request.multipliers().bound(self._memory.clock, self._arrays, (len(model.row_names),))

    @cached_property
    def reactions(self) -> Callable[[], dict[str, Reaction]] | None:
        """The loads of the joints; None with contacts, or if they are not compiled."""
        model, clock = self._model, self._memory.clock
        names = (*model.mechanism.joints, *model.mechanism.closing)
        if model.one_sided is not None:
            return None
        if not model.shares_load:
            return model.on_request.reactions().bound_records(clock, self._arrays, names, Reaction, ((3,), (3,)))
        sharing = model.load_sharing
        if (read := model.load_paths.bound(clock, self._arrays)) is None:
            return None
        return lambda: {
            name: Reaction(row[:3], row[3:]) for name, row in zip(names, sharing.shared_reactions(read()), strict=True)
        }


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
            from mbd_sim.simulation.kernel.sensors import SensorModel, SensorSamples

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
