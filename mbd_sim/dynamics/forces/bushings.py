"""Bushings: elastic and damping connections of two frames in all six directions."""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca

from mbd_sim.dynamics.kinematics.wrenches import AppliedWrenches
from mbd_sim.dynamics.math.spatial import constant
from mbd_sim.mechanism.elements.forces import Bushing
from mbd_sim.mechanism.elements.parts import GROUND

NEARLY_ZERO = 2.5e-5  # of tan² ½ θ, below which a series replaces a quotient of two small numbers


@dataclass(frozen=True, eq=False, slots=True)
class BushingForce:
    """The `force` (3,) in N and the `couple` (3,) in N·m on the second frame, by default along the axes of the first.

    `potential` in J, and `dissipated_power` in W.
    """

    force: ca.SX
    couple: ca.SX
    potential: ca.SX
    dissipated_power: ca.SX


@dataclass(frozen=True, eq=False, slots=True)
class Turn:
    """The `vector` φ (3,) along the axis of a rotation, as long as its angle θ in rad, which is at most π.

    With the angular velocity ω in fixed axes, its rate is ω - ½ φ x ω + `bend` φ x (φ x ω), where `bend` is
    (1 - ½ θ cot ½ θ) / θ².
    """

    vector: ca.SX
    bend: ca.SX


def turn_of(rotation: ca.SX) -> Turn:
    """The turn of a rotation matrix (3, 3)."""
    w, *vector = ca.vertsplit(quaternion_row(rotation))
    v, sign = ca.vertcat(*vector), ca.if_else(w < 0.0, -1.0, 1.0)
    square = ca.dot(v, v)
    small = square < NEARLY_ZERO * w * w
    ratio = ca.if_else(small, square, 0.0) / ca.if_else(small, w * w, 1.0)
    series = 1.0 / 3.0 - ratio * (1.0 / 5.0 - ratio / 7.0)
    sine = ca.sqrt(ca.if_else(small, 1.0, square))
    cotangent = 1.0 - ratio * series  # ½ θ cot ½ θ of a small angle
    half = ca.if_else(small, cotangent / ca.if_else(small, w, 1.0), sign * ca.atan2(sine, sign * w) / sine)
    bend = ca.if_else(small, series / cotangent**2, (1.0 - w * half) / ca.if_else(small, 1.0, square * half**2))
    return Turn(2.0 * half * v, 0.25 * bend)


def quaternion_row(rotation: ca.SX) -> ca.SX:
    """A multiple (4,) of the quaternion q = (w, x, y, z) of a rotation matrix (3, 3).

    It is the first row of 4 q qᵀ with 4 q_i² > 1: near half a turn the axis cannot be computed from R - Rᵀ alone.
    """
    r, trace = rotation, ca.trace(rotation)
    row = ca.SX.zeros(4)
    for i, j, k in ((2, 0, 1), (1, 2, 0), (0, 1, 2)):
        own = ca.SX.zeros(4)
        own[0], own[1 + i] = r[k, j] - r[j, k], 1.0 - trace + 2.0 * r[i, i]
        own[1 + j], own[1 + k] = r[i, j] + r[j, i], r[i, k] + r[k, i]
        row = own if i == 2 else ca.if_else(own[1 + i] > 1.0, own, row)
    own = ca.vertcat(1.0 + trace, r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1])
    return ca.if_else(own[0] > 1.0, own, row)


def bushing_potential(bushing: Bushing, displacement: ca.SX, rotation: ca.SX) -> ca.SX:
    """The potential in J.

    :param displacement: (3,) of the second frame's origin in m, along the axes of the first.
    :param rotation: (3, 3) of the second frame relative to the first.
    """
    z = ca.vertcat(displacement, turn_of(rotation).vector)
    return 0.5 * ca.dot(z, constant(bushing.stiffness) @ z)


def bushing_force(
    bushing: Bushing, displacement: ca.SX, rotation: ca.SX, velocity: ca.SX, omega: ca.SX
) -> BushingForce:
    """The force of a bushing.

    :param displacement: and `rotation` as for `bushing_potential`.
    :param velocity: (3,) the rate of the displacement in m/s.
    :param omega: (3,) the angular velocity of the second frame relative to the first in rad/s, along the first's axes.
    """
    turn = turn_of(rotation)
    z = ca.vertcat(displacement, turn.vector)
    elastic = constant(bushing.stiffness) @ z
    force, couple = elastic[:3], elastic[3:]
    swept = ca.cross(turn.vector, couple)
    couple += 0.5 * swept + turn.bend * ca.cross(turn.vector, swept)
    rates = ca.vertcat(velocity, omega)
    resistance = constant(bushing.damping) @ rates
    return BushingForce(
        -force - resistance[:3], -couple - resistance[3:], 0.5 * ca.dot(z, elastic), ca.dot(rates, resistance)
    )


def bushing_in_ground(applied: AppliedWrenches, bushing: Bushing) -> tuple[BushingForce, ca.SX]:
    """Force and couple on the second frame about its origin, in ground's axes, and the line (3,) to it from the first.

    :param applied: gives the motion of the frames; nothing is applied.
    """
    first, second = applied.motion_of(bushing.first), applied.motion_of(bushing.second)
    axes = applied.rotation(bushing.first.part) @ constant(bushing.first_axes)
    rotation = axes.T @ applied.rotation(bushing.second.part) @ constant(bushing.second_axes)
    line = second.position - first.position
    velocity = second.velocity - first.velocity - ca.cross(first.omega, line)
    found = bushing_force(bushing, axes.T @ line, rotation, axes.T @ velocity, axes.T @ (second.omega - first.omega))
    return replace(found, force=axes @ found.force, couple=axes @ found.couple), line


def apply_bushing(applied: AppliedWrenches, bushing: Bushing) -> tuple[ca.SX, ca.SX]:
    """Apply a bushing; returns its potential in J and its dissipated power in W."""
    found, line = bushing_in_ground(applied, bushing)
    applied.add_force(bushing.second, found.force)
    applied.add_force(bushing.first, -found.force)
    if bushing.second.part != GROUND:
        applied.add_couple(bushing.second, found.couple)
    if bushing.first.part != GROUND:
        applied.add_couple(bushing.first, -found.couple - ca.cross(line, found.force))
    return found.potential, found.dissipated_power
