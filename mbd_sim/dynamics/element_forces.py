"""Springs and dampers between points and applied forces: wrenches on the links, their potential and their powers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import cast

import casadi as ca
import numpy as np

from mbd_sim.dynamics.applied_wrenches import Points
from mbd_sim.dynamics.input_layout import ExternalWrench
from mbd_sim.dynamics.kinematics import LinkMotion, WorldPose
from mbd_sim.dynamics.law_expressions import elastic, power_law
from mbd_sim.dynamics.links import Link
from mbd_sim.dynamics.spatial_algebra import constant, vanishes
from mbd_sim.dynamics.time_functions import time_functions
from mbd_sim.errors import InputError, MechanismError, Problem
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.expression import evaluate
from mbd_sim.mechanism.force_elements import AppliedForce, Damper, Spring
from mbd_sim.mechanism.laws import ELONGATION, Expressed, GreenStrain, Linear
from mbd_sim.mechanism.records import Attachment, Mechanism
from mbd_sim.mechanism.source import Location

COINCIDENT = 1e-12  # m


@dataclass(frozen=True, eq=False)
class ElementLoads:
    """`wrenches` (6,) = [moment; force] on each link, in its frame at its origin; energies and powers in J and W.

    `lengths` (ties,) are the distances in m between the ends.
    """

    wrenches: list[ca.SX]
    lengths: ca.SX
    potential: ca.SX
    applied_power: ca.SX
    dissipated_power: ca.SX


def element_loads(
    mechanism: Mechanism,
    links: Sequence[Link],
    motions: Sequence[LinkMotion],
    poses: Sequence[WorldPose],
    t: ca.SX,
    external: Mapping[str, ExternalWrench] = MappingProxyType({}),
) -> ElementLoads:
    """All force elements of a mechanism, and the `external` wrenches on parts (Huston & Liu, sec. 11.5)."""
    points = Points(links, motions, poses)
    potential = applied = dissipated = ca.SX(1, 1)
    lengths: list[ca.SX] = []
    for tie in mechanism.ties:
        first, second = points.at(tie.first), points.at(tie.second)
        line, rate = second.position - first.position, second.velocity - first.velocity
        lengths.append(ca.norm_2(line))
        if isinstance(tie, Damper):
            force, loss = damper_force(tie, line, rate)[:2]
        else:
            force, energy, loss = spring_force(tie, line, rate)
            potential += energy
        points.push(tie.first, force)
        points.push(tie.second, -force)
        dissipated += loss
        if isinstance(tie, Spring) and not vanishes(tie.mass):
            # Its inertia is a particle of a third of its mass, with that particle's weight: a sixth is left of a half.
            gravity = constant(mechanism.gravity)
            for end in (tie.first, tie.second):
                points.push(end, tie.mass / 6.0 * gravity)
            potential -= tie.mass * ca.dot(gravity, 0.5 * (first.position + second.position))
    for element in mechanism.applied:
        if element.axes_of == element.at.part:
            applied += points.follow(element.at, vector_in_axes(element, t), element.couple)
            continue
        place = points.at(element.at)
        vector = force_vector(element, points.rotation(element.axes_of), t)
        if element.couple:
            points.turn(element.at, vector)
            applied += ca.dot(vector, place.omega)
        else:
            points.push(element.at, vector)
            applied += ca.dot(vector, place.velocity)
    applied += sum((_external(points, part, wrench) for part, wrench in external.items()), ca.SX(1, 1))
    wrenches = [ca.sparsify(wrench) for wrench in points.wrenches]
    return ElementLoads(wrenches, ca.vertcat(ca.SX(0, 1), *lengths), potential, applied, dissipated)


def _external(points: Points, part: str, wrench: ExternalWrench) -> ca.SX:
    """Let an external wrench act on a part; returns its power."""
    at = Attachment(part, cast(Array, wrench.point))
    place = points.at(at)
    points.push(at, wrench.force)
    points.turn(at, wrench.couple)
    power = ca.dot(wrench.force, place.velocity) + ca.dot(wrench.couple, place.omega)
    return power + points.follow(at, wrench.own_force, False) + points.follow(at, wrench.own_couple, True)


def require_lines(mechanism: Mechanism, lengths: Array) -> None:
    """Refuse springs and dampers that have no force at the start: no line to act along, or no value.

    :param lengths: (ties,) m.
    :raises MechanismError: the elements are named.
    """
    problems = list(_without_value(mechanism, lengths))
    for tie, length in zip(mechanism.ties, lengths, strict=True):
        if not tie.needs_line or length > COINCIDENT:
            continue
        what, remedy = "spring", "a spring without length and damping needs no direction."
        if isinstance(tie, Damper):
            what, remedy = "damper", "a damper with 'along: velocity' needs no direction."
        message = f"the ends coincide at the start, where the {what} has no direction"
        location = ("forces", tie.name, "between")
        problems.append(mechanism.source.problem(location, message, f"Move one of the points; {remedy}"))
    if problems:
        raise MechanismError(problems)


def _without_value(mechanism: Mechanism, lengths: Array) -> Iterator[Problem]:
    """Springs whose expression has no finite value at the start."""
    laws: list[tuple[Location, object, float]] = [
        (("joints", name, "spring", "force"), joint.spring, float(joint.position[0] - joint.rest[0]))
        for name, joint in mechanism.joints.items()
        if joint.spring is not None and not (mechanism.closing or mechanism.constraints)  # which may move it elsewhere
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
    """The force (3,) on the first point toward the second, the potential in J, and the dissipated power in W.

    :param line: (3,) from the first point to the second; `rate` is its derivative by time.
    """
    square = ca.dot(line, line)
    length = ca.sqrt(square)
    none = ca.SX(1, 1)
    match spring.law:
        case Linear(stiffness=k) if vanishes(spring.length):
            force, energy = k * line, 0.5 * k * square
        case GreenStrain(stiffness=k, length=natural):  # of the squares: smooth even where the ends meet
            strain = (square - natural**2) / (2.0 * natural**2)
            force, energy = k * strain * line, 0.5 * k * (strain * natural) ** 2
        case law:
            tension, energy = elastic(law, length - spring.length)
            force = line * (tension / length)
    if vanishes(spring.damping):
        return force, energy, none
    speed = ca.dot(line, rate) / length
    return force + line * (spring.damping * speed / length), energy, spring.damping * speed**2


def damper_force(damper: Damper, line: ca.SX, rate: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """The force (3,) on the first point, the dissipated power and Rayleigh's dissipation function in W.

    Of the power law alone the power is p + 1 times the dissipation function (Géradin & Rixen, p. 30).

    :param line: (3,) from the first point to the second; `rate` is its derivative by time.
    """
    if not damper.needs_line:
        square = ca.dot(rate, rate)
        factor, loss = power_law(damper.law, square)
        return factor * rate, factor * square, loss
    length = ca.sqrt(ca.dot(line, line))
    speed = ca.dot(line, rate) / length
    factor, loss = power_law(damper.law, speed**2)
    return line * (factor * speed / length), factor * speed**2, loss


def force_vector(element: AppliedForce, rotation: ca.SX, t: ca.SX) -> ca.SX:
    """The force or moment (3,) in ground's axes at time t; `rotation` (3, 3) is that of the part `axes_of`."""
    vector = vector_in_axes(element, t)
    return rotation @ vector if element.following else vector


def vector_in_axes(element: AppliedForce, t: ca.SX) -> ca.SX:
    """The force or moment (3,) at time t in the axes of the part `axes_of`, or of ground."""
    vector = ca.sparsify(time_functions(element.vector, t)[0])
    return vector if np.array_equal(element.axes, np.eye(3)) else constant(element.axes) @ vector
