"""Lagrange's equations the plain way: from T and V by differentiation (Huston & Liu, ch. 11; Géradin & Rixen).

With q' = N(q) u the equations d/dt(∂T/∂q') - ∂T/∂q = Q are projected onto the speeds by Nᵀ and read
M(q) u' + h(q, u) = Q. Slow and general, and independent of the recursions, which tests hold against it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from mbd_sim.dynamics.elements import force_vector, spring_force
from mbd_sim.dynamics.forces import joint_loads
from mbd_sim.dynamics.kinematics import WorldPose, joint_motion, part_poses
from mbd_sim.dynamics.links import layout, links
from mbd_sim.dynamics.spatial import constant
from mbd_sim.mechanism.model import GROUND, Array, Attachment, Mechanism


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

    kinetic = potential = dissipation = ca.SX(1, 1)
    poses = dict(zip((link.joint.outboard for link in chain), part_poses(chain, t, q), strict=True))
    for link, pose in zip(chain, poses.values(), strict=True):
        part = mechanism.parts[link.joint.outboard]
        center = pose.position + pose.rotation @ constant(part.center)
        velocity, omega = along_motion(center), _spin(pose.rotation, along_motion)
        kinetic += 0.5 * part.mass * ca.dot(velocity, velocity)
        kinetic += 0.5 * ca.dot(omega, constant(part.inertia) @ omega)
        potential -= part.mass * ca.dot(constant(mechanism.gravity), center)
    loads = joint_loads(chain, q, u, efforts)
    elements = ca.SX(places.nq, 1)  # generalized forces along q'
    for spring in mechanism.springs:
        line = _point(poses, spring.second) - _point(poses, spring.first)
        _, energy, loss = spring_force(spring, line, along_motion(line))
        potential, dissipation = potential + energy, dissipation + 0.5 * loss
    for applied in mechanism.applied:
        rotation = poses[applied.at.part].rotation
        moved = _spin(rotation, along_motion) if applied.couple else along_motion(_point(poses, applied.at))
        vector = force_vector(applied, rotation, t)
        vector = rotation.T @ vector if applied.couple else vector
        elements += ca.jacobian(moved, q_rate).T @ vector
    elements -= ca.gradient(dissipation, q_rate)

    rates = ca.SX(places.nq, 1)
    for link in chain:
        rates[link.q] = joint_motion(link, t, q, u).q_rates
    to_rates = ca.jacobian(rates, u)
    momentum = ca.gradient(kinetic, q_rate)
    mass = ca.jacobian(momentum, q_rate)
    inertial = along_motion(momentum) - ca.gradient(kinetic, q) + mass @ ca.jtimes(rates, q, q_rate)
    forces = loads.generalized + to_rates.T @ (elements - ca.gradient(potential, q))

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


def _spin(rotation: ca.SX, along_motion: Callable[[ca.SX], ca.SX]) -> ca.SX:
    """The angular velocity (3,) in rotated axes: ω× = Rᵀ R'."""
    turning = rotation.T @ ca.reshape(along_motion(ca.vec(rotation)), 3, 3)
    return 0.5 * ca.vertcat(turning[2, 1] - turning[1, 2], turning[0, 2] - turning[2, 0], turning[1, 0] - turning[0, 1])


def _point(poses: Mapping[str, WorldPose], at: Attachment) -> ca.SX:
    """A point (3,) in ground's frame."""
    if at.part == GROUND:
        return constant(at.point)
    return poses[at.part].position + poses[at.part].rotation @ constant(at.point)
