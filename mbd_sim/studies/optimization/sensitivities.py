"""Trajectories with their derivatives by parameters, start values and efforts (forward sensitivities).

The derivatives are those of the computed trajectory, exact up to round-off, and so differ from those of the exact one
as the states do: one compiled kernel integrates both.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from itertools import pairwise

import casadi as ca
import numpy as np

from mbd_sim.base.errors import DivergedError, InputError, counted
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.interrupts import interruptible
from mbd_sim.base.short_repr import record, short_repr
from mbd_sim.files.checks.override import with_values
from mbd_sim.mechanism.mechanism import Mechanism, require_mechanism
from mbd_sim.simulation.run.simulation import BaseSimulation
from mbd_sim.studies.optimization.casadi_functions import CasadiFunctions, casadi_functions
from mbd_sim.studies.optimization.start_projection import StartProjection
from mbd_sim.studies.optimization.tangent_kernel import TangentKernel, tangent_method


@record
class Derivatives:
    """Derivatives of a quantity of k numbers at n times, in SI units.

    - `by_parameters` (n, k, np).
    - `by_start` (n, k, nx): by the start state (q, u, states of actuators), before it is moved onto constraints.
    - `by_efforts` (n, k, m, ne): by the efforts, and commands of actuators, of each of m intervals.

    What was not asked for is None.
    """

    by_parameters: Array
    by_start: Array | None
    by_efforts: Array | None

    def of(self, numbers: slice, times: slice = slice(None)) -> Derivatives:
        """The derivatives of some of the numbers, at some of the times, as views."""
        start, efforts = (
            None if found is None else found[times, numbers] for found in (self.by_start, self.by_efforts)
        )
        return Derivatives(self.by_parameters[times, numbers], start, efforts)


@record
class Sensitivities:
    """A trajectory with its derivatives.

    `t` (n,) are the times in s, and `x` (n, nx) the states (q, u, states of actuators), of which `q` (n, nq) and `u`
    (n, nv) are views. `dx`, `dq` and `du` are their derivatives. `points` are the positions (n, 3) of points in m, in
    ground's axes, with their derivatives, by name. `parameters` are the names of the parameters.
    """

    parameters: tuple[str, ...]
    t: Array
    x: Array
    dx: Derivatives
    points: Mapping[str, tuple[Array, Derivatives]]
    _nq: int = field(repr=False)
    _nv: int = field(repr=False)

    def at(self, times: slice) -> Sensitivities:
        """Views of the results at some of the times."""
        points = {name: (place[times], own.of(slice(None), times)) for name, (place, own) in self.points.items()}
        dx = self.dx.of(slice(None), times)
        return Sensitivities(self.parameters, self.t[times], self.x[times], dx, points, self._nq, self._nv)

    @property
    def q(self) -> Array:
        """The coordinates (n, nq)."""
        return self.x[:, : self._nq]

    @property
    def u(self) -> Array:
        """The speeds (n, nv)."""
        return self.x[:, self._nq : self._nq + self._nv]

    @property
    def dq(self) -> Derivatives:
        """The derivatives of q."""
        return self.dx.of(slice(0, self._nq))

    @property
    def du(self) -> Derivatives:
        """The derivatives of u."""
        return self.dx.of(slice(self._nq, self._nq + self._nv))


class SensitivityModel:
    """A mechanism compiled for trajectories with derivatives; it can be run for any start, efforts and parameters.

    `functions` are its equations, with the `start`, `efforts` and `values` of the file; `method` is the name of the
    method of integration, and `step` its step in s.

    Start values and parameters are independent of each other: the start state is moved onto the constraints as by
    `BaseSimulation.reset`, and where a length changes, onto those with this length.
    """

    __repr__ = short_repr

    @interruptible()
    def __init__(
        self,
        mechanism: Mechanism,
        parameters: Sequence[str] = (),
        *,
        method: str | None = None,
        step: float | None = None,
        by_start: bool = True,
        by_efforts: bool = True,
    ) -> None:
        """Compile the equations of a mechanism with their derivatives.

        :param parameters: keys of numbers of its file, as for `casadi_functions`: masses, lengths, stiffnesses.
        :param method: of integration, by default that of the file.
        :param step: in s, by default that of the file.
        :param by_start: whether there are derivatives by the start state.
        :param by_efforts: whether there are derivatives by efforts and commands of actuators.
        :raises MechanismError: see `casadi_functions`; among others, with one-sided elements trajectories have impacts
            and switches, across which derivatives jump.
        :raises InputError: the method is `rosenbrock_w`, or the step is not positive.
        """
        self.step = require_mechanism(mechanism).step if step is None else float(step)
        if not 0.0 < self.step < np.inf:
            raise InputError(f"a step of {step} s is not positive", "Give a positive step in s.")
        self.functions: CasadiFunctions = casadi_functions(mechanism, parameters)
        self.by_start, self.by_efforts = by_start, by_efforts
        chosen = tangent_method(self.functions, method, self.step)
        # Derivatives by efforts of several intervals follow by the chain rule, from those by the state between them.
        self._kernel = TangentKernel(self.functions, chosen, by_start=by_start or by_efforts, by_efforts=by_efforts)
        self._start, self.method = StartProjection(self.functions), chosen.name

    def run(
        self,
        steps: int,
        *,
        t0: float = 0.0,
        x0: Array | Sequence[float] | None = None,
        efforts: Array | Sequence[float] | Sequence[Sequence[float]] | None = None,
        parameters: Array | Sequence[float] | None = None,
        every: int = 1,
        points: Sequence[str] = (),
    ) -> Sensitivities:
        """A trajectory of some steps with its derivatives.

        :param t0: time at the start in s.
        :param x0: (nx,) start state (q, u, states of actuators), by default that of the file.
        :param efforts: (ne,) constant, or (m, ne) for m intervals of equal length: in N and N·m, followed by the
            commands of actuators. By default those before the first command, zero for efforts.
        :param parameters: (np,) in SI units, by default those of the file.
        :param every: number of steps between two results.
        :param points: names of points whose positions are wanted, such as `rod.tip`.
        :raises InputError: a shape is wrong, the intervals do not divide the steps, no state near x0 closes the loops,
            or there is no such point.
        :raises DivergedError: the state became infinite.
        """
        own = self.functions
        e = np.atleast_2d(_numbers("efforts", own.efforts if efforts is None else efforts))
        x = _numbers("x0", own.start if x0 is None else x0)
        p = _numbers("parameters", own.values if parameters is None else parameters)
        self._require_shapes(steps, every, x, e, p)
        schedule = [(number * (steps // len(e)), effort) for number, effort in enumerate(e)]
        return self.at_steps(
            sorted({*range(0, steps + 1, every), steps}), schedule, t0=t0, x0=x, parameters=p, points=points
        )

    def at_steps(
        self,
        results: Sequence[int],
        schedule: Sequence[tuple[int, Array]],
        *,
        t0: float,
        x0: Array,
        parameters: Array,
        points: Sequence[str] = (),
    ) -> Sensitivities:
        """The sensitivities after some numbers of steps, under efforts that change at any step.

        :param results: increasing, from 0 on; the last one is the end.
        :param schedule: the efforts (ne,), each with the number of steps after which it acts, from 0 on.
        :raises InputError: these numbers do not increase from 0, or see `run`.
        :raises DivergedError: the state became infinite.
        """
        for name, numbers in (("results", list(results)), ("schedule", [step for step, _ in schedule])):
            if numbers[:1] != [0] or any(after <= before for before, after in pairwise(numbers)):
                raise InputError(f"the steps of {name} do not increase from 0", "Give numbers of steps: 0, 10, 20.")
        x, by_x, by_p = self._start.consistent(t0, x0, parameters)
        t = t0 + self.step * np.array(results)
        x, dx = self._integrated(t0, (x, by_x, by_p), schedule, parameters, results)
        at = {name: self._point(name, t, x, dx, parameters) for name in points}
        layout = self.functions.equations.layout
        return Sensitivities(self.functions.parameters, t, x, dx, at, layout.nq, layout.nv)

    def _integrated(
        self,
        t0: float,
        start: tuple[Array, Array, Array],
        schedule: Sequence[tuple[int, Array]],
        p: Array,
        results: Sequence[int],
    ) -> tuple[Array, Derivatives]:
        """The states and their derivatives after some numbers of steps, from 0 to the end."""
        kernel, changes = self._kernel, dict(schedule)
        memory = kernel.memory(t0, changes[0], p)
        found = np.empty((len(results), kernel.nx * (1 + kernel.columns)))
        memory.x[:], by_x, memory.columns[:, kernel.parameters] = start
        memory.columns[:, kernel.starts] = by_x[:, : kernel.starts.stop]
        found[0] = memory.z
        row, chains = 1, [np.eye(kernel.starts.stop)]  # for each interval, the derivatives of the state at its start
        bounds = sorted({*results, *(step for step in changes if step < results[-1])})
        for before, after in pairwise(bounds):
            if before and before in changes:
                memory.efforts[:] = changes[before]
                if self.by_efforts:
                    chains.append(np.concatenate(_chained(kernel, memory.columns, chains[-1]), axis=1))
                    memory.columns[:, kernel.starts], memory.columns[:, kernel.efforts] = np.eye(kernel.nx), 0.0
            if not memory.advance(before, self.step, after - before):
                times = f"between t = {t0 + before * self.step:g} s and {t0 + after * self.step:g} s"
                name = self.functions.mechanism.name
                raise DivergedError(
                    f"{name}: the state or its derivatives became infinite {times}", "Use smaller steps."
                )
            if after == results[row]:
                found[row] = memory.z
                row += 1
        # A result where the efforts change belongs to the interval before.
        intervals = np.maximum(np.searchsorted(list(changes), results) - 1, 0)
        return found[:, : kernel.nx], self._derivatives(found, intervals, chains, (len(schedule), len(changes[0])))

    def _derivatives(
        self, found: Array, intervals: Array, chains: Sequence[Array], shape: tuple[int, int]
    ) -> Derivatives:
        """All derivatives, from those by the state at the start of each interval and by its efforts."""
        kernel, nx = self._kernel, self._kernel.nx
        columns = found[:, nx:].reshape(len(found), -1, nx).transpose(0, 2, 1)
        by_parameters = columns[:, :, kernel.parameters]
        if not self.by_efforts:
            return Derivatives(by_parameters, columns[:, :, kernel.starts] if self.by_start else None, None)
        by_start, by_efforts = np.empty((len(found), nx, nx)), np.zeros((len(found), nx, *shape))
        for number, chain in enumerate(chains):
            rows = intervals == number
            earlier, own = _chained(kernel, columns[rows], chain)
            by_start[rows] = earlier[:, :, :nx]
            by_efforts[rows, :, :number] = earlier[:, :, nx:].reshape(len(own), nx, number, shape[1])
            by_efforts[rows, :, number] = own
        return Derivatives(by_parameters, by_start if self.by_start else None, by_efforts)

    def _point(self, name: str, t: Array, x: Array, dx: Derivatives, p: Array) -> tuple[Array, Derivatives]:
        """The positions (n, 3) of a point, with their derivatives."""
        symbols = [ca.SX.sym(each, self.functions.project.size1_in(each)) for each in "txp"]
        position = self.functions.point(name).call(symbols)[0]
        outputs = [ca.densify(found) for found in (position, *(ca.jacobian(position, own) for own in symbols[1:]))]
        mapped = ca.Function("point", symbols, outputs).map(len(t))
        places, by_x, by_p = (
            np.array(found).reshape(3, len(t), -1).transpose(1, 0, 2)
            for found in mapped(t[None, :], x.T, np.tile(p[:, None], len(t)))
        )
        start, efforts = dx.by_start, dx.by_efforts
        return places[:, :, 0], Derivatives(
            by_x @ dx.by_parameters + by_p,
            None if start is None else by_x @ start,
            None if efforts is None else np.einsum("nkx,nxme->nkme", by_x, efforts),
        )

    def _require_shapes(self, steps: int, every: int, x: Array, e: Array, p: Array) -> None:
        own = self.functions
        if steps < 1 or every < 1:
            raise InputError(
                f"{steps} steps with results of every {every} are not a trajectory", "Give positive numbers."
            )
        wanted = ((len(own.start),), (e.shape[0], len(own.efforts)), (len(own.values),))
        for name, given, shape in zip(("x0", "efforts", "parameters"), (x, e, p), wanted, strict=True):
            if given.shape != shape:
                raise InputError(f"{name} has the shape {given.shape}", f"Give {shape}.")
        if steps % len(e):
            remedy = "Give efforts for a number of intervals that divides the steps."
            message = f"{counted(steps, 'step')} cannot be divided into {counted(len(e), 'equal interval')}"
            raise InputError(message, remedy)


def _chained(kernel: TangentKernel, columns: Array, chain: Array) -> tuple[Array, Array]:
    """The derivatives by what is before an interval, and by its own efforts."""
    return columns[..., kernel.starts] @ chain, columns[..., kernel.efforts]


def sensitivities(
    simulation: BaseSimulation,
    steps: int,
    parameters: Sequence[str] = (),
    *,
    efforts: Array | Sequence[float] | Sequence[Sequence[float]] | None = None,
    every: int = 1,
    points: Sequence[str] = (),
) -> Sensitivities:
    """The trajectory of a simulation from its present state on, with its derivatives; the simulation stays as it is.

    Method, step, live values, and by default efforts and commands are those of the simulation. The mechanism is
    compiled for each call: use `SensitivityModel` for many.

    :param parameters: keys of numbers of the mechanism's file, see `casadi_functions`; they need not be live.
    :param efforts: see `SensitivityModel.run`.
    :param every: number of steps between two results.
    :param points: names of points whose positions are wanted, such as `rod.tip`.
    :raises MechanismError: see `SensitivityModel`.
    :raises InputError: wrenches act, or see `SensitivityModel.run`.
    :raises DivergedError: the state became infinite.
    """
    layout, inputs = simulation.model.equations.inputs, simulation.inputs
    if any(np.any(inputs[span]) for span in layout.forces.values()):
        raise InputError("wrenches act, by which there are no derivatives", "Set them to zero first: set_wrench(…).")
    mechanism = with_values(simulation.mechanism, dict(simulation.live)) if simulation.live else simulation.mechanism
    method = simulation.model.method.name
    model = SensitivityModel(mechanism, parameters, method=method, step=simulation.step_size)
    present = np.concatenate([inputs[layout.efforts], inputs[layout.commands]])
    x0 = simulation.y[: simulation.model.equations.core.stop]
    given = present if efforts is None else efforts
    return model.run(steps, t0=simulation.time, x0=x0, efforts=given, every=every, points=points)


def _numbers(name: str, given: Array | Sequence[float] | Sequence[Sequence[float]]) -> Array:
    """An array of numbers, in its own memory.

    :raises InputError: they are not finite numbers.
    """
    try:
        found = np.array(given, dtype=float)
    except (TypeError, ValueError):
        found = np.array(np.nan)
    if not np.all(np.isfinite(found)):
        raise InputError(f"{name} are not finite numbers", "Give an array of numbers in SI units.")
    return found
