"""What was measured of a run, and its residuals: the deviations of a trajectory from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.errors import InputError, nearest
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.geometry.rotation import skew
from mbd_sim.base.short_repr import record
from mbd_sim.studies.optimization.casadi_functions import CasadiFunctions
from mbd_sim.studies.optimization.sensitivities import Sensitivities


@record
class MeasuredRun:
    """What was measured every `step` s from the time `start` on, n + 1 times, in SI units; nan where nothing was.

    - `states` (n + 1, nx): q, u and states of actuators. Quaternions have any length. None: only outputs were measured.
    - `efforts` (n, ne): efforts and commands of actuators, constant between two measurements.
    - `outputs`: measured values by name: `joints.elbow.position` and `joints.elbow.velocity` (n + 1,) of a coordinate,
      `joints.ball.orientation` (n + 1, 4) as quaternions, and `points.rod.tip.position` (n + 1, 3) in ground's axes.
    - `first_state` (nx,): a first guess of the start state, by default what was measured, or else that of the file.
    """

    step: float
    states: Array | None
    efforts: Array
    start: float = 0.0
    outputs: Mapping[str, Array] = field(default_factory=dict)
    first_state: Array | None = None

    def __post_init__(self) -> None:
        """:raises InputError: states or efforts are not tables of numbers, which may be given as lists."""
        for name in ("states", "efforts"):
            given = getattr(self, name)
            table = np.asarray(given, dtype=float)
            if table.ndim != 2 and not (name == "states" and given is None):
                raise InputError(f"{name} has the shape {table.shape}", "Give a row for each time.")
            object.__setattr__(self, name, None if given is None else table)


@dataclass(frozen=True, slots=True)
class _Quantity:
    """Measured values (n + 1, k) of components of the state or, by its name, of a point."""

    names: tuple[str, ...]
    values: Array
    components: slice
    point: str = ""
    rotation: bool = False


class Residuals:
    """The residuals of a run. `names` (c,) are those of its channels: numbers that are measured at once.

    A channel is a component of the state or of an output. That of an orientation is the rotation from the measured to
    the computed one, about the axes of the part, in rad; it has three channels.
    """

    def __init__(self, functions: CasadiFunctions, run: MeasuredRun) -> None:
        """:raises InputError: shapes are wrong, an output does not exist, or nothing is measured."""
        self.run, self._functions = run, functions
        self._quantities = [*_of_states(functions, run), *_of_outputs(functions, run)]
        self.names = tuple(name for quantity in self._quantities for name in quantity.names)
        measured = [np.any(np.isfinite(quantity.values), axis=1) for quantity in self._quantities]
        if any(np.any(np.isinf(quantity.values)) for quantity in self._quantities):
            raise InputError("some of the measurements are infinite", "Give nan where nothing was measured.")
        if run.first_state is not None and np.shape(run.first_state) != functions.start.shape:
            shape = np.shape(run.first_state)
            raise InputError(f"first_state has the shape {shape}", f"Give {functions.start.shape}.")
        if not measured or not np.any(measured):
            raise InputError("a run without measurements", "Give states or outputs that are not nan.")
        self.rows = np.flatnonzero(np.any(measured, axis=0))
        if self.rows[-1] == 0:
            raise InputError("a run that is measured only at its start", "Give what was measured after some steps.")
        self.points = tuple(quantity.point for quantity in self._quantities if quantity.point)

    @property
    def spread(self) -> Array:
        """The standard deviation (c,) of what is measured in each channel; 1 for orientations and for constants."""
        found = np.ones(len(self.names))
        channel = 0
        for quantity in self._quantities:
            for column in () if quantity.rotation else quantity.values.T:
                known = column[np.isfinite(column)]
                if len(known) and (spread := np.std(known)) > 0.0:
                    found[channel] = spread
                channel += 1
            channel += 3 * quantity.rotation
        return found

    def starts(self, interval: int) -> list[int]:
        """The numbers of the steps at which trajectories begin, with the last one of the run as their end.

        They begin where all states are measured, at least `interval` steps apart, and before what is measured earlier.
        """
        last = int(self.rows[-1])
        if self.run.states is None:
            return [0, last]
        whole = np.flatnonzero(np.all(np.isfinite(self.run.states), axis=1)).tolist()
        found: list[int] = []
        for row in whole:
            if row < last and (not found or row >= found[-1] + interval):
                found.append(row)
        if not found or self.rows[0] < found[0]:
            found.insert(0, 0)
        return [*found, last] if found[-1] < last else found

    def first_guess(self, row: int) -> Array:
        """The state (nx,) to begin with at a step."""
        if self.run.states is not None and np.all(np.isfinite(self.run.states[row])):
            return np.array(self.run.states[row], dtype=float)
        return np.array(self._functions.start if self.run.first_state is None else self.run.first_state, dtype=float)

    def of(
        self, rows: NDArray[np.intp], found: Sensitivities, basis: Array
    ) -> tuple[Array, Array, Array, NDArray[np.intp]]:
        """The residuals (k,) of a trajectory at some rows, their derivatives, and their channels (k,).

        The derivatives are those by parameters (k, np), and by a change of the start state along `basis` (nx, d).
        """
        assert found.dx.by_start is not None
        by = np.concatenate([found.dx.by_parameters, found.dx.by_start @ basis], axis=2)
        values, slopes = [], []
        for quantity in self._quantities:
            measured = quantity.values[rows]
            if quantity.rotation:
                matrix = _rotation_from(measured, found.x[:, quantity.components])
                values.append(np.einsum("nij,nj->ni", matrix, found.x[:, quantity.components]))
                slopes.append(matrix @ by[:, quantity.components])
            elif quantity.point:
                place, own = found.points[quantity.point]
                assert own.by_start is not None
                values.append(place - measured)
                slopes.append(np.concatenate([own.by_parameters, own.by_start @ basis], axis=2))
            else:
                values.append(found.x[:, quantity.components] - measured)
                slopes.append(by[:, quantity.components])
        residuals, slope = np.concatenate(values, axis=1), np.concatenate(slopes, axis=1)
        known = np.isfinite(residuals)
        channels = np.broadcast_to(np.arange(len(self.names)), residuals.shape)[known]
        count = found.dx.by_parameters.shape[2]
        return residuals[known], slope[known][:, :count], slope[known][:, count:], channels

    def schedule(self, first: int, last: int) -> list[tuple[int, Array]]:
        """The efforts from a step on, each with the number of steps after which it acts."""
        efforts = self.run.efforts[first:last]
        changes = np.flatnonzero(np.any(efforts[1:] != efforts[:-1], axis=1)) + 1
        return [(int(step), efforts[step]) for step in (0, *changes)]


def _of_states(functions: CasadiFunctions, run: MeasuredRun) -> list[_Quantity]:
    count, steps = len(functions.start), len(run.efforts)
    if run.efforts.shape != (steps, len(functions.efforts)) or (
        run.states is not None and run.states.shape != (steps + 1, count)
    ):
        states = "none" if run.states is None else str(run.states.shape)
        wanted = f"states of the shape (n + 1, {count}) and efforts of the shape (n, {len(functions.efforts)})"
        raise InputError(f"measured are states {states} and efforts {run.efforts.shape}", f"Give {wanted}.")
    if not np.all(np.isfinite(run.efforts)):
        raise InputError("some of the efforts are not finite numbers", "Give the efforts that acted in each step.")
    if run.states is None:
        return []
    found, names = [], _component_names(functions)
    bounds = sorted({0, count, *(edge for first in _quaternions(functions).values() for edge in (first, first + 4))})
    for first, beyond in pairwise(bounds):
        rotation = first in _quaternions(functions).values()
        own = names[first : first + 3] if rotation else names[first:beyond]
        found.append(_Quantity(tuple(own), run.states[:, first:beyond], slice(first, beyond), rotation=rotation))
    return found


def _of_outputs(functions: CasadiFunctions, run: MeasuredRun) -> list[_Quantity]:
    names, steps = _component_names(functions), len(run.efforts)
    orientations = {f"joints.{joint}.orientation": first for joint, first in _quaternions(functions).items()}
    points = {f"points.{name}.position": name for name in functions.points}
    found = []
    for name, given in run.outputs.items():
        values = np.asarray(given, dtype=float)
        width = 4 if name in orientations else 3 if name in points else 1
        if name in orientations:
            own = tuple(f"{name}.{axis}" for axis in "xyz")
            quantity = _Quantity(own, values, slice(orientations[name], orientations[name] + 4), rotation=True)
        elif name in points:
            quantity = _Quantity(tuple(f"{name}.{axis}" for axis in "xyz"), values, slice(0, 0), point=points[name])
        elif name in names and ".orientation." not in name:
            place = names.index(name)
            quantity = _Quantity((name,), values[:, None] if values.ndim == 1 else values, slice(place, place + 1))
        else:
            known = [*(one for one in names if ".orientation." not in one), *orientations, *points]
            raise InputError(f"there is no output '{name}'", nearest(name, known))
        if quantity.values.shape != (steps + 1, width):
            wanted = (steps + 1,) if width == 1 else (steps + 1, width)
            raise InputError(f"output '{name}' has the shape {values.shape}", f"Give {wanted} for {steps} efforts.")
        found.append(quantity)
    return found


def _component_names(functions: CasadiFunctions) -> list[str]:
    """A name for each component of the state; the first three of a quaternion have those of its channels."""
    mechanism, layout = functions.mechanism, functions.equations.layout
    names = [""] * layout.nq
    quaternions = _quaternions(functions)
    for joint, span in layout.q.items():
        for index in range(span.start, span.stop):
            number = index - span.start
            first = quaternions.get(joint, span.stop)
            if index < first:
                names[index] = f"joints.{mechanism.joints[joint].motion_names[number]}.position"
            else:
                names[index] = f"joints.{joint}.orientation.{'xyz '[index - first]}"
    for joint, span in layout.drives.items():
        names[span] = [f"drives.{joint}.{state}" for state in ("position", "velocity", "acceleration")]
    speeds = [f"joints.{name}.velocity" for name in functions.coordinates]
    return [*names, *speeds, *(f"actuators.{state}" for state in functions.actuator_states)]


def _quaternions(functions: CasadiFunctions) -> dict[str, int]:
    """The index in q of the quaternion of each joint that has one."""
    layout, joints = functions.equations.layout, functions.mechanism.joints
    return {
        joint: span.start + offset
        for joint, span in layout.q.items()
        if (offset := joints[joint].kind.quaternion) is not None
    }


def _rotation_from(measured: Array, computed: Array) -> Array:
    """Matrices (n, 3, 4) B, with B q the rotation vector (small) from measured to computed orientations (n, 4)."""
    unit = measured / np.linalg.norm(measured, axis=1, keepdims=True)
    unit = np.where(np.sum(unit * computed, axis=1, keepdims=True) < 0.0, -unit, unit)
    found = np.empty((len(unit), 3, 4))
    for one, (w, *v) in zip(found, unit.tolist(), strict=True):
        one[:, 0], one[:, 1:] = -2.0 * np.array(v), 2.0 * (w * np.eye(3) - skew(np.array(v)))
    return found


def measured_runs(data: MeasuredRun | Sequence[MeasuredRun]) -> list[MeasuredRun]:
    """The runs as a list.

    :raises InputError: there are none.
    """
    runs = [data] if isinstance(data, MeasuredRun) else list(data)
    if not runs:
        raise InputError("there is nothing to identify", "Give parameters, measured runs, and a positive interval.")
    return runs
