"""Kinetic energy, the potential of gravity, and the energies that are integrated for the audit."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from mbd_sim.dynamics.inlining import inlined
from mbd_sim.dynamics.kinematics import LinkMotion, SymbolicPose
from mbd_sim.dynamics.links import Link
from mbd_sim.dynamics.spatial_algebra import constant
from mbd_sim.mechanism.records import Mechanism


def kinetic_energy(links: Sequence[Link], motions: Sequence[LinkMotion]) -> ca.SX:
    """T in J, in ground's frame."""
    energy = ca.SX(1, 1)
    for link, motion in zip(links, motions, strict=True):
        energy += _kinetic_energy(constant(link.inertia), motion.V_WL)
    return energy


@inlined
def _kinetic_energy(inertia: ca.SX, velocity: ca.SX) -> ca.SX:
    return 0.5 * ca.dot(velocity, inertia @ velocity)


def gravitational_potential(mechanism: Mechanism, links: Sequence[Link], poses: Sequence[SymbolicPose]) -> ca.SX:
    """-Σ m g·r over the centers of mass in J, which is zero with all of them at ground's origin."""
    potential, gravity, bodies = ca.SX(1, 1), constant(mechanism.gravity), mechanism.bodies
    for link, X_WB in zip(links, poses, strict=True):
        part = bodies[link.joint.outboard]
        potential -= _work(ca.SX(part.mass), gravity, X_WB.position, X_WB.rotation, constant(part.center))
    return potential


@inlined
def _work(mass: ca.SX, gravity: ca.SX, position: ca.SX, rotation: ca.SX, center: ca.SX) -> ca.SX:
    """The work of gravity on a part in J, from ground's origin to the part's center of mass."""
    return mass * ca.dot(gravity, position + rotation @ center)
