"""Compliant contacts between shapes: a normal force by the depth, with damping, and friction that is smooth at rest."""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca

from mbd_sim.dynamics.applied_wrenches import AppliedWrenches
from mbd_sim.dynamics.shape_contacts import Touch, touch
from mbd_sim.dynamics.spatial_algebra import is_absent
from mbd_sim.mechanism.contacts import Contact, ContactBody, Cushion
from mbd_sim.mechanism.records import GROUND


class PlacedFrame(NamedTuple):
    """A frame in ground's axes: the position (3,) in m of its origin, and its axes (3, 3)."""

    position: ca.SX
    rotation: ca.SX


class CushionForce(NamedTuple):
    """The forces (3,) in N of a compliant contact on its first body, in ground's axes, and its powers.

    `elastic` is that of the `potential` in J; `resisting` is that of damping and friction, which dissipate `loss` in W.
    """

    elastic: ca.SX
    resisting: ca.SX
    potential: ca.SX
    loss: ca.SX


def cushion_force(law: Cushion, touching: Touch, relative: ca.SX) -> CushionForce:
    """The force at the depth δ: k δⁿ (1 + c δ'), and friction μ N v / √(v² + v_r²) against the slip v.

    At a separation faster than 1 / c contact is lost (Hunt & Crossley 1975).

    :param relative: (3,) the velocity of the first body at the contact relative to the second in m/s.
    """
    depth, approach = ca.fmax(-touching.distance, 0.0), -ca.dot(touching.normal, relative)
    spring = law.stiffness * (depth if law.exponent == 1.0 else depth**law.exponent)
    damping = ca.SX(1, 1) if is_absent(law.damping) else spring * ca.fmax(law.damping * approach, -1.0)
    resisting, loss = damping * touching.normal, damping * approach
    if not is_absent(law.friction):
        slip = relative + touching.normal * approach
        square = ca.dot(slip, slip)
        factor = law.friction * (spring + damping) / ca.sqrt(square + law.regularization**2)
        resisting, loss = resisting - factor * slip, loss + factor * square
    return CushionForce(spring * touching.normal, resisting, spring * depth / (law.exponent + 1.0), loss)


class AppliedCushion(NamedTuple):
    """A compliant contact: its `potential` in J, its dissipated power `loss` in W, and its `place`.

    The place (6,) is the point in m where it touches, and the force in N on the first body, in ground's axes.
    """

    potential: ca.SX
    loss: ca.SX
    place: ca.SX


def apply_cushion(applied: AppliedWrenches, contact: Contact, law: Cushion) -> AppliedCushion:
    """Apply the forces of a compliant contact."""
    bodies = contact.first, contact.second
    touching = touch(contact, _frame(applied, contact.first), _frame(applied, contact.second))
    first, second = (_velocity(applied, body, touching.point) for body in bodies)
    force = cushion_force(law, touching, first - second)
    for body, sign in zip(bodies, (1.0, -1.0), strict=True):
        _apply_at(applied, body, touching.point, sign * (force.elastic + force.resisting))
    return AppliedCushion(force.potential, force.loss, ca.vertcat(touching.point, force.elastic + force.resisting))


def _frame(applied: AppliedWrenches, body: ContactBody) -> PlacedFrame:
    return PlacedFrame(applied.motion_of(body.at).position, applied.rotation(body.at.part))


def _velocity(applied: AppliedWrenches, body: ContactBody, point: ca.SX) -> ca.SX:
    """The velocity (3,) of the part's material at a point (3,) of ground's frame."""
    motion = applied.motion_of(body.at)
    return motion.velocity + ca.cross(motion.omega, point - motion.position)


def _apply_at(applied: AppliedWrenches, body: ContactBody, point: ca.SX, force: ca.SX) -> None:
    """Apply a force (3,) in N on a body at a point (3,) of ground's frame."""
    if body.at.part != GROUND:
        applied.add_force(body.at, force)
        applied.add_couple(body.at, ca.cross(point - applied.motion_of(body.at).position, force))
