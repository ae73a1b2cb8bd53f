"""The terms of the equations of motion of a running simulation, from compiled functions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mbd_sim.base.geometry.arrays import finite_vector
from mbd_sim.base.geometry.pose import Array
from mbd_sim.mechanism.elements.constraints import two_sided
from mbd_sim.simulation.kernel.memory import KernelMemory
from mbd_sim.simulation.model.commands import EffortMap, Efforts
from mbd_sim.simulation.model.model import Model
from mbd_sim.simulation.run.inputs import EffortWriter, effort_writer

if TYPE_CHECKING:
    from mbd_sim.analysis.mechanics.inverse_dynamics import InverseDynamics
    from mbd_sim.dynamics.terms import DynamicsTerm


class Momentum(NamedTuple):
    """The `linear` momentum (3,) in kg·m/s and the `angular` momentum (3,) in kg·m²/s, in ground's axes."""

    linear: Array
    angular: Array


class DynamicsReadings:
    """The equations of motion M u' + c + g = Q + Gᵀ λ of a simulation in numbers.

    Each function is compiled when it is first called, and cached like kernels.
    """

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
        return self._model.on_request.momentum().bound(self._memory.clock, arrays, (6,))

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

        return effort_writer(target, efforts, np.ones(1, dtype=np.int64), change, "write(efforts)")

    @cached_property
    def _given_accelerations(self) -> Callable[[], Array]:
        """The accelerations under these inputs."""
        return self._model.bound_accelerations(self._memory.clock, self._memory.y, self._given_inputs)

    def inverse(self, u_rates: Sequence[float] | Array) -> Array:
        """The efforts (nv,) that produce accelerations u' (nv,): see `Simulation.inverse_dynamics`."""
        model, (time, y, inputs) = self._model, self._memory.now
        wanted = finite_vector(u_rates, self._nv, "u_rates")
        if self._is_open_chain and not model.equations.has_contact(inputs):
            self._u_rates[:] = wanted
            return self.term("tree_efforts")
        return self._inverse(y[model.q_range], y[model.u_range], wanted, time, inputs)

    @cached_property
    def _is_open_chain(self) -> bool:
        return not (self._model.mechanism.closures or two_sided(self._model.mechanism.constraints))

    @cached_property
    def _inverse(self) -> InverseDynamics:
        from mbd_sim.analysis.mechanics.inverse_dynamics import InverseDynamics

        return InverseDynamics(self._model.mechanism, equations=self._model.equations)
