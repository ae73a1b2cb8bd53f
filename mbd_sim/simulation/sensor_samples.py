"""The states that sensors have sampled and that are not yet replaced by later measurements."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.sampling import SamplingSteps
from mbd_sim.sensing.noise import Noise
from mbd_sim.short_repr import short_repr
from mbd_sim.simulation.kernel_memory import KernelMemory


@dataclass(frozen=True, eq=False, slots=True)
class StateSample:
    """A state at the moment of a measurement: steps since time zero, the state y and the inputs of the equations."""

    steps: int
    y: Array
    inputs: Array

    __repr__ = short_repr


class Arrival(NamedTuple):
    """A measurement that arrives: the number of its sensor, and the state that was measured."""

    sensor: int
    sample: StateSample

    def __repr__(self) -> str:
        return short_repr(self)


class SensorSamples:
    """Samples the state for each sensor in its period, and keeps the samples until they have arrived.

    A sample stays until a later one has arrived, so that `latest` has an answer at any step.
    """

    def __init__(self, timings: Sequence[SamplingSteps], noises: Sequence[Noise], memory: KernelMemory) -> None:
        self._memory = memory
        groups: dict[tuple[SamplingSteps, int], _Group] = {}
        for number, (timing, noise) in enumerate(zip(timings, noises, strict=True)):
            key = timing, number if noise.loses_samples else -1
            groups.setdefault(key, _Group(*timing, noise)).sensors.append(number)
        self._groups = list(groups.values())
        self._group_of = {number: group for group in self._groups for number in group.sensors}
        self._periods = sorted({period for period, _ in timings})

    def clear(self) -> None:
        """Forget all samples."""
        for group in self._groups:
            group.queue.clear()

    def take(self) -> None:
        """Sample the present state for the sensors whose turn it is; an earlier sample of the same step is replaced."""
        steps = self._memory.steps
        sample: StateSample | None = None
        for group in self._groups:
            if steps % group.period == 0:
                sample = sample or StateSample(steps, self._memory.y.copy(), self._memory.inputs.copy())
                group.add(sample)
                group.drop_replaced(steps)

    def divided(self, parts: Iterator[int] | Sequence[int]) -> Iterator[int]:
        """Divide numbers of steps so that each sample is at the end of a part; the state is sampled after each."""
        for part in parts:
            while part > 0:
                steps = self._memory.steps
                taken = min([part, *[period - steps % period for period in self._periods]])
                yield taken
                self.take()
                part -= taken

    def arrivals(self) -> list[Arrival]:
        """The measurements that arrive at the present step, in the order of the sensors."""
        steps, found = self._memory.steps, list[Arrival]()
        for group in self._groups:
            if (sample := group.arriving(steps)) is not None:
                found += [Arrival(number, sample) for number in group.sensors]
        return sorted(found, key=lambda arrival: arrival.sensor)

    def steps_to_arrival(self, at_most: int) -> int:
        """The number of steps to the next one at which a measurement may arrive."""
        steps = self._memory.steps
        return min([at_most, *[group.period - (steps - group.delay) % group.period for group in self._groups]])

    def latest(self) -> list[StateSample | None]:
        """For each sensor the last sample that has arrived."""
        steps = self._memory.steps
        return [self._group_of[number].latest(steps) for number in sorted(self._group_of)]

    def table(self) -> Array:
        """The samples as rows (n, 1 + states + inputs): the step, the state, the inputs; see `load`."""
        samples = {sample.steps: sample for group in self._groups for sample in group.queue}
        width = 1 + len(self._memory.y) + len(self._memory.inputs)
        rows = [np.concatenate([[steps], samples[steps].y, samples[steps].inputs]) for steps in sorted(samples)]
        return np.array(rows).reshape(len(rows), width)

    def load(self, table: Array) -> None:
        """Replace all samples by those of a `table` from the present step."""
        self.clear()
        size = len(self._memory.y)
        for row in table:
            sample = StateSample(int(row[0]), row[1 : 1 + size].copy(), row[1 + size :].copy())
            for group in self._groups:
                if sample.steps % group.period == 0:
                    group.add(sample)
        for group in self._groups:
            group.drop_replaced(self._memory.steps)


@dataclass(eq=False)
class _Group:
    """Sensors that measure at the same times, and their samples; a sensor that loses samples is alone."""

    period: int
    delay: int
    noise: Noise
    sensors: list[int] = field(default_factory=list)
    queue: deque[StateSample] = field(default_factory=deque)

    def add(self, sample: StateSample) -> None:
        """Add a sample, unless it is lost; it replaces one of the same step."""
        if self.queue and self.queue[-1].steps == sample.steps:
            self.queue.pop()
        if not self.noise.is_lost(sample.steps // self.period):
            self.queue.append(sample)

    def arriving(self, steps: int) -> StateSample | None:
        """The sample that arrives at a step."""
        measured = steps - self.delay
        return next((sample for sample in self.queue if sample.steps == measured), None)

    def latest(self, steps: int) -> StateSample | None:
        """The last sample that has arrived at a step."""
        self.drop_replaced(steps)
        return self.queue[0] if self.queue and self.queue[0].steps + self.delay <= steps else None

    def drop_replaced(self, steps: int) -> None:
        """Forget samples that arrived before another one that has arrived."""
        while len(self.queue) > 1 and self.queue[1].steps <= steps - self.delay:
            self.queue.popleft()
