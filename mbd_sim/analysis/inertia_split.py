"""The generalized inertia forces, split by their origin (Lidström, sec. 9.7–9.10; Géradin & Rixen, p. 26–27)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from mbd_sim.dynamics.equations import Equations, require_equations
from mbd_sim.geometry.pose import Array
from mbd_sim.short_repr import short_repr


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


@dataclass(frozen=True, eq=False)
class InertiaSplit:
    """The split as numerical functions.

    `forces(t, q, u, u_rates)` gives (nv, 4), with a column for each of `InertiaForces`; `gyroscopic(t, q)` gives G
    (nv, nv); `kinetic(t, q, u)` gives (3,) T2, T1 and T0 in J.
    """

    forces: ca.Function
    gyroscopic: ca.Function
    kinetic: ca.Function

    __repr__ = short_repr

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
