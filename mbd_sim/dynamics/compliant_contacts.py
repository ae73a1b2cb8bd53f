"""Compliant contacts between shapes: a normal force by the depth, with damping, and friction that is smooth at rest."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from mbd_sim.dynamics.applied_wrenches import AppliedWrenches
from mbd_sim.dynamics.shape_contacts import touch
from mbd_sim.dynamics.spatial_algebra import is_absent
from mbd_sim.mechanism.contacts import Contact, ContactBody, Cushion
from mbd_sim.mechanism.records import GROUND


@dataclass(frozen=True, eq=False)
class _Frame:
    position: ca.SX
    rotation: ca.SX


def apply_cushion(applied: AppliedWrenches, contact: Contact, law: Cushion) -> tuple[ca.SX, ca.SX]:
    """Apply the forces of a compliant contact; returns its potential in J and its dissipated power in W.

    The normal force is k δⁿ (1 + c δ') (Hunt & Crossley 1975); at a separation faster than 1 / c contact is lost.
    Friction acts against the slip v with the size μ N v / √(v² + v_r²).
    """
    bodies = contact.first, contact.second
    touching = touch(contact, _frame(applied, contact.first), _frame(applied, contact.second))
    first, second = (_velocity(applied, body, touching.point) for body in bodies)
    relative = first - second
    depth, approach = ca.fmax(-touching.distance, 0.0), -ca.dot(touching.normal, relative)
    spring = law.stiffness * (depth if law.exponent == 1.0 else depth**law.exponent)
    potential = spring * depth / (law.exponent + 1.0)
    damping = ca.SX(1, 1) if is_absent(law.damping) else spring * ca.fmax(law.damping * approach, -1.0)
    size = spring + damping
    force, dissipated = size * touching.normal, damping * approach
    if not is_absent(law.friction):
        slip = relative + touching.normal * approach
        square = ca.dot(slip, slip)
        factor = law.friction * size / ca.sqrt(square + law.regularization**2)
        force -= factor * slip
        dissipated += factor * square
    for body, sign in zip(bodies, (1.0, -1.0), strict=True):
        _apply_at(applied, body, touching.point, sign * force)
    return potential, dissipated


def _frame(applied: AppliedWrenches, body: ContactBody) -> _Frame:
    return _Frame(applied.motion_of(body.at).position, applied.rotation(body.at.part))


def _velocity(applied: AppliedWrenches, body: ContactBody, point: ca.SX) -> ca.SX:
    """The velocity (3,) of the part's material at a point (3,) of ground's frame."""
    motion = applied.motion_of(body.at)
    return motion.velocity + ca.cross(motion.omega, point - motion.position)


def _apply_at(applied: AppliedWrenches, body: ContactBody, point: ca.SX, force: ca.SX) -> None:
    """Apply a force (3,) in N on a body at a point (3,) of ground's frame."""
    if body.at.part != GROUND:
        applied.add_force(body.at, force)
        applied.add_couple(body.at, ca.cross(point - applied.motion_of(body.at).position, force))
