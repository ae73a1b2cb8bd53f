"""Springs between points and applied forces: wrenches on the links, with their potential and their powers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from mbd_sim.dynamics.kinematics import LinkMotion, WorldPose
from mbd_sim.dynamics.links import Link
from mbd_sim.dynamics.spatial import constant, skew
from mbd_sim.dynamics.time import time_functions
from mbd_sim.errors import MechanismError
from mbd_sim.mechanism.model import GROUND, AppliedForce, Array, Attachment, Mechanism, Spring

COINCIDENT = 1e-12  # m


@dataclass(frozen=True, eq=False)
class ElementLoads:
    """`wrenches` (6,) = [moment; force] on each link, in its frame at its origin; energies and powers in J and W.

    `lengths` (springs,) are the distances in m between the springs' ends.
    """

    wrenches: list[ca.SX]
    lengths: ca.SX
    potential: ca.SX
    applied_power: ca.SX
    dissipated_power: ca.SX


def element_loads(
    mechanism: Mechanism, links: Sequence[Link], motions: Sequence[LinkMotion], poses: Sequence[WorldPose], t: ca.SX
) -> ElementLoads:
    """All force elements of a mechanism (Huston & Liu, sec. 11.5)."""
    body = _Bodies(links, motions, poses)
    potential = applied = dissipated = ca.SX(1, 1)
    lengths: list[ca.SX] = []
    for spring in mechanism.springs:
        first, second = body.point(spring.first), body.point(spring.second)
        line = second.position - first.position
        lengths.append(ca.norm_2(line))
        force, energy, loss = spring_force(spring, line, second.velocity - first.velocity)
        body.push(spring.first, force)
        body.push(spring.second, -force)
        potential, dissipated = potential + energy, dissipated + loss
    for element in mechanism.applied:
        place = body.point(element.at)
        vector = force_vector(element, place.rotation, t)
        if element.couple:
            body.turn(element.at, vector)
            applied += ca.dot(vector, place.omega)
        else:
            body.push(element.at, vector)
            applied += ca.dot(vector, place.velocity)
    wrenches = [ca.sparsify(wrench) for wrench in body.wrenches]
    return ElementLoads(wrenches, ca.vertcat(ca.SX(0, 1), *lengths), potential, applied, dissipated)


def require_lines(mechanism: Mechanism, lengths: Array) -> None:
    """Refuse springs whose ends coincide at the start although their force needs a line to act along.

    :param lengths: (springs,) m.
    :raises MechanismError: the springs are named.
    """
    problems = [
        mechanism.source.problem(
            ("forces", spring.name, "between"),
            "the ends coincide at the start, where the spring has no direction",
            "Move one of the points; a spring without length and damping needs no direction.",
        )
        for spring, length in zip(mechanism.springs, lengths, strict=True)
        if (spring.length or spring.damping) and not length > COINCIDENT
    ]
    if problems:
        raise MechanismError(problems)


def spring_force(spring: Spring, line: ca.SX, rate: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """The force (3,) on the first point toward the second, the potential in J, and the dissipated power in W.

    :param line: (3,) from the first point to the second; `rate` is its derivative by time.
    """
    if spring.length == 0.0 and spring.damping == 0.0:
        return spring.stiffness * line, 0.5 * spring.stiffness * ca.dot(line, line), ca.SX(1, 1)
    length = ca.sqrt(ca.dot(line, line))
    stretch, speed = length - spring.length, ca.dot(line, rate) / length
    tension = spring.stiffness * stretch + spring.damping * speed
    return line * (tension / length), 0.5 * spring.stiffness * stretch**2, spring.damping * speed**2


def force_vector(element: AppliedForce, rotation: ca.SX, t: ca.SX) -> ca.SX:
    """The force or moment (3,) in ground's axes at time t; `rotation` (3, 3) is that of the part."""
    vector, _, _ = time_functions(element.vector, t)
    vector = ca.sparsify(vector)
    return rotation @ vector if element.following else vector


@dataclass(frozen=True, eq=False)
class _Place:
    """A point in ground's axes: its position, velocity, and its part's rotation and angular velocity."""

    position: ca.SX
    velocity: ca.SX
    rotation: ca.SX
    omega: ca.SX


class _Bodies:
    """Points of parts, and the wrenches that gather on their links."""

    def __init__(self, links: Sequence[Link], motions: Sequence[LinkMotion], poses: Sequence[WorldPose]) -> None:
        self._links, self._motions, self._poses = links, motions, poses
        self._index = {link.joint.outboard: index for index, link in enumerate(links)}
        self.wrenches = [ca.SX(6, 1) for _ in links]

    def point(self, at: Attachment) -> _Place:
        if at.part == GROUND:
            return _Place(constant(at.point), ca.SX(3, 1), constant(np.eye(3)), ca.SX(3, 1))
        index = self._index[at.part]
        pose, velocity = self._poses[index], self._motions[index].velocity
        to_world = self._to_world(index)
        arm = self._arm(index, at)
        return _Place(
            position=pose.position + pose.rotation @ constant(at.point),
            velocity=to_world @ (velocity[3:] - skew(arm) @ velocity[:3]),
            rotation=pose.rotation,
            omega=to_world @ velocity[:3],
        )

    def push(self, at: Attachment, force: ca.SX) -> None:
        """Let a force (3,) in ground's axes act at a point."""
        if at.part != GROUND:
            index = self._index[at.part]
            own = self._to_world(index).T @ force
            self.wrenches[index] += ca.vertcat(skew(self._arm(index, at)) @ own, own)

    def turn(self, at: Attachment, moment: ca.SX) -> None:
        """Let a couple (3,) in ground's axes act on a part."""
        index = self._index[at.part]
        self.wrenches[index] += ca.vertcat(self._to_world(index).T @ moment, ca.SX(3, 1))

    def _to_world(self, index: int) -> ca.SX:
        return ca.sparsify(self._poses[index].rotation @ constant(self._links[index].part.rotation.T))

    def _arm(self, index: int, at: Attachment) -> ca.SX:
        part = self._links[index].part
        return constant(part.position + part.rotation @ at.point)
