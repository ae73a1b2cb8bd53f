"""Lagrange's equations from T and V by differentiation (Huston & Liu, ch. 11; Géradin & Rixen).

With q' = N(q) u the equations d/dt(∂T/∂q') - ∂T/∂q = Q are projected onto the speeds by Nᵀ and read
M(q) u' + h(q, u) = Q + Gᵀ λ. G follows from the constraints by differentiation and by virtual velocities. T is written
with the mass and the first and second moments of parts, which are polynomials in masses and lengths also for composite
parts.

This derivation is slow, general, and independent of the recursions; tests compare the two.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.dynamics.constraints.equations import coordinates_by_name
from mbd_sim.dynamics.constraints.rows import constraint_rows
from mbd_sim.dynamics.contact.compliant import compliance_force
from mbd_sim.dynamics.contact.shapes import touch
from mbd_sim.dynamics.forces.bushings import bushing_potential
from mbd_sim.dynamics.forces.elements import damper_force, force_vector, spring_force
from mbd_sim.dynamics.forces.joints import joint_dissipation, joint_forces
from mbd_sim.dynamics.kinematics.joint_motions import quaternion_rotation
from mbd_sim.dynamics.kinematics.links import Link, build_links
from mbd_sim.dynamics.kinematics.parameters import SymbolicParameters, with_symbols
from mbd_sim.dynamics.kinematics.poses import BodySymbols, SymbolicPose, flat_pose, joint_motion, part_poses
from mbd_sim.dynamics.kinematics.state_variables import StateVariables
from mbd_sim.dynamics.layouts.vectors import coordinate_layout
from mbd_sim.dynamics.math.expressions import function_of
from mbd_sim.dynamics.math.spatial import constant, is_absent, skew
from mbd_sim.mechanism.elements.actuators import CoordinatePort
from mbd_sim.mechanism.elements.contacts import ComplianceLaw, Contact
from mbd_sim.mechanism.elements.forces import Bushing
from mbd_sim.mechanism.elements.parts import GROUND, Attachment, Part
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.laws import Varying


@dataclass(frozen=True, eq=False)
class MassMoments:
    """Of a part about the origin of its frame, in its axes.

    `mass` in kg, `first` (3,) = m c in kg·m with the center of mass c, and `second` (3, 3), the inertia tensor, in
    kg·m².
    """

    mass: float | ca.SX
    first: Array | ca.SX
    second: Array | ca.SX


def mass_moments(part: Part) -> MassMoments:
    """Those of a part in numbers (Huston & Liu, sec. 7.6: the parallel axis theorem)."""
    c = part.center
    return MassMoments(part.mass, part.mass * c, part.inertia + part.mass * (c @ c * np.eye(3) - np.outer(c, c)))


def with_springs(mechanism: Mechanism, part: str, moments: MassMoments) -> MassMoments:
    """The moments of a part with those of springs with mass between it and ground: m/3 at the end of each spring."""
    mass, first, second = ca.SX(moments.mass), constant(moments.first), constant(moments.second)
    for spring in mechanism.springs:
        for end in (spring.first, spring.second):
            if end.part == part:
                point, third = constant(end.point), spring.mass / 3.0
                mass, first = mass + third, first + third * point
                second += third * (ca.dot(point, point) * ca.SX.eye(3) - point @ point.T)
    return MassMoments(mass, first, second)


def spatial_inertia(moments: MassMoments, X_LB: Pose) -> ca.SX:
    """The spatial inertia (6, 6) about the origin of a frame L, in its axes (Featherstone, eq. 2.63).

    :param X_LB: the pose in L of the frame B whose moments are given.
    """
    p, rotation = constant(X_LB.position), constant(X_LB.rotation)
    mass, first = ca.SX(moments.mass), rotation @ constant(moments.first)
    own = rotation @ constant(moments.second) @ rotation.T
    both = p @ first.T + first @ p.T
    across = mass * (ca.dot(p, p) * ca.SX.eye(3) - p @ p.T) + 2.0 * ca.dot(p, first) * ca.SX.eye(3) - both
    s = skew(mass * p + first)
    return ca.sparsify(ca.vertcat(ca.horzcat(own + across, s), ca.horzcat(-s, mass * ca.SX.eye(3))))


LOOP_RANK = 1e-11  # singular values below this fraction of the largest count as zero


@dataclass(frozen=True, eq=False)
class LagrangeEquations:
    """The terms of the equations as functions, in SI units.

    `terms(t, q, u, efforts)` gives M (nv, nv), h (nv,) and Q (nv,).
    `energies(t, q, u)` gives the parts T2, T1, T0 of the kinetic energy, of second, first and zeroth degree in the
    speeds, and V, in J. T1 and T0 vanish where nothing is driven.
    `dissipation(t, q, u)` gives Rayleigh's dissipation function D in W of all dampers whose force is -∂D/∂u: viscous
    ones, and those of a power of the speed; not of dry friction and stops.
    `constraints(t, q, u)` gives G (m, nv) and γ (m,) of all rows, with G u' + γ = 0.

    With symbolic parameters their values (n,) are the last argument of each function.
    """

    terms: ca.Function
    energies: ca.Function
    dissipation: ca.Function
    constraints: ca.Function

    def accelerations(self, q: Array, u: Array, efforts: Array, t: float = 0.0) -> Array:
        """u' (nv,) at one state; redundant rows share their forces in the least-squares sense."""
        mass, inertial, forces = (np.array(value) for value in self.terms(t, q, u, efforts))
        gradient, bias = (np.array(value) for value in self.constraints(t, q, u))
        scale = np.sqrt(np.diag(mass))[:, None]
        rows = gradient / scale.T
        size = np.linalg.norm(rows, axis=1, keepdims=True)
        rows = np.divide(rows, size, where=size > 0.0, out=np.zeros_like(rows))
        bias = np.divide(bias, size, where=size > 0.0, out=np.zeros_like(bias))
        matrix = np.block([[mass / (scale @ scale.T), rows.T], [rows, np.zeros((len(rows), len(rows)))]])
        right = np.vstack([(forces - inertial) / scale, -bias])
        solution = np.linalg.lstsq(matrix, right, rcond=LOOP_RANK)[0] if len(rows) else np.linalg.solve(matrix, right)
        return np.asarray((solution[: len(mass)] / scale).ravel(), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class _Kinematics:
    """Positions as functions of t and q (nq,); their rates are linear in the symbols `q_rates` (nq,)."""

    t: ca.SX
    q: ca.SX
    q_rates: ca.SX
    poses: Mapping[str, SymbolicPose]

    def rate(self, expression: ca.SX) -> ca.SX:
        """The time derivative of an expression of t and q."""
        return ca.jtimes(expression, self.q, self.q_rates) + ca.jtimes(expression, self.t, ca.SX(1))

    def omega(self, rotation: ca.SX) -> ca.SX:
        """The angular velocity (3,) in rotated axes: ω× = Rᵀ R'."""
        spin = rotation.T @ ca.reshape(self.rate(ca.vec(rotation)), 3, 3)
        return 0.5 * ca.vertcat(spin[2, 1] - spin[1, 2], spin[0, 2] - spin[2, 0], spin[1, 0] - spin[0, 1])

    def point(self, at: Attachment) -> ca.SX:
        """A point (3,) in ground's frame."""
        if at.part == GROUND:
            return constant(at.point)
        return self.poses[at.part].position + self.poses[at.part].rotation @ constant(at.point)

    def rotation(self, part: str) -> ca.SX:
        """The axes (3, 3) of a part in ground's frame."""
        return ca.SX(np.eye(3)) if part == GROUND else self.poses[part].rotation


@dataclass(eq=False)
class _Energies:
    """T, V and Rayleigh's dissipation function, and the generalized forces (nq,) of applied forces along q'."""

    kinetic: ca.SX
    potential: ca.SX
    dissipation: ca.SX
    applied: ca.SX


def lagrange_equations(
    mechanism: Mechanism,
    parameters: SymbolicParameters | None = None,
    moments: Mapping[str, MassMoments] | None = None,
) -> LagrangeEquations:
    """Derive the equations of a mechanism from its energies.

    :param parameters: the numbers of the mechanism that are symbols; none by default.
    :param moments: those of all parts, which may have these symbols; by default those of the mechanism, in numbers.
    """
    layout, links, given = coordinate_layout(mechanism), build_links(mechanism), list[ca.SX]()
    if parameters is not None:
        mechanism, links = with_symbols(mechanism, parameters)
        given = [parameters.symbols]
    t, q, q_rates = ca.SX.sym("t"), ca.SX.sym("q", layout.nq), ca.SX.sym("q'", layout.nq)
    u, efforts = ca.SX.sym("u", layout.nv), ca.SX.sym("e", layout.nv)
    motions = [joint_motion(link, t, q, u) for link in links]
    poses = dict(zip((link.joint.outboard for link in links), part_poses(links, motions), strict=True))
    kinematics = _Kinematics(t, q, q_rates, poses)
    state = StateVariables(links, t, q, u)
    energies = _energies(mechanism, kinematics, state, moments)
    _add_rotors(energies, mechanism, links, kinematics)
    joints, of_joints = joint_forces(links, q, u, efforts, state), joint_dissipation(links, u)

    rates = ca.SX(layout.nq, 1)
    for link, motion in zip(links, motions, strict=True):
        rates[link.q] = motion.q_rates
    to_rates = ca.jacobian(rates, u)
    momentum = ca.gradient(energies.kinetic, q_rates)
    mass = ca.jacobian(momentum, q_rates)
    inertial = kinematics.rate(momentum) - ca.gradient(energies.kinetic, q) + mass @ ca.jtimes(rates, q, q_rates)
    along_q = energies.applied - ca.gradient(energies.dissipation, q_rates)
    forces = joints.generalized + to_rates.T @ (along_q - ca.gradient(energies.potential, q))
    for effort in (one for one in mechanism.efforts if one.coordinate in state.rows):
        speed = ca.SX.zeros(layout.nv, 1)
        speed[state.rows[effort.coordinate]] = 1.0
        forces += speed * state.value(effort.effort)

    def in_speeds(expression: ca.SX) -> ca.SX:
        return ca.substitute(expression, q_rates, rates)

    quadratic = 0.5 * ca.dot(q_rates, mass @ q_rates)
    constant_part = ca.substitute(energies.kinetic, q_rates, ca.SX.zeros(layout.nq, 1))
    kinetic_parts = [quadratic, energies.kinetic - quadratic - constant_part, constant_part]
    terms = [to_rates.T @ mass @ to_rates, to_rates.T @ inertial, forces]
    gradient, velocity = _constraint_rates(mechanism, links, kinematics)
    rows = [gradient @ to_rates, kinematics.rate(velocity) + gradient @ ca.jtimes(rates, q, q_rates)]
    parts = [*kinetic_parts, energies.potential + joints.potential]
    return LagrangeEquations(
        terms=ca.Function("terms", [t, q, u, efforts, *given], [in_speeds(term) for term in terms]),
        energies=ca.Function("energies", [t, q, u, *given], [in_speeds(part) for part in parts]),
        dissipation=ca.Function("dissipation", [t, q, u, *given], [in_speeds(energies.dissipation) + of_joints]),
        constraints=ca.Function("constraints", [t, q, u, *given], [ca.densify(in_speeds(row)) for row in rows]),
    )


def _energies(
    mechanism: Mechanism, kinematics: _Kinematics, state: StateVariables, moments: Mapping[str, MassMoments] | None
) -> _Energies:
    """The energies of the parts and of the force elements."""
    zero = ca.SX(1, 1)
    energies = _Energies(zero, zero, zero, ca.SX(kinematics.q.shape[0], 1))
    gravity, bodies = constant(mechanism.gravity), mechanism.bodies
    for name, X_WB in kinematics.poses.items():
        if moments is None:
            _add_part(energies, kinematics, X_WB, bodies[name], gravity)
        else:
            _add_moments(energies, kinematics, X_WB, moments[name], gravity)
    for spring in mechanism.springs:
        first, second = kinematics.point(spring.first), kinematics.point(spring.second)
        _, energy, loss = spring_force(spring, second - first, kinematics.rate(second - first))
        energies.potential += energy
        energies.dissipation += 0.5 * loss
        if isinstance(spring.law, Varying):
            length = ca.norm_2(second - first)
            rate = kinematics.rate(length)
            tension = state.stretched(spring.law.force, length - spring.length, rate)
            energies.applied -= ca.jacobian(rate, kinematics.q_rates).T * tension
        if not is_absent(spring.mass):
            rates = kinematics.rate(first), kinematics.rate(second)
            energies.kinetic += _kinetic_energy_of_spring(spring.mass, *rates)
            energies.potential -= spring.mass * ca.dot(gravity, first + second) / 2.0
    for damper in mechanism.dampers:
        line = kinematics.point(damper.second) - kinematics.point(damper.first)
        energies.dissipation += damper_force(damper, line, kinematics.rate(line))[2]
    for applied in mechanism.applied:
        rotation = kinematics.poses[applied.at.part].rotation
        moved = kinematics.omega(rotation) if applied.couple else kinematics.rate(kinematics.point(applied.at))
        axes = constant(np.eye(3)) if applied.axes_of == GROUND else kinematics.poses[applied.axes_of].rotation
        vector = force_vector(applied, axes, state)
        vector = rotation.T @ vector if applied.couple else vector
        energies.applied += ca.jacobian(moved, kinematics.q_rates).T @ vector
    for potential in mechanism.potentials:
        energies.potential += state.value(potential.energy)
    for bushing in mechanism.bushings:
        _add_bushing(energies, kinematics, bushing)
    for contact in mechanism.contacts:
        if isinstance(contact.law, ComplianceLaw):
            _add_compliance(energies, kinematics, contact, contact.law)
    return energies


def _add_part(energies: _Energies, kinematics: _Kinematics, X_WB: SymbolicPose, part: Part, gravity: ca.SX) -> None:
    center = X_WB.position + X_WB.rotation @ constant(part.center)
    velocity, omega = kinematics.rate(center), kinematics.omega(X_WB.rotation)
    energies.kinetic += 0.5 * part.mass * ca.dot(velocity, velocity)
    energies.kinetic += 0.5 * ca.dot(omega, constant(part.inertia) @ omega)
    energies.potential -= part.mass * ca.dot(gravity, center)


def _add_moments(
    energies: _Energies, kinematics: _Kinematics, X_WB: SymbolicPose, moments: MassMoments, gravity: ca.SX
) -> None:
    """Add the energies of a part from moments about the origin of its frame.

    T = ½ m v² + v·(ω × s) + ½ ω·J ω with the first moment s = m c.
    """
    velocity, omega = kinematics.rate(X_WB.position), kinematics.omega(X_WB.rotation)
    mass, first = moments.mass, constant(moments.first)
    energies.kinetic += 0.5 * mass * ca.dot(velocity, velocity)
    energies.kinetic += ca.dot(velocity, X_WB.rotation @ ca.cross(omega, first))
    energies.kinetic += 0.5 * ca.dot(omega, constant(moments.second) @ omega)
    energies.potential -= ca.dot(gravity, mass * X_WB.position + X_WB.rotation @ first)


def _add_rotors(energies: _Energies, mechanism: Mechanism, links: Sequence[Link], kinematics: _Kinematics) -> None:
    """Add the kinetic energy of rotors, ½ J (N q')². The efforts of actuators are among the efforts."""
    speeds = {name: kinematics.rate(x) for name, x in coordinates_by_name(links, kinematics.t, kinematics.q).items()}
    for link in links:
        if link.joint.kind.quaternion is not None:
            turn = quaternion_rotation(kinematics.q[link.q, :][-4:])
            speeds |= dict(zip(link.joint.coordinate_names[-3:], ca.vertsplit(kinematics.omega(turn)), strict=True))
    for actuator in mechanism.actuators:
        motor = actuator.motor
        if isinstance(actuator.port, CoordinatePort):
            speed = motor.gear * speeds[actuator.port.coordinate]
            energies.kinetic += 0.5 * motor.rotor_inertia * speed**2


def _add_bushing(energies: _Energies, kinematics: _Kinematics, bushing: Bushing) -> None:
    """Add the potential of a bushing and its dissipation function."""
    axes = kinematics.rotation(bushing.first.part) @ constant(bushing.first_axes)
    displacement = axes.T @ (kinematics.point(bushing.second) - kinematics.point(bushing.first))
    rotation = axes.T @ kinematics.rotation(bushing.second.part) @ constant(bushing.second_axes)
    rates = ca.vertcat(kinematics.rate(displacement), rotation @ kinematics.omega(rotation))
    energies.potential += bushing_potential(bushing, displacement, rotation)
    energies.dissipation += 0.5 * ca.dot(rates, constant(bushing.damping) @ rates)


def _add_compliance(energies: _Energies, kinematics: _Kinematics, contact: Contact, law: ComplianceLaw) -> None:
    """Add the potential of a compliant contact, and its damping and friction."""
    ends = [contact.first.at, contact.second.at]
    frames = [SymbolicPose(kinematics.point(at), kinematics.rotation(at.part)) for at in ends]
    touching = touch(contact, frames[0], frames[1])
    velocities = [
        kinematics.rate(frame.position)
        + ca.cross(frame.rotation @ kinematics.omega(frame.rotation), touching.point - frame.position)
        for frame in frames
    ]
    relative = velocities[0] - velocities[1]
    force = compliance_force(law, touching, relative)
    energies.potential += force.potential
    energies.applied += ca.jacobian(relative, kinematics.q_rates).T @ force.resisting


def _constraint_rates(mechanism: Mechanism, links: Sequence[Link], kinematics: _Kinematics) -> tuple[ca.SX, ca.SX]:
    """A (m, nq) and A q' + b (m,) of all constraints: Φ differentiated, or velocities with differentiated poses."""
    bodies, time = BodySymbols(links), ca.SX.sym("time")
    poses, twists = [], []
    for pose in kinematics.poses.values():
        omega = pose.rotation @ kinematics.omega(pose.rotation)
        twists.append(ca.densify(ca.vertcat(omega, kinematics.rate(pose.position))))
        poses.append(ca.densify(flat_pose(pose)))
    coordinates = coordinates_by_name(links, kinematics.t, kinematics.q)
    rates = [ca.SX(0, 1)]
    for row in constraint_rows(mechanism, bodies, time):
        if row.velocity is not None:
            symbols, values = [*bodies.twists, *bodies.poses, time], [*twists, *poses, kinematics.t]
            rates.append(ca.SX(ca.substitute([row.velocity], symbols, values)[0]))
        if row.position is not None:
            value = ca.SX(ca.substitute([row.position], [*bodies.poses, time], [*poses, kinematics.t])[0])
            value += sum((factor * coordinates[name] for name, factor in row.factors.items()), ca.SX(1, 1))
            if row.less is not None:
                names = {name.written: coordinates[name.coordinate] for name in row.less.state}
                value -= function_of(row.less, {"t": kinematics.t, **names})
            rates.append(kinematics.rate(value))
    rate = ca.vertcat(*rates)
    return ca.jacobian(rate, kinematics.q_rates), rate


def _kinetic_energy_of_spring(mass: float, first: ca.SX, second: ca.SX) -> ca.SX:
    """½ ∫ v² dm of a spring whose velocity is linear between those of its ends, (3,) in m/s (Lidström, ex. 4:14)."""
    return mass / 6.0 * (ca.dot(first, first) + ca.dot(first, second) + ca.dot(second, second))
