"""Bushings: elastic and damping connections of two frames in all six directions."""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from mbd_sim.dynamics.applied_wrenches import AppliedWrenches
from mbd_sim.dynamics.spatial_algebra import constant, skew
from mbd_sim.mechanism.force_elements import Bushing
from mbd_sim.mechanism.records import GROUND

NEARLY_ZERO = 1e-4  # of the squared sine of an angle, below which a series replaces a quotient of two small numbers


class BushingForce(NamedTuple):
    """The `force` (3,) in N and the `couple` (3,) in N·m on the second frame, by default along the axes of the first.

    `potential` in J, and `dissipated_power` in W.
    """

    force: ca.SX
    couple: ca.SX
    potential: ca.SX
    dissipated_power: ca.SX


def rotation_vector(rotation: ca.SX) -> ca.SX:
    """The vector (3,) along the axis of a rotation matrix (3, 3), as long as its angle in rad, which is below π."""
    r = rotation
    sines = 0.5 * ca.vertcat(r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1])
    square, cosine = ca.dot(sines, sines), 0.5 * (r[0, 0] + r[1, 1] + r[2, 2] - 1.0)
    small = (square < NEARLY_ZERO) * (cosine > 0.0)
    series = 1.0 + square * (1.0 / 6.0 + square * (3.0 / 40.0 + square * (5.0 / 112.0)))
    sine = ca.sqrt(ca.fmax(ca.if_else(small, 1.0, square), 1e-300))
    return sines * ca.if_else(small, series, ca.atan2(sine, cosine) / sine)


def bushing_potential(bushing: Bushing, displacement: ca.SX, rotation: ca.SX) -> ca.SX:
    """The potential in J.

    :param displacement: (3,) of the second frame's origin in m, along the axes of the first.
    :param rotation: (3, 3) of the second frame relative to the first.
    """
    z = ca.vertcat(displacement, rotation_vector(rotation))
    return 0.5 * ca.dot(z, constant(bushing.stiffness) @ z)


def bushing_force(
    bushing: Bushing, displacement: ca.SX, rotation: ca.SX, velocity: ca.SX, omega: ca.SX
) -> BushingForce:
    """The force of a bushing.

    :param displacement: and `rotation` as for `bushing_potential`.
    :param velocity: (3,) the rate of the displacement in m/s.
    :param omega: (3,) the angular velocity of the second frame relative to the first in rad/s, along the first's axes.
    """
    d, r = ca.SX.sym("d", 3), ca.SX.sym("r", 3, 3)
    potential = bushing_potential(bushing, d, r)
    slopes = ca.reshape(ca.gradient(potential, ca.vec(r)), 3, 3)
    moments = [ca.dot(slopes, skew(constant(direction)) @ r) for direction in np.eye(3)]
    found = [potential, ca.gradient(potential, d), ca.vertcat(*moments)]
    potential, force, couple = ca.substitute(found, [d, r], [ca.densify(displacement), ca.densify(rotation)])
    rates = ca.vertcat(velocity, omega)
    resistance = constant(bushing.damping) @ rates
    return BushingForce(-force - resistance[:3], -couple - resistance[3:], potential, ca.dot(rates, resistance))


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
    return found._replace(force=axes @ found.force, couple=axes @ found.couple), line


def apply_bushing(applied: AppliedWrenches, bushing: Bushing) -> tuple[ca.SX, ca.SX]:
    """Apply a bushing; returns its potential in J and its dissipated power in W."""
    (force, couple, potential, dissipated_power), line = bushing_in_ground(applied, bushing)
    applied.add_force(bushing.second, force)
    applied.add_force(bushing.first, -force)
    if bushing.second.part != GROUND:
        applied.add_couple(bushing.second, couple)
    if bushing.first.part != GROUND:
        applied.add_couple(bushing.first, -couple - ca.cross(line, force))
    return potential, dissipated_power
