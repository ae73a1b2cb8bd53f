"""Generalized forces of joints: efforts, springs, dampers and stops, with their potential and their powers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from mbd_sim.dynamics.links import Link


@dataclass(frozen=True, eq=False)
class Loads:
    """What acts along the coordinates.

    `generalized` (nv,) forces in N or N·m; `potential` in J; `applied_power` of the efforts and
    `dissipated_power` of the dampers in W, the latter twice Rayleigh's dissipation function.
    """

    generalized: ca.SX
    potential: ca.SX
    applied_power: ca.SX
    dissipated_power: ca.SX


def joint_loads(links: Sequence[Link], q: ca.SX, u: ca.SX, efforts: ca.SX) -> Loads:
    """All joint forces: effort - k (q - rest) - d u - stops (Géradin & Rixen, virtual power and dissipation)."""
    generalized = ca.SX(efforts)
    potential = dissipated = ca.SX(1, 1)
    for link in links:
        joint = link.joint
        for place, row in enumerate(range(link.u.start, link.u.stop)):
            speed, force = u[row], ca.SX(1, 1)
            if joint.damping[place]:
                force -= joint.damping[place] * speed
                dissipated += joint.damping[place] * speed**2
            if joint.stiffness[place]:
                stretch = q[link.q.start + place] - joint.rest[place]
                force -= joint.stiffness[place] * stretch
                potential += 0.5 * joint.stiffness[place] * stretch**2
            if joint.limits is not None and joint.limits.stiffness:
                over = ca.fmax(q[link.q] - joint.limits.upper, 0.0)
                under = ca.fmax(joint.limits.lower - q[link.q], 0.0)
                force += joint.limits.stiffness * (under - over)
                potential += 0.5 * joint.limits.stiffness * (over**2 + under**2)
            generalized[row] += force
    return Loads(generalized, potential, ca.dot(efforts, u), dissipated)
