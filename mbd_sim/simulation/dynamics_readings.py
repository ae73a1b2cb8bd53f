"""The kinematics and the terms of the equations of motion of a running simulation, from compiled functions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mbd_sim import compiler, simulation
from mbd_sim.geometry.pose import Array
from mbd_sim.geometry.shaped_arrays import finite_vector
from mbd_sim.mechanism.one_sided import two_sided
from mbd_sim.simulation.efforts import EffortMap
from mbd_sim.simulation.read_only import ReadOnlyView
from mbd_sim.simulation.run_state import RunState

if TYPE_CHECKING:
    from mbd_sim.analysis.inverse_dynamics import InverseDynamics
    from mbd_sim.dynamics.dynamics_terms import DynamicsTerm
    from mbd_sim.simulation.moving_points import MovingFrame, MovingPoint


class Momentum(NamedTuple):
    """The `linear` momentum (3,) in kg·m/s and the `angular` momentum (3,) in kg·m²/s, in ground's axes."""

    linear: Array
    angular: Array


class DynamicsReadings(RunState):
    """The part of a `Simulation` that gives its equations of motion M u' + c + g = Q + Gᵀ λ in numbers.

    Each function is compiled when it is first called, and cached like kernels.
    """

    effort_map: EffortMap

    def point(self, name: str) -> MovingPoint:
        """A point `part.point`, or the origin of a part: position, velocity, acceleration, Jacobian and its rate.

        >>> from mbd_sim import Simulation
        >>> sim = Simulation.from_file("double_rod")
        >>> sim.point("lower").jacobian.shape
        (3, 2)

        The object follows the motion; keep it where speed matters.

        :raises InputError: there is no such part or point.
        """
        return simulation.MovingPoint(self.model, self._memory, self._live, name)

    def frame(self, name: str) -> MovingFrame:
        """A part, or a point of it with its axes: a `point` with rotation, angular motion and a Jacobian (6, nv).

        :raises InputError: there is no such part or point.
        """
        return simulation.MovingFrame(self.model, self._memory, self._live, name)

    @cached_property
    def center_of_mass(self) -> MovingPoint:
        """The center of mass of all parts; numbers are nan if they have no mass."""
        return simulation.MovingPoint(self.model, self._memory, self._live, None)

    def mass_matrix(self) -> Array:
        """M (nv, nv) of the spanning tree, with the reflected inertia of rotors; kg, kg·m and kg·m²."""
        return self._term("mass_matrix", self.model.layout.nv, self.model.layout.nv)

    def bias_terms(self) -> Array:
        """h = c + g (nv,) in N and N·m: what inertia and gravity require at u' = 0."""
        return self._term("bias", self.model.layout.nv)

    def coriolis_terms(self) -> Array:
        """c (nv,) in N and N·m: Coriolis, centrifugal and gyroscopic terms, and the inertia forces due to drives."""
        return self._term("coriolis", self.model.layout.nv)

    def gravity_terms(self) -> Array:
        """g (nv,) in N and N·m: minus the generalized forces of gravity."""
        return self._term("gravity", self.model.layout.nv)

    def generalized_forces(self) -> Array:
        """Q (nv,) in N and N·m: springs, dampers, friction, applied forces, wrenches, actuators and efforts.

        Rigid contacts and dry friction that sticks are not included, nor are constraints.
        """
        return self._term("generalized_forces", self.model.layout.nv)

    def constraint_jacobian(self) -> Array:
        """G (m, nv) of all equations of loops and constraints, in the order of `constraint_names`: G u + b = 0."""
        return self._term("constraint_jacobian", len(self.constraint_names), self.model.layout.nv)

    def constraint_bias(self) -> Array:
        """γ (m,) with G u' + γ = 0."""
        return self._term("constraint_bias", len(self.constraint_names))

    @property
    def constraint_names(self) -> tuple[str, ...]:
        """The loop or constraint of each row of G."""
        return self.model.row_names

    def momentum(self, about: str | Sequence[float] | Array | None = None) -> Momentum:
        """The momentum of all parts.

        Rotors of actuators are not included. A spring with mass counts as a third of it at its end.

        :param about: of the angular momentum: a point `part.point`, a part, `ground`, or (3,) in m in ground's frame;
            by default the center of mass.
        :raises InputError: there is no such part or point.
        :raises ValueError: it is not three finite numbers.
        """
        values = self._momentum()
        if about is None:
            place = self.center_of_mass.position
        else:
            place = self.point(about).position if isinstance(about, str) else finite_vector(about, 3, "about")
        (x, y, z), (px, py, pz) = place.tolist(), values[:3].tolist()
        moment = np.array([y * pz - z * py, z * px - x * pz, x * py - y * px])
        return Momentum(values[:3].copy(), values[3:] - moment)

    def forward_dynamics(self, efforts: Mapping[str, float] | Sequence[float] | Array | None = None) -> Array:
        """The accelerations u' (nv,) in this state for given efforts in N and N·m, which are not applied.

        The state of contacts stays as it is. Efforts are clamped to their limits, as in `set_efforts`.

        :param efforts: all in order, or some by name; the others stay as they are. None: all as they are.
        :raises CommandError: see `set_efforts`.
        """
        if efforts is None:
            return self._memory.accelerations()
        inputs = self._given_inputs
        inputs[:] = self._memory.inputs
        self._write_given_efforts(efforts)
        if self.model.contact is None:
            return self._given_accelerations()
        return self.model.accelerations(self.time, self._memory.y, inputs)[: self.model.layout.nv]

    @cached_property
    def _given_inputs(self) -> Array:
        """The inputs with efforts that are not applied."""
        return self._memory.inputs.copy()

    @cached_property
    def _write_given_efforts(self) -> Callable[..., None]:
        """Write efforts to these inputs, as `set_efforts` does."""
        target, efforts = self._given_inputs[self.model.input_layout.efforts], self.effort_map

        def change(given: Mapping[str, float] | Sequence[float] | Array) -> None:
            target[:] = efforts.clamped(efforts.merged(target, given))

        always = np.ones(1, dtype=np.int64)
        return compiler.bounded_writer(target, efforts.limits, always, change, "write(efforts)", ReadOnlyView)

    @cached_property
    def _given_accelerations(self) -> Callable[[], Array]:
        """The accelerations under these inputs."""
        return self.model.bound_accelerations(self._memory.clock, self._memory.y, self._given_inputs)

    def inverse_dynamics(self, u_rates: Sequence[float] | Array) -> Array:
        """The efforts (nv,) in N and N·m that produce the accelerations `u_rates` (nv,) in this state.

        The present wrenches, live values and contacts are accounted for: closed contacts stay closed, and what sticks
        sticks. Actuators and commanded efforts must exert these efforts together.

        :raises ValueError: the constraints or contacts do not allow them; see
            `mbd_sim.analysis.inverse_dynamics.InverseDynamics`.
        """
        model, (y, inputs) = self.model, (self._memory.y, self._memory.inputs)
        wanted = finite_vector(u_rates, model.layout.nv, "u_rates")
        if self._is_open_chain and not model.equations.has_contact(inputs):
            self._u_rates[:] = wanted
            return self._term("tree_efforts", model.layout.nv)
        return self._inverse(y[model.q_range], y[model.u_range], wanted, self.time, inputs)

    @cached_property
    def _is_open_chain(self) -> bool:
        return not (self.mechanism.closures or two_sided(self.mechanism.constraints))

    @cached_property
    def _inverse(self) -> InverseDynamics:
        from mbd_sim.analysis.inverse_dynamics import InverseDynamics

        return InverseDynamics(self.mechanism, equations=self.model.equations)

    @cached_property
    def _u_rates(self) -> Array:
        """The accelerations for which efforts are wanted."""
        return np.zeros(self.model.layout.nv)

    @cached_property
    def _terms(self) -> dict[DynamicsTerm, Callable[[], Array]]:
        return {}

    def _term(self, term: DynamicsTerm, *shape: int) -> Array:
        if term not in self._terms:
            arrays = (self._memory.y, self._memory.inputs, self._u_rates)
            self._terms[term] = self.model.on_request.term(term).bound(self._memory.clock, arrays, shape)
        return self._terms[term]()

    @cached_property
    def _momentum(self) -> Callable[[], Array]:
        arrays = (self._memory.y, self._memory.inputs)
        return self.model.on_request.momentum().bound(self._memory.clock, arrays, (6,))
