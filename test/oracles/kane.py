"""Kane's equations in numpy, from a mechanism's records: an oracle for the equations of motion.

It shares no code with `mbd_sim.dynamics`, `mbd_sim.compiler` or `mbd_sim.simulation`. It does share what comes before
them: the built mechanism (`mbd_sim.files` and the records of `mbd_sim.mechanism`, with the choice of the
spanning tree, the meaning of units and axes, and the inertia of shapes) and the parser of expressions
(`mbd_sim.mechanism.values.expression`). An error in those is invisible here; the closed forms in test/physics cover them.

Every quantity is a jet: its value and its first and second time derivatives, by the rules of differentiation.
Partial velocities are the velocities at unit speeds (Huston & Liu, sec. 11.4), and the equations are
Σ m a·v_r + (I α + ω × I ω)·ω_r = Q_r.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from mbd_sim.mechanism.elements.actuators import CoordinatePort, SumPort, WrenchPort
from mbd_sim.mechanism.values.laws import GreenStrain, Varying
from test.oracles.jets import Jet, expression_jet
from test.oracles.kane_actuators import effort as actuator_effort
from test.oracles.kane_laws import dry_friction, elastic, power_law
from test.oracles.kane_rows import constrained_velocities

GROUND = "ground"


def skew(v):
    """The matrix of the cross product with v (3,)."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def axial(matrix):
    """The vector (3,) of the skew part of a matrix."""
    return 0.5 * np.array([matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]])


@dataclass
class PartMotion:
    """A part's center of mass, axes and origin in ground's frame, as jets."""

    center: Jet
    rotation: Jet
    origin: Jet

    @property
    def omega(self):
        """Angular velocity in the part's axes: Rᵀ R' = ω×."""
        return axial(self.rotation.d[0].T @ self.rotation.d[1])

    @property
    def alpha(self):
        """Angular acceleration in the part's axes: Rᵀ R'' = ω× ω× + α×."""
        return axial(self.rotation.d[0].T @ self.rotation.d[2])


SIZES = {
    "revolute": (1, 1),
    "prismatic": (1, 1),
    "screw": (1, 1),
    "cylindrical": (2, 2),
    "universal": (2, 2),
    "planar": (3, 3),
    "spherical": (4, 3),
    "fixed": (0, 0),
    "free": (7, 6),
}


def coordinate_slices(mechanism):
    """The slices of each joint's coordinates and speeds, in declared order, and their numbers nq and nv."""
    found, nq, nv = {}, 0, 0
    for name, joint in mechanism.joints.items():
        more_q, more_v = (0, 0) if joint.drive else SIZES[joint.type]
        found[name] = (slice(nq, nq + more_q), slice(nv, nv + more_v))
        nq, nv = nq + more_q, nv + more_v
    return found, nq, nv


def _driven(expression, t):
    """A drive's value and derivatives."""
    return expression_jet(expression, t=Jet(t, 1.0))


def _turn(axis, x):
    k = skew(axis)
    turned = np.eye(3) + np.sin(x.d[0]) * k + (1.0 - np.cos(x.d[0])) * k @ k
    return Jet(np.zeros(3)), Jet(turned, turned @ k * x.d[1], turned @ (k @ k * x.d[1] ** 2 + k * x.d[2]))


def _slide(axis, x):
    return x.linear(lambda value: axis * value), Jet(np.eye(3))


def _then(first, second):
    return first[0] + first[1] @ second[0], first[1] @ second[1]


def _ball(p, omega, omega_rate):
    def rates(p, omega):
        return 0.5 * np.concatenate([[-p[1:] @ omega], p[0] * omega + np.cross(p[1:], omega)])

    p1 = rates(p, omega)
    jet = Jet(p, p1, rates(p1, omega) + rates(p, omega_rate))
    k, w = jet.linear(lambda v: skew(v[1:])), jet.linear(lambda v: v[0])
    return Jet(np.eye(3)) + (w * k + k @ k).linear(lambda m: 2.0 * m)


def joint_jets(joint, q, u, u_rate, t):
    """Position and rotation of the child-side frame in the parent-side frame."""
    if joint.type == "fixed":
        return Jet(np.zeros(3)), Jet(np.eye(3))
    if joint.type == "spherical":
        return Jet(np.zeros(3)), _ball(q, u, u_rate)
    if joint.type == "free":
        return Jet(q[:3], u[:3], u_rate[:3]), _ball(q[3:], u[3:], u_rate[3:])
    if joint.drive:
        x = [_driven(expression, t) for expression in joint.drive]
    else:
        x = [Jet(*values) for values in zip(q, u, u_rate, strict=True)]
    axis, second = joint.axis, joint.second
    match joint.type:
        case "prismatic":
            return _slide(axis, x[0])
        case "revolute":
            return _turn(axis, x[0])
        case "screw":
            return _then(_slide(axis, x[0].linear(lambda v: v * joint.lead / (2.0 * np.pi))), _turn(axis, x[0]))
        case "cylindrical":
            return _then(_slide(axis, x[0]), _turn(axis, x[1]))
        case "universal":
            return _then(_turn(axis, x[0]), _turn(second, x[1]))
        case "planar":
            along = _then(_slide(second, x[0]), _slide(np.cross(axis, second), x[1]))
            return _then(along, _turn(axis, x[2]))
    raise AssertionError(joint.type)


def motions(mechanism, q, u, u_rate=None, t=0.0):
    """The motion of every part, by name."""
    where, _, nv = coordinate_slices(mechanism)
    u_rate = np.zeros(nv) if u_rate is None else u_rate
    frames = {GROUND: (Jet(np.zeros(3)), Jet(np.eye(3)))}
    waiting = dict(mechanism.joints)
    while waiting:
        for name, joint in list(waiting.items()):
            if (joint.parent in frames) == (joint.child in frames):
                continue
            in_q, in_u = where[name]
            position, rotation = joint_jets(joint, q[in_q], u[in_u], u_rate[in_u], t)
            a, b = joint.parent_pose, joint.child_pose
            # the child in the parent's frame: (a) (joint) (b)⁻¹
            rotation = rotation.linear(lambda r, a=a, b=b: a.rotation @ r @ b.rotation.T)
            position = position.linear(lambda p, a=a: a.rotation @ p) + -rotation.linear(lambda r, b=b: r @ b.position)
            position = Jet(a.position + position.d[0], *position.d[1:])
            inner, outer = joint.parent, joint.child
            if joint.child in frames:
                position, rotation = -(rotation.transposed @ position), rotation.transposed
                inner, outer = outer, inner
            origin, axes = frames[inner]
            frames[outer] = (origin + axes @ position, axes @ rotation)
            del waiting[name]
    return {
        name: PartMotion(frames[name][0] + frames[name][1] @ Jet(part.center), frames[name][1], frames[name][0])
        for name, part in mechanism.parts.items()
    }


def joint_forces(mechanism, q, u, efforts, t=0.0):
    """Generalized forces (nv,) of efforts, springs, dampers and stops, and the potential energy of the springs."""
    where, _, _ = coordinate_slices(mechanism)
    forces, potential = np.array(efforts, dtype=float), 0.0
    named = NamedValues(mechanism, q, u, t)
    for effort in mechanism.efforts:
        if effort.coordinate in mechanism.coordinate_names:
            forces[mechanism.coordinate_names.index(effort.coordinate)] += named.value(effort.effort)
    for element in mechanism.potentials:
        potential += named.value(element.energy)
        for name in {state.coordinate for state in element.energy.state} & set(mechanism.coordinate_names):
            forces[mechanism.coordinate_names.index(name)] -= named.slope(element.energy, name)
    for name, joint in mechanism.joints.items():
        in_q, in_u = where[name]
        for place, row in enumerate(range(in_u.start, in_u.stop)):
            forces[row] -= joint.damping[place] * u[row]
            if joint.type not in ("spherical", "free"):
                stretch = q[in_q.start + place] - joint.rest[place]
                forces[row] -= joint.stiffness[place] * stretch
                potential += 0.5 * joint.stiffness[place] * stretch**2
                if isinstance(joint.spring, Varying):
                    forces[row] -= named.value(joint.spring.force, stretch, u[row])
                elif joint.spring is not None:
                    force, energy = elastic(joint.spring, stretch)
                    forces[row] -= force
                    potential += energy
        if joint.damper is not None:
            forces[in_u.start] -= power_law(joint.damper, u[in_u.start])
        if joint.friction is not None:
            forces[in_u.start] -= dry_friction(joint.friction, u[in_u.start])
        for place, limits in enumerate(joint.limits):
            if limits is None or not limits.stiffness:
                continue
            x, row = q[in_q.start + place], in_u.start + place
            excess = x - min(max(x, limits.lower), limits.upper)
            forces[row] -= limits.stiffness * excess * max(0.0, 1.0 + limits.damping * np.sign(excess) * u[row])
            potential += 0.5 * limits.stiffness * excess**2
    return forces, potential


class NamedValues:
    """The coordinates and speeds of all joints by name."""

    def __init__(self, mechanism, q, u, t):
        self._jets, self._t = coordinate_jets(mechanism, q, u, t), t
        self._speeds = dict(zip(mechanism.coordinate_names, u, strict=True))

    def value(self, expression, stretch=0.0, rate=0.0):
        """The value of an expression of these names, of time, and of an elongation and its rate."""
        names = {"t": self._t, "x": stretch, "x.velocity": rate}
        for name in expression.state:
            speeds = self._speeds if name.coordinate in self._speeds else {}
            speed = speeds.get(name.coordinate)
            jet = self._jets.get(name.coordinate)
            names[name.written] = (jet.d[1] if speed is None else speed) if name.speed else jet.d[0]
        return expression.value({name: names[name] for name in expression.variables})

    def slope(self, expression, coordinate):
        """The partial derivative of an expression of coordinates and of time in one of them."""
        values = {name.written: self._jets[name.coordinate].d[0] for name in expression.state}
        jets = {
            name.written: Jet(values[name.written], float(name.coordinate == coordinate)) for name in expression.state
        }
        return expression_jet(expression, t=Jet(self._t), **jets).d[1]


def _velocity_of(moving, at):
    """The position and velocity of a point of a part in ground's frame."""
    if at.part == GROUND:
        return at.point, np.zeros(3)
    frame = moving[at.part]
    return tuple(frame.origin.d[i] + frame.rotation.d[i] @ at.point for i in (0, 1))


def element_forces(mechanism, moving, t, named=None):
    """(attachment, whether it is a couple, force or couple (3,) in ground's axes) of every element; springs' energy.

    `named` are the values of the names in expressions; not needed if these are of time alone.
    """
    found, energy = [], 0.0
    for spring in mechanism.springs:
        (a, a1), (b, b1) = (_velocity_of(moving, at) for at in (spring.first, spring.second))
        line, length = b - a, np.linalg.norm(b - a)
        along = line / length
        stretch = length - spring.length
        if isinstance(spring.law, GreenStrain):
            k, natural = spring.law.stiffness, spring.law.length
            force = k * stretch * (1.0 + stretch / natural) * (1.0 + stretch / (2.0 * natural))
            stored = 0.5 * k * stretch**2 * (1.0 + stretch / (2.0 * natural)) ** 2
        elif isinstance(spring.law, Varying):
            force, stored = named.value(spring.law.force, stretch, along @ (b1 - a1)), 0.0
        else:
            force, stored = elastic(spring.law, stretch)
        tension = force + spring.damping * along @ (b1 - a1)
        weight = spring.mass * mechanism.gravity / 2.0
        found += [(spring.first, False, tension * along + weight), (spring.second, False, weight - tension * along)]
        energy += stored - weight @ (a + b)
    for damper in mechanism.dampers:
        (a, a1), (b, b1) = (_velocity_of(moving, at) for at in (damper.first, damper.second))
        force = power_law(damper.law, b1 - a1)
        if damper.needs_line:
            along = (b - a) / np.linalg.norm(b - a)
            force = along * power_law(damper.law, along @ (b1 - a1))
        found += [(damper.first, False, force), (damper.second, False, -force)]
    for bushing in mechanism.bushings:
        wrenches, stored = bushing_wrenches(bushing, moving)
        found += wrenches
        energy += stored
    for applied in mechanism.applied:
        vector = np.array([named.value(one) if one.state else one.at(t) for one in applied.vector])
        vector = applied.axes @ vector
        if applied.axes_of != GROUND:
            vector = moving[applied.axes_of].rotation.d[0] @ vector
        found.append((applied.at, applied.couple, vector))
    return found, energy


def bushing_wrenches(bushing, moving):
    """The forces and couples of a bushing at its ends, as in `element_forces`, and its energy.

    The rate of a rotation vector φ with the angle θ, of rotated axes with the angular velocity ω in fixed axes, is
    ω - φ×ω/2 + (1 - (θ/2) cot(θ/2)) φ×(φ×ω)/θ² (Bullo & Murray 1995).
    """
    (a, a1), (b, b1) = (_velocity_of(moving, at) for at in (bushing.first, bushing.second))
    turned, spin = [], []
    for at in (bushing.first, bushing.second):
        ground = at.part == GROUND
        turned.append(np.eye(3) if ground else moving[at.part].rotation.d[0])
        spin.append(np.zeros(3) if ground else turned[-1] @ moving[at.part].omega)
    axes = turned[0] @ bushing.first_axes
    phi = Rotation.from_matrix(axes.T @ turned[1] @ bushing.second_axes).as_rotvec()
    angle = np.linalg.norm(phi)
    part = 1.0 / 12.0 if angle < 1e-4 else (1.0 - 0.5 * angle / np.tan(0.5 * angle)) / angle**2
    rates_by_omega = np.eye(3) - 0.5 * skew(phi) + part * skew(phi) @ skew(phi)
    z = np.concatenate([axes.T @ (b - a), phi])
    w = np.concatenate([axes.T @ (b1 - a1 - np.cross(spin[0], b - a)), axes.T @ (spin[1] - spin[0])])
    elastic_forces, damping = bushing.stiffness @ z, bushing.damping @ w
    force = -axes @ (elastic_forces[:3] + damping[:3])
    couple = -axes @ (rates_by_omega.T @ elastic_forces[3:] + damping[3:])
    found = [(bushing.first, False, -force), (bushing.second, False, force)]
    found += [(bushing.first, True, -couple - np.cross(b - a, force)), (bushing.second, True, couple)]
    return found, 0.5 * z @ bushing.stiffness @ z


RANK = 1e-9  # singular values below this fraction of the largest count as zero


@dataclass
class Equations:
    """M u' = f + Gᵀ λ with G u' + γ = 0, and the energies in J.

    `gradient` is G (m, nv), `bias` is γ (m,), and `errors` (m,) are the violations of the velocity constraints.
    """

    mass: np.ndarray
    forces: np.ndarray
    kinetic: float
    potential: float
    gradient: np.ndarray
    bias: np.ndarray
    errors: np.ndarray

    @property
    def accelerations(self):
        """u' (nv,): free accelerations, changed as little as possible in the metric of M (Gauss's principle)."""
        free = np.linalg.solve(self.mass, self.forces)
        if not self.gradient.size:
            return free
        unit, rows, sizes = self._unit
        defect = (self.gradient @ free + self.bias) / sizes
        return free - unit @ np.linalg.lstsq(rows, defect, rcond=RANK)[0]

    @property
    def _unit(self):
        """Speeds (nv, nv) with a unit mass matrix, G in these speeds with rows of unit length, and their lengths."""
        unit = np.linalg.inv(np.linalg.cholesky(self.scaled)).T / self.scale[:, None]
        rows = self.gradient @ unit
        sizes = np.linalg.norm(rows, axis=1)
        sizes[sizes < 1e-13 * np.max(sizes, initial=0.0)] = np.inf
        return unit, rows / sizes[:, None], sizes

    @property
    def constraint_condition(self):
        """The condition number of G M⁻¹ Gᵀ on its range, with rows of unit length."""
        if not self.gradient.size:
            return 1.0
        values = np.linalg.svd(self._unit[1])[1]
        return (values[0] / values[values > RANK * values[0]].min()) ** 2

    @property
    def condition(self):
        """The condition number of M scaled to a unit diagonal."""
        return np.linalg.cond(self.scaled)

    @property
    def scale(self):
        return np.sqrt(np.diag(self.mass))

    @property
    def scaled(self):
        return self.mass / np.outer(self.scale, self.scale)


def actuator_forces(mechanism, q, u, moving, driving):
    """Generalized forces (nv,) of actuators on coordinates, and wrenches of those between points: see `element_forces`.

    `driving` are the commands by channel and the states of each actuator, by its name.
    """
    where, _, nv = coordinate_slices(mechanism)
    positions = {}
    for name, joint in mechanism.joints.items():
        if not joint.drive and joint.type not in ("spherical", "free"):
            positions |= zip(joint.coordinate_names, q[where[name][0]], strict=True)
    forces, wrenches = np.zeros(nv), []
    for actuator in mechanism.actuators:
        commands, states = driving[actuator.name]
        if isinstance(actuator.port, CoordinatePort | SumPort):
            one = isinstance(actuator.port, CoordinatePort)
            factors = {actuator.port.coordinate: 1.0} if one else actuator.port.factors
            terms = [(mechanism.coordinate_names.index(name), name, c) for name, c in factors.items()]
            x, v = sum(c * positions.get(name, 0.0) for _, name, c in terms), sum(c * u[row] for row, _, c in terms)
            for row, _, factor in terms:
                forces[row] += factor * actuator_effort(actuator, commands, states, x, v)
            continue
        if isinstance(actuator.port, WrenchPort):
            at, axes = actuator.port.at, moving[actuator.port.at.part].rotation.d[0]
            force, couple = axes @ actuator.port.force, axes @ actuator.port.couple
            v = force @ _velocity_of(moving, at)[1] + couple @ (axes @ moving[at.part].omega)
            effort = actuator_effort(actuator, commands, states, 0.0, v)
            wrenches += [(at, False, effort * force), (at, True, effort * couple)]
            continue
        ends = actuator.port.first, actuator.port.second
        (a, a1), (b, b1) = (_velocity_of(moving, at) for at in ends)
        length = np.linalg.norm(b - a)
        along = (b - a) / length
        push = actuator_effort(actuator, commands, states, length, along @ (b1 - a1)) * along
        wrenches += [(ends[0], False, -push), (ends[1], False, push)]
    return forces, wrenches


def rotor_masses(mechanism):
    """The inertia (nv,) of the rotors of motors, as their coordinates feel it."""
    masses = np.zeros(len(mechanism.coordinate_names))
    for actuator in mechanism.actuators:
        if isinstance(actuator.port, CoordinatePort):
            row = mechanism.coordinate_names.index(actuator.port.coordinate)
            masses[row] += actuator.motor.rotor_inertia * actuator.motor.gear**2
    return masses


def equations(mechanism, q, u, efforts, t=0.0, driving=None):
    """Kane's equations at one state; `driving` is that of `actuator_forces`, if there are actuators."""
    _, _, nv = coordinate_slices(mechanism)
    moving = motions(mechanism, q, u, t=t)
    without_speeds = motions(mechanism, q, np.zeros(nv), t=t)
    unit = [motions(mechanism, q, direction, t=t) for direction in np.eye(nv)]
    speeds = [u, np.zeros(nv), *np.eye(nv)]
    mass, forces = np.zeros((nv, nv)), np.zeros(nv)
    kinetic = 0.0
    spring_forces, potential = joint_forces(mechanism, q, u, efforts, t)
    forces += spring_forces
    applied, energy = element_forces(mechanism, moving, t, NamedValues(mechanism, q, u, t))
    potential += energy
    if driving is not None:
        pushed, wrenches = actuator_forces(mechanism, q, u, moving, driving)
        forces += pushed
        applied += wrenches
        mass += np.diag(rotor_masses(mechanism))
        kinetic += 0.5 * rotor_masses(mechanism) @ u**2
    for at, couple, vector in applied:
        for row, direction in enumerate(unit):
            if at.part == GROUND:
                continue
            if couple:
                partial = moving[at.part].rotation.d[0] @ (direction[at.part].omega - without_speeds[at.part].omega)
            else:
                partial = _velocity_of(direction, at)[1] - _velocity_of(without_speeds, at)[1]
            forces[row] += partial @ vector
    for name, part in mechanism.parts.items():
        motion = moving[name]
        partial_v = np.array([m[name].center.d[1] - without_speeds[name].center.d[1] for m in unit]).reshape(nv, 3)
        partial_w = np.array([m[name].omega - without_speeds[name].omega for m in unit]).reshape(nv, 3)
        w = motion.omega
        mass += part.mass * partial_v @ partial_v.T + partial_w @ part.inertia @ partial_w.T
        forces += partial_v @ (part.mass * (mechanism.gravity - motion.center.d[2]))
        forces -= partial_w @ (part.inertia @ motion.alpha + np.cross(w, part.inertia @ w))
        velocity = motion.center.d[1]
        kinetic += 0.5 * part.mass * velocity @ velocity + 0.5 * w @ part.inertia @ w
        potential -= part.mass * mechanism.gravity @ motion.center.d[0]
    for spring in mechanism.springs:
        for at in (spring.first, spring.second):  # one end of a spring with mass is fixed; a third of it moves
            if at.part == GROUND or not spring.mass:
                continue
            at_rest = _velocity_of(without_speeds, at)[1]
            partial = np.array([_velocity_of(m, at)[1] - at_rest for m in unit]).reshape(nv, 3)
            frame = moving[at.part]
            forces -= partial @ (frame.origin.d[2] + frame.rotation.d[2] @ at.point) * spring.mass / 3.0
            mass += partial @ partial.T * spring.mass / 3.0
            velocity = _velocity_of(moving, at)[1]
            kinetic += velocity @ velocity * spring.mass / 6.0
    gradient, bias, errors = _constraint_rows(
        mechanism, q, t, zip(speeds, [moving, without_speeds, *unit], strict=True)
    )
    return Equations(mass, forces, kinetic, potential, gradient, bias, errors)


def coordinate_jets(mechanism, q, u, t):
    """The jets of all joint coordinates by name at u' = 0; angular velocities have no coordinates."""
    where, _, _ = coordinate_slices(mechanism)
    found = {}
    for name, joint in mechanism.joints.items():
        in_q, in_u = where[name]
        values = [_driven(expression, t) for expression in joint.drive]
        if not values and joint.type != "spherical":
            values = [Jet(x, x1) for x, x1 in zip(q[in_q], u[in_u], strict=False)]
            values = values[:3] if joint.type == "free" else values
        found |= dict(zip(joint.motion_names, values, strict=False))
    return found


def constraint_rows(mechanism, q, u, t):
    """G (m, nv) by unit speeds, γ (m,), and the velocities (m,) that should be zero."""
    nv = coordinate_slices(mechanism)[2]
    cases = [u, np.zeros(nv), *np.eye(nv)]
    return _constraint_rows(mechanism, q, t, [(speeds, motions(mechanism, q, speeds, t=t)) for speeds in cases])


def _constraint_rows(mechanism, q, t, cases):
    """The same from the motions with the speeds at hand, without speeds, and with each unit speed."""

    def velocities(speeds, moving):
        rows = constrained_velocities(mechanism, moving, coordinate_jets(mechanism, q, speeds, t), t)
        return [np.concatenate([np.zeros(0), *(np.atleast_1d(row.d[place]) for row in rows)]) for place in (0, 1)]

    (value, rate), (at_rest, _), *unit = (velocities(speeds, moving) for speeds, moving in cases)
    gradient = np.array([velocity - at_rest for velocity, _ in unit]).reshape(len(unit), len(at_rest)).T
    return gradient, rate, value


def momentum(mechanism, q, u):
    """Linear momentum (3,), and angular momentum (3,) about ground's origin."""
    linear, angular = np.zeros(3), np.zeros(3)
    for name, motion in motions(mechanism, q, u).items():
        part = mechanism.parts[name]
        linear += part.mass * motion.center.d[1]
        angular += part.mass * np.cross(motion.center.d[0], motion.center.d[1])
        angular += motion.rotation.d[0] @ part.inertia @ motion.omega
    return linear, angular
