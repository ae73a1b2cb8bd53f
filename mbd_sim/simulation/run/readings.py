"""Readings of a simulation: those of compiled functions, the terms of its equations of motion, and its sensors.

Compiled functions are bound to the memory of the simulation, each when it is first read, and cached like kernels.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mbd_sim.base.geometry.arrays import finite_vector
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.mechanism.elements.constraints import two_sided
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.simulation.kernel.memory import KernelMemory
from mbd_sim.simulation.model.commands import EffortMap, Efforts
from mbd_sim.simulation.model.model import Model
from mbd_sim.simulation.model.state_records import Reaction
from mbd_sim.simulation.run.inputs import EffortWriter, effort_writer

if TYPE_CHECKING:
    from mbd_sim.analysis.mechanics.inverse_dynamics import InverseDynamics
    from mbd_sim.dynamics.terms import DynamicsTerm
    from mbd_sim.simulation.kernel.sensors import Arrival, SensorModel, SensorReading, SensorSamples


# Instructions of derivatives up to which they are compiled, within about a second. Larger ones would take some seconds,
# which pay off after ten thousand calls; to compile them then would change the bits of results from call to call.
COMPILED = 15_000
ALLOWED = 1e-9  # error of a row of constraints, relative to its terms, up to which accelerations are allowed


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
        shape = -1, function.size1_out(0)
        return self._model.on_request.named("derivatives").bound(self._memory.clock, self._arrays, shape)

    @cached_property
    def multipliers(self) -> Callable[[], Array] | None:
        """The multipliers of all rows; None with contacts, or if they are not read by a compiled function."""
        model = self._model
        if model.one_sided is not None or not model.compiles_multipliers:
            return None
        return model.on_request.named("multipliers").bound(self._memory.clock, self._arrays, (len(model.row_names),))

    @cached_property
    def reactions(self) -> Callable[[], dict[str, Reaction]] | None:
        """The loads of the joints; None with contacts, or if they are not compiled."""
        model, clock = self._model, self._memory.clock
        names = (*model.mechanism.joints, *model.mechanism.closing)
        if model.one_sided is not None:
            return None
        if not model.shares_load:
            return model.on_request.named("reactions").bound_records(clock, self._arrays, names, Reaction, ((3,), (3,)))
        sharing = model.load_sharing
        if (paths := model.load_paths) is None:
            return None
        read = paths.bound(clock, self._arrays, (paths.size,))
        return lambda: {
            name: Reaction(row[:3], row[3:]) for name, row in zip(names, sharing.shared_reactions(read()), strict=True)
        }


class Momentum(NamedTuple):
    """The `linear` momentum (3,) in kg·m/s and the `angular` momentum (3,) in kg·m²/s, in ground's axes."""

    linear: Array
    angular: Array


class DynamicsReadings:
    """The equations of motion M u' + c + g = Q + Gᵀ λ of a simulation in numbers."""

    def __init__(self, model: Model, memory: KernelMemory, efforts: EffortMap) -> None:
        self._model, self._memory, self._efforts, self._nv = model, memory, efforts, model.layout.nv
        self._terms: dict[DynamicsTerm, Callable[[], Array]] = {}
        self._u_rates = np.zeros(self._nv)  # for which efforts are wanted

    def term(self, term: DynamicsTerm) -> Array:
        """A term, (nv,) unless it has rows of its own."""
        if term not in self._terms:
            rows = len(self._model.row_names)
            shapes = {
                "mass_matrix": (self._nv, self._nv),
                "constraint_jacobian": (rows, self._nv),
                "constraint_bias": (rows,),
            }
            arrays, shape = (self._memory.y, self._memory.inputs, self._u_rates), shapes.get(term, (self._nv,))
            self._terms[term] = self._model.on_request.term(term).bound(self._memory.clock, arrays, shape)
        return self._terms[term]()

    def momentum(self, place: Array) -> Momentum:
        """The momentum of all parts; the angular one is about a place (3,) in m in ground's frame."""
        values = self._momentum()
        (x, y, z), (px, py, pz) = place.tolist(), values[:3].tolist()
        moment = np.array([y * pz - z * py, z * px - x * pz, x * py - y * px])
        return Momentum(values[:3].copy(), values[3:] - moment)

    @cached_property
    def _momentum(self) -> Callable[[], Array]:
        arrays = (self._memory.y, self._memory.inputs)
        return self._model.on_request.named("momentum").bound(self._memory.clock, arrays, (6,))

    def forward(self, efforts: Efforts | None) -> Array:
        """The accelerations u' (nv,) for given efforts: see `Simulation.forward_dynamics`."""
        if efforts is None:
            return self._memory.accelerations()
        inputs = self._given_inputs
        inputs[:] = self._memory.inputs
        self._write_given_efforts(efforts)
        if self._model.one_sided is None:
            return self._given_accelerations()
        return self._model.accelerations(self._memory.time, self._memory.y, inputs)[: self._nv]

    @cached_property
    def _given_inputs(self) -> Array:
        """The inputs with efforts that are not applied."""
        return self._memory.inputs.copy()

    @cached_property
    def _write_given_efforts(self) -> EffortWriter:
        """Write efforts to these inputs, as `set_efforts` does."""
        target, efforts = self._given_inputs[self._model.input_layout.efforts], self._efforts

        def change(given: Efforts) -> None:
            target[:] = efforts.clamped(efforts.merged(target, given))

        return effort_writer(target, efforts, np.zeros(1, dtype=np.int64), change, "write(efforts)")

    @cached_property
    def _given_accelerations(self) -> Callable[[], Array]:
        """The accelerations under these inputs."""
        return self._model.bound_accelerations(self._memory.clock, self._memory.y, self._given_inputs)

    def inverse(self, u_rates: Sequence[float] | Array) -> Array:
        """The efforts (nv,) that produce accelerations u' (nv,): see `Simulation.inverse_dynamics`."""
        model, (time, y, inputs) = self._model, self._memory.now
        wanted = finite_vector(u_rates, self._nv, "u_rates")
        q, u = y[model.q_range], y[model.u_range]
        if not model.equations.has_contact(inputs):
            self._u_rates[:] = wanted
            efforts = self.term("tree_efforts")
            if self._is_open_chain:
                return efforts
            if self._is_allowed(wanted):
                constraints = model.equations.constraints.with_values(inputs[model.equations.inputs.values])
                return self._without_constraint_forces(efforts, constraints.row_sizes(time, q), constraints.scales)
        return self._inverse(q, u, wanted, time, inputs)

    def _without_constraint_forces(self, efforts: Array, row_sizes: Array, scales: Array) -> Array:
        """The part (nv,) of efforts that has power along free directions, by LAPACK."""
        from mbd_sim.dynamics.constraints.functions import scaled
        from mbd_sim.dynamics.math.rank import RANK

        jacobian = self.term("constraint_jacobian")
        rank = int(np.sum(np.linalg.svd(scaled(jacobian, row_sizes, scales), compute_uv=False) > RANK))
        held = np.linalg.svd(scaled(jacobian, row_sizes, np.ones(self._nv)))[2][:rank]
        return np.asarray(efforts - held.T @ (held @ efforts))

    def _is_allowed(self, u_rates: Array) -> bool:
        """Whether the constraints allow accelerations (nv,), to round-off."""
        jacobian, bias = self.term("constraint_jacobian"), self.term("constraint_bias")
        sizes = np.abs(jacobian) @ np.abs(u_rates) + np.abs(bias)
        return bool(np.all(np.abs(jacobian @ u_rates + bias) <= ALLOWED * sizes))

    @cached_property
    def _is_open_chain(self) -> bool:
        return not (self._model.mechanism.closures or two_sided(self._model.mechanism.constraints))

    @cached_property
    def _inverse(self) -> InverseDynamics:
        from mbd_sim.analysis.mechanics.inverse_dynamics import InverseDynamics

        return InverseDynamics(self._model.mechanism, equations=self._model.equations)


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
            self._samples.restore(table)
            return
        if not keep:
            self._samples.clear()
        self._samples.take()
