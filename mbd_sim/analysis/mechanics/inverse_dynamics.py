"""Inverse dynamics: the efforts that a motion requires (Featherstone 2008, ch. 5).

The generalized inertia forces are also split by their origin (Lidström, sec. 9.7–9.10; Géradin & Rixen, p. 26–27).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from mbd_sim.analysis.mechanics.one_sided_motion import OneSidedMotion
from mbd_sim.base.errors import InputError, nearest
from mbd_sim.base.geometry.arrays import vector
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.interrupts import interruptible
from mbd_sim.base.short_repr import record, short_repr
from mbd_sim.dynamics.actuators.functions import MOTOR_READINGS
from mbd_sim.dynamics.equations import Equations, derive, require_equations
from mbd_sim.dynamics.kinematics.tracing import TracedMechanism, trace
from mbd_sim.dynamics.layouts.coordinate_names import names_of_q
from mbd_sim.dynamics.terms import tree_efforts
from mbd_sim.mechanism.elements.constraints import two_sided
from mbd_sim.mechanism.mechanism import Mechanism, require_mechanism

_Numbers = Array | Sequence[float]
FEASIBLE = 1e-9  # the error of the accelerations that is allowed, relative to the largest one


class InverseDynamics:
    """The efforts that produce given accelerations of a mechanism at a state.

    For an open chain they come from the recursive Newton–Euler algorithm (Featherstone 2008, sec. 5.3): accelerations
    outwards, forces inwards, O(n). With loops and constraints the same recursion runs on the spanning tree. Its
    generalized forces r are distributed among the `actuated` coordinates so that Nᵀ e = Nᵀ r along the free directions
    N, in which constraint forces do no work. If more coordinates are actuated than are free, the norm of the efforts e
    is the least possible. Springs, dampers, friction, applied forces and drives are accounted for.

    Efforts include those that actuators must exert: they are the sums of efforts that are commanded directly and of
    efforts of actuators, and account for the inertia of rotors. What the actuators exert at present does not matter.

    Closed and sticking contacts are constraints as well, and sliding ones exert their friction. The efforts then follow
    from the accelerations by Newton's method, because contact forces depend on them.

    >>> arm = InverseDynamics(load_mechanism("six_axis_arm"))
    >>> gravity_compensation = arm(q, np.zeros(6), np.zeros(6))
    """

    __repr__ = short_repr

    @interruptible()
    def __init__(
        self, mechanism: Mechanism, actuated: Sequence[str] | None = None, equations: Equations | None = None
    ) -> None:
        """Derive the recursion.

        :param actuated: names of the coordinates with efforts, or a single one by itself; by default all.
        :param equations: those of the mechanism, if they have been derived already. Their wrenches and live values are
            accounted for.
        :raises ValueError: a coordinate does not exist.
        """
        names = require_mechanism(mechanism).coordinate_names
        actuated = [actuated] if isinstance(actuated, str) else actuated
        for name in actuated or ():
            if name not in names:
                raise InputError(f"there is no coordinate '{name}'", nearest(name, names))
        self.mechanism = mechanism
        self.actuated = names if actuated is None else tuple(actuated)
        self._indices = [names.index(name) for name in self.actuated]
        loaded, parameters = (equations.inputs.loaded, equations.parameters) if equations else ((), None)
        self._direct = len(self._indices) == len(names) and not (mechanism.closures or two_sided(mechanism.constraints))
        step = None if equations is None else equations.step
        traced = trace(mechanism, loaded, parameters, step)
        self._tree, self._input_size = _tree_function(traced), traced.input_layout.size
        self._tree_layout = traced.layout
        self._equations = equations
        self._contact: OneSidedMotion | None = None

    def _names_of_u(self) -> tuple[str, ...]:
        return self.mechanism.coordinate_names

    def __call__(
        self, q: _Numbers, u: _Numbers, u_rates: _Numbers, t: float = 0.0, inputs: Array | None = None
    ) -> Array:
        """The efforts (nv,) in N and N·m for the accelerations `u_rates` (nv,); zero at coordinates without actuation.

        :param q: (nq,) coordinates that satisfy the constraints.
        :param u: (nv,) speeds that satisfy the constraints.
        :param t: time in s, for forces, drives and constraints that depend on it.
        :param inputs: all inputs of the equations, for their wrenches, live values and contacts; the efforts in it do
            not matter. By default there are no wrenches, live values are those of the mechanism, and contacts are open.
        :raises ValueError: an argument has another shape; the constraints, or joints without actuation, do not allow
            these accelerations; or a contact would have to pull or to hold more than its friction.
        """
        layout = self._tree_layout
        q = vector(q, layout.nq, "q", lambda: names_of_q(self.mechanism, layout))
        u, u_rates = (
            vector(u, layout.nv, "u", self._names_of_u),
            vector(u_rates, layout.nv, "u_rates", self._names_of_u),
        )
        if self._equations is None and not self._direct:
            self._equations = derive(self.mechanism)
        if inputs is None:
            inputs = self._equations.inputs_without_commands if self._equations else np.zeros(self._input_size)
        if self._equations is not None and self._equations.has_contact(inputs):
            return self._in_contact(q, u, u_rates, t, inputs)
        efforts = self.of_tree(q, u, u_rates, t, inputs)
        if self._direct:
            return efforts
        assert self._equations is not None
        constraints = self._equations.constraints.with_values(inputs[self._equations.inputs.values])
        free = constraints.free_directions(t, q)
        shared = np.zeros_like(efforts)
        shared[self._indices] = np.linalg.lstsq(free.T[:, self._indices], free.T @ efforts, rcond=None)[0]
        self._require_feasible(q, u, u_rates, t, shared, inputs)
        return shared

    def of_tree(self, q: Array, u: Array, u_rates: Array, t: float, inputs: Array | None = None) -> Array:
        """The generalized forces r (nv,) on the spanning tree; efforts have their power n·r along a free direction n.

        The arguments are those of a call. Contacts are left out, and what the constraints allow is not checked.
        """
        given = np.zeros(self._input_size) if inputs is None else inputs[: self._input_size]
        return np.array(self._tree(q, u, u_rates, t, given), dtype=float).ravel()

    def _in_contact(self, q: Array, u: Array, u_rates: Array, t: float, inputs: Array) -> Array:
        assert self._equations is not None
        if self._contact is None:
            self._contact = OneSidedMotion(self._equations)
        given = inputs.copy()
        given[self._equations.inputs.efforts] = -self.efforts_of_actuators(q, u, t, inputs)
        efforts, accelerations = self._contact.efforts(t, q, u, u_rates, given, self._indices)
        self._require_equal(accelerations, u_rates)
        return efforts

    def _require_feasible(self, q: Array, u: Array, u_rates: Array, t: float, efforts: Array, inputs: Array) -> None:
        assert self._equations is not None
        nq, nv = len(q), len(u)
        given = inputs[: self._equations.inputs.size].copy()
        given[self._equations.inputs.efforts] = efforts - self.efforts_of_actuators(q, u, t, inputs)
        found = np.array(self._equations.rates.call([t, self.state(q, u), given])[0]).ravel()[nq : nq + nv]
        self._require_equal(found, u_rates)

    def state(self, q: Array, u: Array) -> Array:
        """The state y with zeros after the speeds."""
        assert self._equations is not None
        return np.concatenate([q, u, np.zeros(self._equations.start_state.size - len(q) - len(u))])

    def efforts_of_actuators(self, q: Array, u: Array, t: float, inputs: Array) -> Array:
        """The generalized efforts (nv,) of the actuators, with zeros for their states."""
        assert self._equations is not None
        if self._equations.actuators is None:
            return np.zeros(len(u))
        return np.array(self._actuator_efforts(t, self.state(q, u), inputs)).ravel()

    @cached_property
    def _actuator_efforts(self) -> ca.Function:
        """(t, y, inputs) -> (nv,), by the power of the efforts at the speeds of their ports."""
        assert self._equations is not None and self._equations.actuators is not None
        readings, layout = self._equations.actuators.readings, self._equations.layout
        symbols = [ca.SX.sym(name, readings.size_in(index)) for index, name in enumerate(("t", "y", "inputs"))]
        (values,) = readings.call(symbols)
        speeds, efforts = (values[MOTOR_READINGS.index(name), :].T for name in ("velocity", "effort"))
        by_speeds = ca.jacobian(speeds, symbols[1])[:, layout.nq : layout.nq + layout.nv]
        return ca.Function("actuator_efforts", symbols, [ca.densify(by_speeds.T @ efforts)])

    def _require_equal(self, found: Array, u_rates: Array) -> None:
        """Refuse accelerations that differ from those `found` with the efforts."""
        miss, scale = np.abs(found - u_rates), max(float(np.max(np.abs(u_rates), initial=0.0)), 1.0)
        if not np.max(miss, initial=0.0) <= FEASIBLE * scale:
            worst = int(np.argmax(miss))
            raise InputError(
                f"no efforts at {', '.join(self.actuated) or 'no joint'} give these accelerations: "
                f"{self.mechanism.coordinate_names[worst]} would have {found[worst]:.6g} instead of "
                f"{u_rates[worst]:.6g}",
                "Request accelerations that the constraints allow, or actuate more joints.",
            )


def _tree_function(traced: TracedMechanism) -> ca.Function:
    """(q, u, u', t, inputs) -> the efforts (nv,) of the spanning tree, see `tree_efforts`."""
    state, u_rates = traced.state, ca.SX.sym("u'", traced.layout.nv)
    symbols = [state.q, state.u, u_rates, state.t, traced.inputs]
    efforts = tree_efforts(traced, u_rates)
    return ca.Function("inverse_dynamics", symbols, [ca.densify(efforts)], {"cse": True})


class InertiaForces(NamedTuple):
    """The terms (nv,) of d/dt(∂T/∂q') - ∂T/∂q along the speeds, in N or N·m.

    Their sign is that of M u'; d'Alembert's inertia forces are their negatives. The kinetic energy is T = T2 + T1 + T0,
    of degree 2, 1 and 0 in the speeds.

    - `relative`, d/dt(∂T2/∂q') - ∂T2/∂q at fixed time: the terms that remain when the drives stand still. Without
      drives there are no others.
    - `transport`, ∂²T1/∂t∂q' - ∂T0/∂q: the terms that remain when the speeds and their rates are zero, so that the
      drives carry everything along. Centrifugal forces are among them.
    - `gyroscopic`, Σ (∂²T1/∂q'∂q_r - ∂²T1/∂q∂q'_r) q'_r = G u: the Coriolis forces due to steady drives. G is
      skew-symmetric, so that they do no work: u·G u = 0.
    - `unsteady`, ∂²T2/∂t∂q' = (∂M/∂t) u: the Coriolis forces due to drives that change the mass matrix. Their power is
      2 ∂T2/∂t. They vanish if the drives only carry the mechanism along, as a rotating frame does.
    """

    relative: Array
    transport: Array
    gyroscopic: Array
    unsteady: Array

    @property
    def complementary(self) -> Array:
        """The Coriolis forces (nv,), gyroscopic and unsteady: the total is relative + transport + complementary."""
        return self.gyroscopic + self.unsteady

    @property
    def total(self) -> Array:
        """M u' + h (nv,) of `LagrangeEquations`."""
        return self.relative + self.transport + self.complementary


@record
class InertiaSplit:
    """The split as numerical functions.

    `forces(t, q, u, u_rates)` gives (nv, 4), with a column for each of `InertiaForces`; `gyroscopic(t, q)` gives G
    (nv, nv); `kinetic(t, q, u)` gives (3,) T2, T1 and T0 in J.
    """

    forces: ca.Function
    gyroscopic: ca.Function
    kinetic: ca.Function

    def at(self, t: float, q: Array, u: Array, u_rates: Array) -> InertiaForces:
        """The terms at a state, with u' = `u_rates` (nv,)."""
        return InertiaForces(*(np.array(self.forces(t, q, u, u_rates), dtype=float).T))

    def gyroscopic_matrix(self, t: float, q: Array) -> Array:
        """The skew-symmetric matrix G (nv, nv) in kg/s, kg·m/s or kg·m²/s: the gyroscopic terms are G u."""
        return np.array(self.gyroscopic(t, q), dtype=float)

    def kinetic_parts(self, t: float, q: Array, u: Array) -> tuple[float, float, float]:
        """T2, T1 and T0 in J."""
        t2, t1, t0 = np.array(self.kinetic(t, q, u), dtype=float).ravel().tolist()
        return t2, t1, t0


def inertia_split(equations: Equations) -> InertiaSplit:
    """Split the inertia forces of a mechanism, in the coordinates and speeds of its spanning tree.

    Only drives of joints move the frames of these coordinates: a constraint that depends on time, such as a leg of a
    Stewart platform, is a force here. The speeds u need not be derivatives of coordinates. With q' = N(q) u,
    T2 = ½ q'ᵀA q' and T1 = aᵀq', the covectors are projected by Nᵀ, so that G = Nᵀ (∂a/∂q - (∂a/∂q)ᵀ) N. The result
    does not depend on how T is continued to quaternions that are not of unit length. As N does not depend on time,
    the degree in q' is the degree in u.

    :raises TypeError: `equations` are none, for example a simulation.
    """
    require_equations(equations)
    nq, nv = equations.layout.nq, equations.layout.nv
    t, q, u, u_rates = ca.SX.sym("t"), ca.SX.sym("q", nq), ca.SX.sym("u", nv), ca.SX.sym("u'", nv)
    y = ca.vertcat(q, u, ca.SX.zeros(equations.start_state.size - nq - nv))
    kinetic = equations.energies(t, y)[0]
    q_rates = equations.rates.call([t, y, ca.SX.zeros(equations.inputs.size)])[0][:nq]
    to_rates = ca.jacobian(q_rates, u)
    drift = ca.substitute(q_rates, u, ca.SX.zeros(nv, 1))  # of the states of drives that follow commands

    at_rest = ca.SX.zeros(nv, 1)
    mass = ca.hessian(kinetic, u)[0]
    carried = ca.substitute(ca.gradient(kinetic, u), u, at_rest)
    constant = ca.substitute(kinetic, u, at_rest)
    # The columns of N are orthogonal, also for quaternions of any length, so that NᵀN is diagonal: N⁺ = (NᵀN)⁻¹Nᵀ.
    pseudoinverse = ca.diag(1.0 / ca.sum1(to_rates**2).T) @ to_rates.T
    form = pseudoinverse.T @ carried  # a
    slopes = to_rates.T @ ca.jacobian(form, q) @ to_rates

    momentum = pseudoinverse.T @ (mass @ u)  # ∂T2/∂q'
    v = ca.SX.sym("q'", nq)
    second = 0.5 * ca.dot(pseudoinverse @ v, mass @ (pseudoinverse @ v))
    of_second = ca.substitute(ca.gradient(second, q), v, q_rates - drift)
    relative = mass @ u_rates + to_rates.T @ (ca.jtimes(momentum, q, q_rates - drift) - of_second)
    transport = to_rates.T @ (ca.jacobian(form, t) + ca.jtimes(form, q, drift) - ca.gradient(constant, q))
    matrix = slopes - slopes.T  # exactly skew-symmetric
    unsteady = ca.jtimes(mass @ u, t, ca.SX(1)) + ca.jtimes(mass @ u, q, drift)
    columns = ca.horzcat(relative, transport, matrix @ u, unsteady)
    parts = ca.vertcat(0.5 * ca.dot(u, mass @ u), ca.dot(carried, u), constant)
    return InertiaSplit(
        forces=_function("forces", [t, q, u, u_rates], columns),
        gyroscopic=_function("gyroscopic", [t, q], matrix),
        kinetic=_function("kinetic", [t, q, u], parts),
    )


def _function(name: str, inputs: list[ca.SX], output: ca.SX) -> ca.Function:
    return ca.Function(name, inputs, [ca.densify(output)], {"cse": True})
