"""Kinetic energy, the potential of gravity, and the energies that are integrated for the audit."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from mbd_sim.dynamics.kinematics import LinkMotion, SymbolicPose
from mbd_sim.dynamics.links import Link
from mbd_sim.dynamics.spatial_algebra import constant
from mbd_sim.mechanism.records import Mechanism


def kinetic_energy(links: Sequence[Link], motions: Sequence[LinkMotion]) -> ca.SX:
    """T in J, in ground's frame."""
    energy = ca.SX(1, 1)
    for link, motion in zip(links, motions, strict=True):
        energy += 0.5 * ca.dot(motion.V_WL, constant(link.inertia) @ motion.V_WL)
    return energy


def gravitational_potential(mechanism: Mechanism, links: Sequence[Link], poses: Sequence[SymbolicPose]) -> ca.SX:
    """-Σ m g·r over the centers of mass in J, which is zero with all of them at ground's origin."""
    potential = ca.SX(1, 1)
    for link, X_WB in zip(links, poses, strict=True):
        part = mechanism.parts[link.joint.outboard]
        center = X_WB.position + X_WB.rotation @ constant(part.center)
        potential -= part.mass * ca.dot(constant(mechanism.gravity), center)
    return potential
