"""Lagrange's equations the plain way: from T and V by differentiation (Huston & Liu, ch. 11; Géradin & Rixen).

With q' = N(q) u the equations d/dt(∂T/∂q') - ∂T/∂q = Q are projected onto the speeds by Nᵀ and read
M(q) u' + h(q, u) = Q + Gᵀ λ, where G comes from the constraints by differentiation and by virtual velocities. Slow and
general, and independent of the recursions, which tests hold against it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from mbd_sim.dynamics.body_symbols import Bodies, flat_pose
from mbd_sim.dynamics.constraint_equations import coordinates_of
from mbd_sim.dynamics.constraint_rows import constraint_rows
from mbd_sim.dynamics.element_forces import damper_force, force_vector, spring_force
from mbd_sim.dynamics.joint_forces import joint_loads
from mbd_sim.dynamics.kinematics import WorldPose, joint_motion, part_poses
from mbd_sim.dynamics.links import Link, layout, links
from mbd_sim.dynamics.spatial_algebra import constant
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import GROUND, Attachment, Mechanism

RANK = 1e-11  # of the largest singular value, what counts as none


@dataclass(frozen=True, eq=False)
class LagrangeEquations:
    """`terms(t, q, u, efforts)` gives M (nv, nv), h (nv,) and Q (nv,).

    `energies(t, q, u)` gives the parts T2, T1, T0 of the kinetic energy, of second, first and no degree in the
    speeds, and V, in J. T1 and T0 vanish where nothing is driven. `constraints(t, q, u)` gives G (m, nv) and γ (m,) of
    all rows, with G u' + γ = 0.
    """

    terms: ca.Function
    energies: ca.Function
    constraints: ca.Function

    def accelerations(self, q: Array, u: Array, efforts: Array, t: float = 0.0) -> Array:
        """u' (nv,) at one state; redundant rows share their forces as least squares do."""
        mass, inertial, forces = (np.array(value) for value in self.terms(t, q, u, efforts))
        gradient, bias = (np.array(value) for value in self.constraints(t, q, u))
        scale = np.sqrt(np.diag(mass))[:, None]
        rows = gradient / scale.T
        size = np.linalg.norm(rows, axis=1, keepdims=True)
        rows = np.divide(rows, size, where=size > 0.0, out=np.zeros_like(rows))
        bias = np.divide(bias, size, where=size > 0.0, out=np.zeros_like(bias))
        matrix = np.block([[mass / (scale @ scale.T), rows.T], [rows, np.zeros((len(rows), len(rows)))]])
        right = np.vstack([(forces - inertial) / scale, -bias])
        found = np.linalg.lstsq(matrix, right, rcond=RANK)[0] if len(rows) else np.linalg.solve(matrix, right)
        return np.asarray((found[: len(mass)] / scale).ravel(), dtype=np.float64)


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
        if spring.mass:
            first, second = _point(poses, spring.first), _point(poses, spring.second)
            kinetic += _kinetic_energy_of_spring(spring.mass, along_motion(first), along_motion(second))
            potential -= spring.mass * ca.dot(constant(mechanism.gravity), first + second) / 2.0
    for damper in mechanism.dampers:
        line = _point(poses, damper.second) - _point(poses, damper.first)
        dissipation += damper_force(damper, line, along_motion(line))[2]
    for applied in mechanism.applied:
        rotation = poses[applied.at.part].rotation
        moved = _spin(rotation, along_motion) if applied.couple else along_motion(_point(poses, applied.at))
        axes = constant(np.eye(3)) if applied.axes_of == GROUND else poses[applied.axes_of].rotation
        vector = force_vector(applied, axes, t)
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
    slopes, rate = _constraint_rates(mechanism, chain, poses, (t, q, q_rate), along_motion)
    rows = [slopes @ to_rates, along_motion(rate) + slopes @ ca.jtimes(rates, q, q_rate)]
    return LagrangeEquations(
        terms=ca.Function("terms", [t, q, u, efforts], [in_speeds(term) for term in terms]),
        energies=ca.Function("energies", [t, q, u], [in_speeds(energy) for energy in energies]),
        constraints=ca.Function("constraints", [t, q, u], [ca.densify(in_speeds(row)) for row in rows]),
    )


def _constraint_rates(
    mechanism: Mechanism,
    chain: Sequence[Link],
    poses: Mapping[str, WorldPose],
    symbols: tuple[ca.SX, ca.SX, ca.SX],
    along_motion: Callable[[ca.SX], ca.SX],
) -> tuple[ca.SX, ca.SX]:
    """A (m, nq) and A q' + b (m,) of all constraints: Φ differentiated, or velocities with differentiated poses."""
    t, q, q_rate = symbols
    bodies, clock = Bodies(chain), ca.SX.sym("clock")
    given, twists = [], []
    for pose in poses.values():
        spin = pose.rotation @ _spin(pose.rotation, along_motion)
        twists.append(ca.densify(ca.vertcat(spin, along_motion(pose.position))))
        given.append(ca.densify(flat_pose(pose)))
    coordinates = coordinates_of(chain, t, q)
    rates = [ca.SX(0, 1)]
    for row in constraint_rows(mechanism, bodies, clock):
        if row.velocity is not None:
            symbols_of_rows, values = [*bodies.twists, *bodies.poses, clock], [*twists, *given, t]
            rates.append(ca.SX(ca.substitute([row.velocity], symbols_of_rows, values)[0]))
        if row.position is not None:
            value = ca.SX(ca.substitute([row.position], [*bodies.poses, clock], [*given, t])[0])
            value += sum((factor * coordinates[name] for name, factor in row.factors.items()), ca.SX(1, 1))
            rates.append(along_motion(value))
    rate = ca.vertcat(*rates)
    return ca.jacobian(rate, q_rate), rate


def _kinetic_energy_of_spring(mass: float, first: ca.SX, second: ca.SX) -> ca.SX:
    """½ ∫ v² dm of a spring whose velocity goes evenly from one end's to the other's (Lidström, ex. 4:14)."""
    return mass / 6.0 * (ca.dot(first, first) + ca.dot(first, second) + ca.dot(second, second))


def _spin(rotation: ca.SX, along_motion: Callable[[ca.SX], ca.SX]) -> ca.SX:
    """The angular velocity (3,) in rotated axes: ω× = Rᵀ R'."""
    turning = rotation.T @ ca.reshape(along_motion(ca.vec(rotation)), 3, 3)
    return 0.5 * ca.vertcat(turning[2, 1] - turning[1, 2], turning[0, 2] - turning[2, 0], turning[1, 0] - turning[0, 1])


def _point(poses: Mapping[str, WorldPose], at: Attachment) -> ca.SX:
    """A point (3,) in ground's frame."""
    if at.part == GROUND:
        return constant(at.point)
    return poses[at.part].position + poses[at.part].rotation @ constant(at.point)
