"""The measurements of sensors: exact values of a sampled state, and their errors."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import assert_never

import numpy as np

from mbd_sim.errors import MechanismError
from mbd_sim.geometry.pose import Array
from mbd_sim.geometry.rotation import of_vector, product
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.mechanism.sampling import SamplingError, SamplingSteps, steps_of
from mbd_sim.mechanism.sensors import (
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
    Tachometer,
    TwistSensor,
)
from mbd_sim.sensing.measurement_errors import MeasurementErrors
from mbd_sim.sensing.noise import Noise
from mbd_sim.short_repr import short_repr
from mbd_sim.simulation.compiled_model import Model
from mbd_sim.simulation.sensor_samples import StateSample

INDEX = "index"  # the value of an encoder beside its position
_AXES = 9  # numbers of a rotation matrix


@dataclass(frozen=True, eq=False)
class SensorReading:
    """A measurement: the time in s and the number of its sample, and the values of its quantities by name.

    Values are (3,) in SI units, (4,) for an `orientation` as a unit quaternion (w, x, y, z), and (1,) for a `position`
    or `velocity` of a coordinate, a `current` and a `distance`. An encoder with an index also has `index` (1,): 1 or 0.
    """

    time: float
    sample: int
    values: Mapping[str, Array]

    __repr__ = short_repr

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
        sizes = len(model.start), len(model.inputs)
        self._readers = [model.sensor_readers.bound(sensor.name, *sizes) for sensor in self.sensors]
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
        given = model.with_contact_forces(time, sample.y, sample.inputs)
        exact = self._readers[number].read(time, sample.y, given)
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
        return np.concatenate([to_frame @ wrench[:3], to_frame @ wrench[3:]])

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
    length = math.sqrt(sum(value * value for value in ways[way]))
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
