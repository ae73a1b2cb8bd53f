"""Springs, dampers and forces between points: their wrenches on the links, their potential and their powers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import assert_never, cast

import casadi as ca
import numpy as np

from mbd_sim.dynamics.applied_wrenches import AppliedWrenches
from mbd_sim.dynamics.compliant_contacts import apply_cushion
from mbd_sim.dynamics.input_layout import ExternalWrench
from mbd_sim.dynamics.kinematics import LinkMotion, SymbolicPose
from mbd_sim.dynamics.law_expressions import elastic, power_law
from mbd_sim.dynamics.links import Link
from mbd_sim.dynamics.spatial_algebra import constant, is_absent
from mbd_sim.dynamics.time_functions import time_functions
from mbd_sim.errors import InputError, MechanismError, Problem
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.contacts import Cushion
from mbd_sim.mechanism.expression import evaluate
from mbd_sim.mechanism.force_elements import AppliedForce, Damper, Spring, TwoPointElement
from mbd_sim.mechanism.laws import ELONGATION, Expressed, GreenStrain, Linear, Piecewise
from mbd_sim.mechanism.records import Attachment, Mechanism
from mbd_sim.mechanism.source import Location

COINCIDENT = 1e-12  # m


@dataclass(frozen=True, eq=False)
class ElementForces:
    """The wrenches F_L (6,) = [moment; force] on each link, the potential in J and the powers in W.

    `lengths` (springs and dampers,) are the distances between the ends in m.
    """

    wrenches: list[ca.SX]
    lengths: ca.SX
    potential: ca.SX
    applied_power: ca.SX
    dissipated_power: ca.SX


def element_forces(
    mechanism: Mechanism,
    links: Sequence[Link],
    motions: Sequence[LinkMotion],
    poses: Sequence[SymbolicPose],
    t: ca.SX,
    external: Mapping[str, ExternalWrench] = MappingProxyType({}),
) -> ElementForces:
    """All force elements of a mechanism, and the `external` wrenches on parts (Huston & Liu, sec. 11.5)."""
    applied = AppliedWrenches(links, motions, poses)
    potential = applied_power = dissipated = ca.SX(1, 1)
    lengths: list[ca.SX] = []
    for element in mechanism.two_point_elements:
        length, energy, loss = _apply_between_points(applied, element)
        lengths.append(length)
        potential += energy
        dissipated += loss
        if isinstance(element, Spring) and not is_absent(element.mass):
            potential -= _apply_weight(applied, element, mechanism.gravity)
    for contact in mechanism.contacts:
        if isinstance(contact.law, Cushion):
            energy, loss = apply_cushion(applied, contact, contact.law)
            potential += energy
            dissipated += loss
    for force in mechanism.applied:
        applied_power += _apply_force(applied, force, t)
    applied_power += sum((_apply_external(applied, part, wrench) for part, wrench in external.items()), ca.SX(1, 1))
    wrenches = [ca.sparsify(wrench) for wrench in applied.wrenches]
    return ElementForces(wrenches, ca.vertcat(ca.SX(0, 1), *lengths), potential, applied_power, dissipated)


def _apply_between_points(applied: AppliedWrenches, element: TwoPointElement) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Apply a spring or a damper; returns its length in m, its potential in J and its dissipated power in W."""
    first, second = applied.motion_of(element.first), applied.motion_of(element.second)
    line, rate = second.position - first.position, second.velocity - first.velocity
    match element:
        case Spring():
            force, energy, loss = spring_force(element, line, rate)
        case Damper():
            energy = ca.SX(1, 1)
            force, loss = damper_force(element, line, rate)[:2]
        case _:
            assert_never(element)
    applied.add_force(element.first, force)
    applied.add_force(element.second, -force)
    return ca.norm_2(line), energy, loss


def _apply_weight(applied: AppliedWrenches, spring: Spring, gravity: Array | ca.SX) -> ca.SX:
    """Apply the weight of a spring with mass, and return m g·r of its center in J.

    Half of the weight acts at each end. The particle of m/3 in the link's inertia carries a third; a sixth is left.
    """
    acceleration = constant(gravity)
    for end in (spring.first, spring.second):
        applied.add_force(end, spring.mass / 6.0 * acceleration)
    ends = applied.motion_of(spring.first).position + applied.motion_of(spring.second).position
    return spring.mass * ca.dot(acceleration, 0.5 * ends)


def _apply_force(applied: AppliedWrenches, element: AppliedForce, t: ca.SX) -> ca.SX:
    """Apply a force or a couple of the file, and return its power in W."""
    if element.axes_of == element.at.part:
        return applied.add_in_own_axes(element.at, vector_in_axes(element, t), element.couple)
    point = applied.motion_of(element.at)
    vector = force_vector(element, applied.rotation(element.axes_of), t)
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


def require_defined_forces(mechanism: Mechanism, lengths: Array) -> None:
    """Refuse springs and dampers whose force is undefined at the start: no direction, or no finite value.

    :param lengths: (springs and dampers,) m.
    :raises MechanismError: the elements are named.
    """
    problems = list(_undefined_laws(mechanism, lengths))
    for element, length in zip(mechanism.two_point_elements, lengths, strict=True):
        if not element.needs_line or length > COINCIDENT:
            continue
        kind, remedy = "spring", "a spring without length or damping needs no direction."
        if isinstance(element, Damper):
            kind, remedy = "damper", "a damper with 'along: velocity' needs no direction."
        message = f"the ends coincide at the start, where the {kind} has no direction"
        location = ("forces", element.name, "between")
        problems.append(mechanism.source.problem(location, message, f"Move one of the points; {remedy}"))
    if problems:
        raise MechanismError(problems)


def _undefined_laws(mechanism: Mechanism, lengths: Array) -> Iterator[Problem]:
    """Springs whose expression has no finite value at the start.

    With loops or constraints the start may differ from the joint positions of the file, so joints are left out then.
    """
    laws: list[tuple[Location, object, float]] = [
        (("joints", name, "spring", "force"), joint.spring, float(joint.position[0] - joint.rest[0]))
        for name, joint in mechanism.joints.items()
        if joint.spring is not None and not (mechanism.closing or mechanism.constraints)
    ]
    for spring, length in zip(mechanism.springs, lengths, strict=False):
        laws.append((("forces", spring.name, "force"), spring.law, float(length) - spring.length))
    for location, law, elongation in laws:
        if isinstance(law, Expressed):
            try:
                evaluate(law.force.text, {**law.force.names, ELONGATION: elongation})
            except InputError:
                message = f"has no finite value at the start, where {ELONGATION} = {elongation:g}"
                yield mechanism.source.problem(location, message, "Write a force for every elongation that occurs.")


def spring_force(spring: Spring, line: ca.SX, rate: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """The force (3,) in N on the first point toward the second, the potential in J, and the dissipated power in W.

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
        case Linear() | Expressed() | Piecewise() as law:
            tension, energy = elastic(law, length - spring.length)
            force = line * (tension / length)
        case _:
            assert_never(spring.law)
    if is_absent(spring.damping):
        return force, energy, ca.SX(1, 1)
    speed = ca.dot(line, rate) / length
    return force + line * (spring.damping * speed / length), energy, spring.damping * speed**2


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


def force_vector(element: AppliedForce, rotation: ca.SX, t: ca.SX) -> ca.SX:
    """The force in N or couple in N·m (3,) at time t, in ground's axes.

    :param rotation: (3, 3) R_WB of the part `axes_of`.
    """
    vector = vector_in_axes(element, t)
    return rotation @ vector if element.following else vector


def vector_in_axes(element: AppliedForce, t: ca.SX) -> ca.SX:
    """The force in N or couple in N·m (3,) at time t, in the axes of the part `axes_of`, or of ground."""
    vector = ca.sparsify(time_functions(element.vector, t)[0])
    return vector if np.array_equal(element.axes, np.eye(3)) else constant(element.axes) @ vector
