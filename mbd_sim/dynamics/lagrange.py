"""Lagrange's equations the plain way: from T and V by differentiation (Huston & Liu, ch. 11; Géradin & Rixen).

With q' = N(q) u the equations d/dt(∂T/∂q') - ∂T/∂q = Q are projected onto the speeds by Nᵀ and read
M(q) u' + h(q, u) = Q. Slow and general, and independent of the recursions, which tests hold against it.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from mbd_sim.dynamics.forces import joint_loads
from mbd_sim.dynamics.kinematics import joint_motion, part_poses
from mbd_sim.dynamics.links import layout, links
from mbd_sim.dynamics.spatial import constant
from mbd_sim.mechanism.model import Array, Mechanism


@dataclass(frozen=True, eq=False)
class LagrangeEquations:
    """`terms(t, q, u, efforts)` gives M (nv, nv), h (nv,) and Q (nv,).

    `energies(t, q, u)` gives the parts T2, T1, T0 of the kinetic energy, of second, first and no degree in the
    speeds, and V, in J. T1 and T0 vanish where nothing is driven.
    """

    terms: ca.Function
    energies: ca.Function

    def accelerations(self, q: Array, u: Array, efforts: Array, t: float = 0.0) -> Array:
        """u' (nv,) at one state."""
        mass, inertial, forces = (np.array(value) for value in self.terms(t, q, u, efforts))
        return np.asarray(np.linalg.solve(mass, forces - inertial).ravel(), dtype=np.float64)


def lagrange_equations(mechanism: Mechanism) -> LagrangeEquations:
    """Derive the equations of a mechanism from its energies."""
    places, chain = layout(mechanism), links(mechanism)
    q, q_rate = ca.SX.sym("q", places.nq), ca.SX.sym("q'", places.nq)
    u, efforts = ca.SX.sym("u", places.nv), ca.SX.sym("e", places.nv)
    t = ca.SX.sym("t")

    def along_motion(expression: ca.SX) -> ca.SX:
        return ca.jtimes(expression, q, q_rate) + ca.jtimes(expression, t, ca.SX(1))

    kinetic = potential = ca.SX(1, 1)
    for link, pose in zip(chain, part_poses(chain, t, q), strict=True):
        part = mechanism.parts[link.joint.outboard]
        center = pose.position + pose.rotation @ constant(part.center)
        velocity = along_motion(center)
        turning = pose.rotation.T @ ca.reshape(along_motion(ca.vec(pose.rotation)), 3, 3)
        omega = 0.5 * ca.vertcat(
            turning[2, 1] - turning[1, 2], turning[0, 2] - turning[2, 0], turning[1, 0] - turning[0, 1]
        )
        kinetic += 0.5 * part.mass * ca.dot(velocity, velocity)
        kinetic += 0.5 * ca.dot(omega, constant(part.inertia) @ omega)
        potential -= part.mass * ca.dot(constant(mechanism.gravity), center)
    loads = joint_loads(chain, q, u, efforts)

    rates = ca.SX(places.nq, 1)
    for link in chain:
        rates[link.q] = joint_motion(link, t, q, u).q_rates
    to_rates = ca.jacobian(rates, u)
    momentum = ca.gradient(kinetic, q_rate)
    mass = ca.jacobian(momentum, q_rate)
    inertial = along_motion(momentum) - ca.gradient(kinetic, q) + mass @ ca.jtimes(rates, q, q_rate)
    forces = loads.generalized - to_rates.T @ ca.gradient(potential, q)

    def in_speeds(expression: ca.SX) -> ca.SX:
        return ca.substitute(expression, q_rate, rates)

    quadratic = 0.5 * ca.dot(q_rate, mass @ q_rate)
    without_speeds = ca.substitute(kinetic, q_rate, ca.SX.zeros(places.nq, 1))
    energies = [quadratic, kinetic - quadratic - without_speeds, without_speeds, potential + loads.potential]
    terms = [to_rates.T @ mass @ to_rates, to_rates.T @ inertial, forces]
    return LagrangeEquations(
        terms=ca.Function("terms", [t, q, u, efforts], [in_speeds(term) for term in terms]),
        energies=ca.Function("energies", [t, q, u], [in_speeds(energy) for energy in energies]),
    )
