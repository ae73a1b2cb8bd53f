"""Lagrange's equations the plain way: from T and V by differentiation (Huston & Liu, ch. 11; Géradin & Rixen).

With q' = N(q) u the equations d/dt(∂T/∂q') - ∂T/∂q = Q are projected onto the speeds by Nᵀ and read
M(q) u' + h(q, u) = Q. Slow and general, and independent of the recursions, which tests hold against it.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from mbd_sim.dynamics.forces import joint_loads
from mbd_sim.dynamics.joints import JOINT_TYPES
from mbd_sim.dynamics.kinematics import part_poses
from mbd_sim.dynamics.links import layout, links
from mbd_sim.dynamics.spatial import constant
from mbd_sim.mechanism.model import Array, Mechanism


@dataclass(frozen=True, eq=False)
class LagrangeEquations:
    """`terms(q, u, efforts)` gives M (nv, nv), h (nv,) and Q (nv,); `energies(q, u)` gives T and V in J."""

    terms: ca.Function
    energies: ca.Function

    def accelerations(self, q: Array, u: Array, efforts: Array) -> Array:
        """U' (nv,) at one state."""
        mass, inertial, forces = (np.array(value) for value in self.terms(q, u, efforts))
        return np.asarray(np.linalg.solve(mass, forces - inertial).ravel(), dtype=np.float64)


def lagrange_equations(mechanism: Mechanism) -> LagrangeEquations:
    """Derive the equations of a mechanism from its energies."""
    places, chain = layout(mechanism), links(mechanism)
    q, q_rate = ca.SX.sym("q", places.nq), ca.SX.sym("q'", places.nq)
    u, efforts = ca.SX.sym("u", places.nv), ca.SX.sym("e", places.nv)

    kinetic = potential = ca.SX(1, 1)
    for link, pose in zip(chain, part_poses(chain, q), strict=True):
        part = mechanism.parts[link.joint.outboard]
        center = pose.position + pose.rotation @ constant(part.center)
        velocity = ca.jtimes(center, q, q_rate)
        turning = pose.rotation.T @ ca.reshape(ca.jtimes(ca.vec(pose.rotation), q, q_rate), 3, 3)
        omega = 0.5 * ca.vertcat(
            turning[2, 1] - turning[1, 2], turning[0, 2] - turning[2, 0], turning[1, 0] - turning[0, 1]
        )
        kinetic += 0.5 * part.mass * ca.dot(velocity, velocity)
        kinetic += 0.5 * ca.dot(omega, constant(part.inertia) @ omega)
        potential -= part.mass * ca.dot(constant(mechanism.gravity), center)
    loads = joint_loads(chain, q, u, efforts)

    rates = ca.SX(places.nq, 1)
    for link in chain:
        rates[link.q] = JOINT_TYPES[link.joint.type].motion(link.axis, q[link.q], u[link.u]).q_rates
    to_rates = ca.jacobian(rates, u)
    momentum = ca.gradient(kinetic, q_rate)
    mass = ca.jacobian(momentum, q_rate)
    inertial = ca.jtimes(momentum, q, q_rate) - ca.gradient(kinetic, q) + mass @ ca.jtimes(rates, q, q_rate)
    forces = loads.generalized - to_rates.T @ ca.gradient(potential, q)

    def along_motion(expression: ca.SX) -> ca.SX:
        return ca.substitute(expression, q_rate, rates)

    terms = [to_rates.T @ mass @ to_rates, to_rates.T @ inertial, forces]
    return LagrangeEquations(
        terms=ca.Function("terms", [q, u, efforts], [along_motion(term) for term in terms]),
        energies=ca.Function("energies", [q, u], [along_motion(kinetic), potential + loads.potential]),
    )
