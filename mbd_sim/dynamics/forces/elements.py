"""Force elements and external wrenches: their wrenches on the links, their potential and their powers.

The elements are springs and dampers between points, bushings, compliant contacts, and applied forces and couples.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, assert_never, cast

import casadi as ca
import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.forces.bushings import apply_bushing
from mbd_sim.dynamics.kinematics.links import Link
from mbd_sim.dynamics.kinematics.poses import LinkMotion, SymbolicPose
from mbd_sim.dynamics.kinematics.state_variables import StateVariables
from mbd_sim.dynamics.kinematics.wrenches import AppliedWrenches, ExternalWrench, PowerSplit
from mbd_sim.dynamics.math.laws import elastic, power_law
from mbd_sim.dynamics.math.spatial import constant, is_absent
from mbd_sim.mechanism.elements.forces import AppliedForce, Damper, Spring, TwoPointElement
from mbd_sim.mechanism.elements.parts import Attachment
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.laws import Expressed, GreenStrain, Linear, Varying
from mbd_sim.mechanism.values.tables import Piecewise

if TYPE_CHECKING:
    from mbd_sim.dynamics.contact.compliant import AppliedCompliance


@dataclass(frozen=True, eq=False)
class ElementForces:
    """The wrenches F_L (6,) = [moment; force] on each link, the potential in J and the powers in W.

    `lengths` (springs and dampers,) are the distances between the ends in m, and `rates` their rates in m/s; those of
    springs without expressions that vary are left out as zeros. `compliances` are the compliant contacts.
    """

    wrenches: list[ca.SX]
    lengths: ca.SX
    rates: ca.SX
    potential: ca.SX
    applied_power: ca.SX
    dissipated_power: ca.SX
    compliances: Sequence[AppliedCompliance]


def element_forces(
    mechanism: Mechanism,
    links: Sequence[Link],
    motions: Sequence[LinkMotion],
    poses: Sequence[SymbolicPose],
    state: StateVariables,
    external: Mapping[str, ExternalWrench] = MappingProxyType({}),
) -> ElementForces:
    """All force elements of a mechanism, and the `external` wrenches on parts (Huston & Liu, sec. 11.5)."""
    applied = AppliedWrenches(links, motions, poses)
    potential = applied_power = dissipated = ca.SX(1, 1)
    power = PowerSplit()
    lengths, rates = list[ca.SX](), list[ca.SX]()
    for element in mechanism.two_point_elements:
        length, rate, energy, loss = _apply_between_points(applied, element, state, power)
        lengths.append(length)
        rates.append(rate)
        potential += energy
        dissipated += loss
        if isinstance(element, Spring) and not is_absent(element.mass):
            potential -= _apply_weight(applied, element, mechanism.gravity)
    for bushing in mechanism.bushings:
        energy, loss = apply_bushing(applied, bushing)
        potential += energy
        dissipated += loss
    compliances = _apply_compliances(applied, mechanism, poses)
    for compliance in compliances:
        potential += compliance.potential
        dissipated += compliance.loss
    for force in mechanism.applied:
        power.add(force.vector, _apply_force(applied, force, state))
    applied_power += power.applied
    dissipated += power.dissipated
    applied_power += sum((_apply_external(applied, part, wrench) for part, wrench in external.items()), ca.SX(1, 1))
    wrenches = [ca.sparsify(wrench) for wrench in applied.wrenches]
    return ElementForces(wrenches, _column(lengths), _column(rates), potential, applied_power, dissipated, compliances)


def _apply_compliances(
    applied: AppliedWrenches, mechanism: Mechanism, poses: Sequence[SymbolicPose]
) -> list[AppliedCompliance]:
    if not mechanism.contacts:
        return []
    from mbd_sim.dynamics.contact.compliant import apply_compliance
    from mbd_sim.dynamics.contact.planar.plane import still_axis
    from mbd_sim.mechanism.elements.contacts import ComplianceLaw

    return [
        apply_compliance(applied, contact, contact.law, still_axis(poses))
        for contact in mechanism.contacts
        if isinstance(contact.law, ComplianceLaw)
    ]


def _column(values: Sequence[ca.SX]) -> ca.SX:
    return ca.vertcat(ca.SX(0, 1), *values)


def _apply_between_points(
    applied: AppliedWrenches, element: TwoPointElement, state: StateVariables, power: PowerSplit
) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """Apply a spring or a damper; returns its length in m, its rate, its potential in J and its dissipated power in W.

    The power of a force without a potential is added to `power`.
    """
    first, second = applied.motion_of(element.first), applied.motion_of(element.second)
    line, rate = second.position - first.position, second.velocity - first.velocity
    speed = ca.SX(1, 1)
    match element:
        case Spring():
            force, energy, loss = spring_force(element, line, rate)
            if isinstance(element.law, Varying):
                tension, speed = varying_tension(element, element.law, line, rate, state)
                power.add([element.law.force], -tension * speed)
                force += line * (tension / ca.norm_2(line))
        case Damper():
            energy = ca.SX(1, 1)
            force, loss = damper_force(element, line, rate)[:2]
        case _:
            assert_never(element)
    applied.add_force(element.first, force)
    applied.add_force(element.second, -force)
    return ca.norm_2(line), speed, energy, loss


def _apply_weight(applied: AppliedWrenches, spring: Spring, gravity: Array | ca.SX) -> ca.SX:
    """Apply the weight of a spring with mass, and return m g·r of its center in J.

    Half of the weight acts at each end. The particle of m/3 in the link's inertia carries a third; a sixth is left.
    """
    acceleration = constant(gravity)
    for end in (spring.first, spring.second):
        applied.add_force(end, spring.mass / 6.0 * acceleration)
    ends = applied.motion_of(spring.first).position + applied.motion_of(spring.second).position
    return spring.mass * ca.dot(acceleration, 0.5 * ends)


def _apply_force(applied: AppliedWrenches, element: AppliedForce, state: StateVariables) -> ca.SX:
    """Apply a force or a couple of the file, and return its power in W."""
    if element.axes_of == element.at.part:
        return applied.add_in_own_axes(element.at, vector_in_axes(element, state), element.couple)
    point = applied.motion_of(element.at)
    vector = force_vector(element, applied.rotation(element.axes_of), state)
    if element.couple:
        applied.add_couple(element.at, vector)
        return ca.dot(vector, point.omega)
    applied.add_force(element.at, vector)
    return ca.dot(vector, point.velocity)


def _apply_external(applied: AppliedWrenches, part: str, wrench: ExternalWrench) -> ca.SX:
    """Apply an external wrench to a part, and return its power in W."""
    at = Attachment(part, cast(Array, wrench.point))
    point = applied.motion_of(at)
    applied.add_force(at, wrench.force)
    applied.add_couple(at, wrench.couple)
    power = ca.dot(wrench.force, point.velocity) + ca.dot(wrench.couple, point.omega)
    own_power = applied.add_in_own_axes(at, wrench.own_force, False)
    return power + own_power + applied.add_in_own_axes(at, wrench.own_couple, True)


def spring_force(spring: Spring, line: ca.SX, rate: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """The force (3,) in N on the first point toward the second, the potential in J, and the dissipated power in W.

    The force of a law that varies is that of `varying_tension`, and not included.

    :param line: (3,) from the first point to the second in m.
    :param rate: (3,) the time derivative of `line` in m/s.
    """
    square = ca.dot(line, line)
    length = ca.sqrt(square)
    match spring.law:
        case Linear(stiffness=k) if is_absent(spring.length):
            force, energy = k * line, 0.5 * k * square
        case GreenStrain(stiffness=k, length=natural):  # of the squares: smooth even where the ends meet
            strain = (square - natural**2) / (2.0 * natural**2)
            force, energy = k * strain * line, 0.5 * k * (strain * natural) ** 2
        case Varying():
            force, energy = ca.SX(3, 1), ca.SX(1, 1)
        case Linear() | Expressed() | Piecewise() as law:
            tension, energy = elastic(law, length - spring.length)
            force = line * (tension / length)
        case _:
            assert_never(spring.law)
    if is_absent(spring.damping):
        return force, energy, ca.SX(1, 1)
    speed = ca.dot(line, rate) / length
    return force + line * (spring.damping * speed / length), energy, spring.damping * speed**2


def varying_tension(
    spring: Spring, law: Varying, line: ca.SX, rate: ca.SX, state: StateVariables
) -> tuple[ca.SX, ca.SX]:
    """The tension in N, and the rate of the length in m/s; for the parameters see `spring_force`."""
    length = ca.norm_2(line)
    speed = ca.dot(line, rate) / length
    return state.stretched(law.force, length - spring.length, speed), speed


def damper_force(damper: Damper, line: ca.SX, rate: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """The force (3,) in N on the first point, the dissipated power and Rayleigh's dissipation function in W.

    For a pure power law the power is p + 1 times the dissipation function (Géradin & Rixen, p. 30).

    :param line: (3,) from the first point to the second in m.
    :param rate: (3,) the time derivative of `line` in m/s.
    """
    if not damper.needs_line:
        square = ca.dot(rate, rate)
        factor, dissipation = power_law(damper.law, square)
        return factor * rate, factor * square, dissipation
    length = ca.sqrt(ca.dot(line, line))
    speed = ca.dot(line, rate) / length
    factor, dissipation = power_law(damper.law, speed**2)
    return line * (factor * speed / length), factor * speed**2, dissipation


def force_vector(element: AppliedForce, rotation: ca.SX, state: StateVariables) -> ca.SX:
    """The force in N or couple in N·m (3,), in ground's axes.

    :param rotation: (3, 3) R_WB of the part `axes_of`.
    """
    vector = vector_in_axes(element, state)
    return rotation @ vector if element.following else vector


def vector_in_axes(element: AppliedForce, state: StateVariables) -> ca.SX:
    """The force in N or couple in N·m (3,) in the axes of the part `axes_of`, or of ground."""
    vector = ca.sparsify(state.vector(element.vector))
    return vector if np.array_equal(element.axes, np.eye(3)) else constant(element.axes) @ vector
