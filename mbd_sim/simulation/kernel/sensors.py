"""The measurements of sensors: exact values of a sampled state, and their errors.

States that sensors have sampled are kept until later measurements replace them.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, assert_never

import numpy as np

from mbd_sim.base.errors import MechanismError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.geometry.rotation import of_vector, product
from mbd_sim.base.linear_algebra import added
from mbd_sim.base.linear_algebra import product as matrix_product
from mbd_sim.base.short_repr import record, short_repr
from mbd_sim.mechanism.elements.sensors import (
    ORIENTATION,
    Accelerometer,
    AnySensor,
    Encoder,
    ForceTorque,
    Imu,
    MotorCurrent,
    Odometry,
    PoseSensor,
    RangeFinder,
    SamplingError,
    SamplingSteps,
    Tachometer,
    TwistSensor,
    steps_of,
)
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.simulation.kernel.memory import KernelMemory
from mbd_sim.simulation.kernel.noise import MeasurementErrors, Noise
from mbd_sim.simulation.model.model import Model


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
        groups: dict[tuple[SamplingSteps, int], _SampleGroup] = {}
        for number, (timing, noise) in enumerate(zip(timings, noises, strict=True)):
            key = timing, number if noise.loses_samples else -1
            groups.setdefault(key, _SampleGroup(timing.period, timing.delay, noise)).sensors.append(number)
        self._groups = list(groups.values())
        self._group_of = {number: group for group in self._groups for number in group.sensors}
        self._periods = sorted({timing.period for timing in timings})

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
        """The samples as rows (n, 1 + states + inputs): the step, the state, the inputs; see `restore`."""
        samples = {sample.steps: sample for group in self._groups for sample in group.queue}
        width = 1 + len(self._memory.y) + len(self._memory.inputs)
        rows = [np.concatenate([[steps], samples[steps].y, samples[steps].inputs]) for steps in sorted(samples)]
        return np.array(rows).reshape(len(rows), width)

    def restore(self, table: Array) -> None:
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
class _SampleGroup:
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


INDEX = "index"  # the value of an encoder beside its position
_AXES = 9  # numbers of a rotation matrix


@record
class SensorReading:
    """A measurement: the time in s and the number of its sample, and the values of its quantities by name.

    Values are (3,) in SI units, (4,) for an `orientation` as a unit quaternion (w, x, y, z), and (1,) for a `position`
    or `velocity` of a coordinate, a `current` and a `distance`. An encoder with an index also has `index` (1,): 1 or 0.
    """

    time: float
    sample: int
    values: Mapping[str, Array]

    def __getitem__(self, quantity: str) -> Array:
        return self.values[quantity]


def sampling_steps(mechanism: Mechanism, step: float) -> list[SamplingSteps]:
    """The period and the delay of each sensor in steps.

    :raises MechanismError: a period or a delay is not a whole number of steps.
    """
    found, problems = [], []
    for sensor in mechanism.sensors:
        try:
            found.append(steps_of(sensor.sampling, step))
        except SamplingError as error:
            problems.append(mechanism.source.problem_of(("sensors", sensor.name, error.key), error))
    if problems:
        raise MechanismError(problems)
    return found


class SensorModel:
    """The sensors of a model; each reading is a function of the sampled state and the number of the sample."""

    __repr__ = short_repr

    def __init__(self, model: Model, mechanism: Mechanism, step: float) -> None:
        """Prepare the sensors; not for several threads at once, as random numbers are kept.

        :param mechanism: whose sensors have the errors; it has the same equations as that of the model.
        :param step: in s.
        :raises MechanismError: a period or a delay is not a whole number of steps.
        """
        self.sensors, self.step = mechanism.sensors, step
        self.timings = sampling_steps(mechanism, step)
        self._model = model
        self.noises: list[Noise] = []
        self.errors: list[MeasurementErrors] = []
        self._layouts = [_Layout(sensor) for sensor in self.sensors]
        self._steps = np.empty(1, np.int64)  # this and the next are what the readers read
        self._y, self._inputs = np.empty(len(model.start)), np.empty(len(model.inputs))
        clock, arrays = (self._steps, np.array([step])), (self._y, self._inputs)
        functions = [model.on_request.sensor(sensor.name) for sensor in self.sensors]
        self._readers = [function.bound(clock, arrays, (function.size,)) for function in functions]
        for sensor, timing in zip(self.sensors, self.timings, strict=True):
            counts = [len(quantity.components) for quantity in sensor.quantities]
            noise = Noise(mechanism.sensor_seed, sensor.name, sum(counts), sensor.sampling.drop_out)
            self.noises.append(noise)
            self.errors.append(MeasurementErrors(sensor.errors, counts, timing.period * step, noise))

    def reading(self, number: int, sample: StateSample) -> SensorReading:
        """The measurement of a sensor, by its number, in a sampled state."""
        time = sample.steps * self.step
        index = sample.steps // self.timings[number].period
        exact = self._exact_values(number, time, sample)
        return SensorReading(time, index, self._with_errors(number, exact, index))

    def _exact_values(self, number: int, time: float, sample: StateSample) -> Array:
        sensor, model = self.sensors[number], self._model
        self._steps[0], self._y[:] = sample.steps, sample.y
        self._inputs[:] = model.with_contact_forces(time, sample.y, sample.inputs)
        exact = self._readers[number]()
        match sensor:
            case ForceTorque():
                return self._load(sensor, time, sample, exact)
            case RangeFinder() if sensor.normal is not None:
                distance = float(exact[0]) / float(exact[1]) if exact[1] else math.inf
                return np.array([distance if distance >= 0.0 else math.inf])
            case RangeFinder() | Imu() | Accelerometer() | Encoder() | Tachometer() | MotorCurrent():
                return exact
            case PoseSensor() | TwistSensor() | Odometry():
                return exact
            case _:
                assert_never(sensor)

    def _load(self, sensor: ForceTorque, time: float, sample: StateSample, exact: Array) -> Array:
        """Force and torque in the axes of the sensor's frame; redundant joints share the load."""
        wrench, to_frame = exact[:6], exact[6:].reshape(3, 3)
        if self._model.load_sharing.can_share:
            reaction = self._model.reactions(time, sample.y, sample.inputs)[sensor.joint]
            wrench = np.concatenate([reaction.force, reaction.moment])
        return np.concatenate([matrix_product(to_frame, wrench[:3]), matrix_product(to_frame, wrench[3:])])

    def _with_errors(self, number: int, exact: Array, sample: int) -> dict[str, Array]:
        sensor, errors, layout = self.sensors[number], self.errors[number], self._layouts[number]
        added = errors.added(sample)
        values = exact[layout.exact] if added is None else exact[layout.exact] + added
        values = errors.rounded_and_limited(values)
        found = {name: values[place] for name, place in layout.places.items()}
        if layout.axes is not None:
            place = layout.places[ORIENTATION.name]
            error = None if added is None else added[place]
            found[ORIENTATION.name] = _turned(exact[layout.axes].tolist(), error)
        return _as_signal(sensor, found)


class _Layout:
    """Where the values of the quantities are: among the components of the errors, and among the exact values.

    `exact` are the indices of the exact values of all components; those of an orientation are not used. `axes` is the
    place of its rotation matrix.
    """

    def __init__(self, sensor: AnySensor) -> None:
        self.places: dict[str, slice] = {}
        self.axes: slice | None = None
        indices: list[int] = []
        first = 0
        for quantity in sensor.quantities:
            size = len(quantity.components)
            self.places[quantity.name] = slice(len(indices), len(indices) + size)
            indices += range(first, first + size)
            if quantity is ORIENTATION:
                self.axes = slice(first, first + _AXES)
                size = _AXES
            first += size
        self.exact = np.array(indices, dtype=np.intp)


def _turned(columns: list[float], error: Array | None) -> Array:
    """The quaternion (w, x, y, z) of a rotation matrix, column by column, turned about its own axes by an angle."""
    xx, yx, zx, xy, yy, zy, xz, yz, zz = columns
    ways = (
        (1.0 + xx + yy + zz, zy - yz, xz - zx, yx - xy),
        (zy - yz, 1.0 + xx - yy - zz, xy + yx, xz + zx),
        (xz - zx, xy + yx, 1.0 - xx + yy - zz, yz + zy),
        (yx - xy, xz + zx, yz + zy, 1.0 - xx - yy + zz),
    )
    way = max(range(4), key=lambda number: ways[number][number])
    length = math.sqrt(added(value * value for value in ways[way]))
    quaternion = np.array(ways[way]) / length
    return quaternion if error is None else product(quaternion, of_vector(error))


def _as_signal(sensor: AnySensor, values: dict[str, Array]) -> dict[str, Array]:
    """The values as the device gives them: counts of an encoder, and the range of a range finder."""
    match sensor:
        case Encoder():
            count = math.floor(float(values["position"][0]) / sensor.resolution)
            found = {"position": np.array([count * sensor.resolution])}
            if sensor.index is not None:
                at_index = count - math.floor(sensor.index / sensor.resolution)
                in_turn = at_index if sensor.counts is None else at_index % sensor.counts
                found[INDEX] = np.array([float(in_turn == 0)])
            return found
        case RangeFinder():
            distance = float(values["distance"][0])
            if distance > sensor.most:
                distance = math.inf
            return {"distance": np.array([-math.inf if distance < sensor.least else distance])}
        case Imu() | Accelerometer() | ForceTorque() | Tachometer() | MotorCurrent():
            return values
        case PoseSensor() | TwistSensor() | Odometry():
            return values
        case _:
            assert_never(sensor)
