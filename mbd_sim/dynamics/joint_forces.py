"""Generalized forces of joints: efforts, springs, dampers, friction and stops, their potential and their powers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from mbd_sim.dynamics.law_expressions import elastic, friction, power_law
from mbd_sim.dynamics.links import Link
from mbd_sim.dynamics.spatial_algebra import vanishes
from mbd_sim.mechanism.laws import Linear
from mbd_sim.mechanism.records import Joint, Limits


@dataclass(frozen=True, eq=False)
class Loads:
    """What acts along the coordinates.

    `generalized` (nv,) forces in N or N·m; `potential` in J; `applied_power` of the efforts, and `dissipated_power`
    of dampers, friction and stops, in W.
    """

    generalized: ca.SX
    potential: ca.SX
    applied_power: ca.SX
    dissipated_power: ca.SX


def joint_loads(links: Sequence[Link], q: ca.SX, u: ca.SX, efforts: ca.SX) -> Loads:
    """All joint forces: effort - spring - dampers - friction - stops (Géradin & Rixen, virtual power)."""
    generalized = ca.SX(efforts)
    potential = dissipated = ca.SX(1, 1)
    for link in links:
        for place, row in enumerate(range(link.u.start, link.u.stop)):
            # Of joints that turn freely, coordinates and speeds do not correspond; they have no springs.
            coordinate = q[link.q.start + place]
            resistance, energy = _spring(link.joint, place, coordinate)
            loss = _resistance(link.joint, place, u[row])
            if link.joint.limits is not None and not vanishes(_hardness(link.joint.limits)):
                push, stored, lost = stop(link.joint.limits, coordinate, u[row])
                resistance, energy, loss = resistance + push, energy + stored, loss + lost
            generalized[row] -= resistance + loss
            potential += energy
            dissipated += loss * u[row]
    return Loads(generalized, potential, ca.dot(efforts, u), dissipated)


def _spring(joint: Joint, place: int, coordinate: ca.SX) -> tuple[ca.SX, ca.SX]:
    """The force of a joint's spring against its coordinate, and the potential."""
    if joint.spring is None and vanishes(joint.stiffness[place]):
        return ca.SX(1, 1), ca.SX(1, 1)
    return elastic(joint.spring or Linear(joint.stiffness[place]), coordinate - joint.rest[place])


def _resistance(joint: Joint, place: int, speed: ca.SX) -> ca.SX:
    """The force against a speed: of the dampers and of dry friction."""
    force = ca.SX(1, 1) if vanishes(joint.damping[place]) else joint.damping[place] * speed
    if joint.damper is not None:
        force += power_law(joint.damper, speed**2)[0] * speed
    if joint.friction is not None:
        force += friction(joint.friction, speed)
    return force


def stop(limits: Limits, coordinate: ca.SX, speed: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """The elastic force against the coordinate, its potential, and the force against the speed (Hunt & Crossley 1975).

    A stop pushes back with k δ (1 + c δ'), but never pulls. With k δ + d δ' instead the force would jump at the touch,
    where the speed is largest, and no method keeps its order over a jump.
    """
    k, c = _hardness(limits), limits.damping
    over = ca.fmax(coordinate - limits.upper, 0.0)
    under = ca.fmax(limits.lower - coordinate, 0.0)
    push, energy = k * (over - under), 0.5 * k * (over**2 + under**2)
    if vanishes(c):
        return push, energy, ca.SX(1, 1)
    # Leaving faster than 1 / c the stop has let go: what is against the speed takes back all the elastic force.
    return push, energy, k * (over * ca.fmax(c * speed, -1.0) + under * ca.fmin(c * speed, 1.0))


def _hardness(limits: Limits) -> float:
    return 0.0 if limits.stiffness is None else limits.stiffness
