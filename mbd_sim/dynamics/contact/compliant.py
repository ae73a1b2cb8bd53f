"""Compliant contacts between shapes: a normal force by the depth, with damping, and friction that is smooth at rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from mbd_sim.dynamics.contact.shapes import Touch, touch
from mbd_sim.dynamics.kinematics.poses import SymbolicPose
from mbd_sim.dynamics.kinematics.wrenches import AppliedWrenches
from mbd_sim.dynamics.math.spatial import is_absent
from mbd_sim.mechanism.elements.contacts import ComplianceLaw, Contact, ContactBody
from mbd_sim.mechanism.elements.parts import GROUND


@dataclass(frozen=True, slots=True)
class ComplianceForce:
    """The forces (3,) in N of a compliant contact on its first body, in ground's axes, and its powers.

    `elastic` is that of the `potential` in J; `resisting` is that of damping and friction, which dissipate `loss` in W.
    `normal` in N is the part of both along the normal.
    """

    normal: ca.SX
    elastic: ca.SX
    resisting: ca.SX
    potential: ca.SX
    loss: ca.SX


def compliance_force(law: ComplianceLaw, touching: Touch, relative: ca.SX) -> ComplianceForce:
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
    return ComplianceForce(
        spring + damping, spring * touching.normal, resisting, spring * depth / (law.exponent + 1.0), loss
    )


@dataclass(frozen=True, slots=True)
class AppliedCompliance:
    """A compliant contact: its `potential` in J, its dissipated power `loss` in W, its `place` and its `reading`.

    The place (6,) is the point in m where it touches, and the force in N on the first body, in ground's axes. The
    reading (3 + 2 k,) is the gap in m, its rate in m/s and the normal force in N, then k friction forces in N and k
    slips in m/s along the directions in which slip is possible.
    """

    potential: ca.SX
    loss: ca.SX
    place: ca.SX
    reading: ca.SX


@dataclass(frozen=True, eq=False)
class ComplianceFunctions:
    """Functions (t, y, inputs) of all compliant contacts, see `AppliedCompliance`.

    `places` (9, contacts) are points, forces and normals; `readings` one after the other, with as many `directions` of
    friction each.
    """

    places: ca.Function
    readings: ca.Function
    directions: tuple[int, ...]


def compliance_functions(inputs: list[ca.SX], compliances: Sequence[AppliedCompliance]) -> ComplianceFunctions:
    """The functions of compliant contacts."""
    places = ca.horzcat(*[compliance.place for compliance in compliances])
    readings = ca.vertcat(*[compliance.reading for compliance in compliances])
    return ComplianceFunctions(
        ca.Function("compliances", inputs, [ca.densify(places)], {"cse": True}),
        ca.Function("compliance_readings", inputs, [ca.densify(readings)], {"cse": True}),
        tuple((compliance.reading.numel() - 3) // 2 for compliance in compliances),
    )


def apply_compliance(
    applied: AppliedWrenches, contact: Contact, law: ComplianceLaw, still: int | None
) -> AppliedCompliance:
    """Apply the forces of a compliant contact.

    :param still: see `touch`.
    """
    bodies = contact.first, contact.second
    touching = touch(contact, _frame(applied, contact.first), _frame(applied, contact.second), still)
    first, second = (_velocity(applied, body, touching.point) for body in bodies)
    force = compliance_force(law, touching, first - second)
    for body, sign in zip(bodies, (1.0, -1.0), strict=True):
        _apply_at(applied, body, touching.point, sign * (force.elastic + force.resisting))
    total = force.elastic + force.resisting
    reading = _reading(law, touching, first - second, force.normal, total)
    place = ca.vertcat(touching.point, total, touching.normal)
    return AppliedCompliance(force.potential, force.loss, place, reading)


def _reading(law: ComplianceLaw, touching: Touch, relative: ca.SX, normal: ca.SX, force: ca.SX) -> ca.SX:
    slips = [(side, ca.sparsify(ca.dot(side, relative))) for side in touching.sides]
    possible = [] if is_absent(law.friction) else [(side, slip) for side, slip in slips if slip.nnz()]
    friction = [ca.dot(side, force) for side, _ in possible]
    return ca.vertcat(
        touching.distance, ca.dot(touching.normal, relative), normal, *friction, *(slip for _, slip in possible)
    )


def _frame(applied: AppliedWrenches, body: ContactBody) -> SymbolicPose:
    return SymbolicPose(applied.motion_of(body.at).position, applied.rotation(body.at.part))


def _velocity(applied: AppliedWrenches, body: ContactBody, point: ca.SX) -> ca.SX:
    """The velocity (3,) of the part's material at a point (3,) of ground's frame."""
    motion = applied.motion_of(body.at)
    return motion.velocity + ca.cross(motion.omega, point - motion.position)


def _apply_at(applied: AppliedWrenches, body: ContactBody, point: ca.SX, force: ca.SX) -> None:
    """Apply a force (3,) in N on a body at a point (3,) of ground's frame."""
    if body.at.part != GROUND:
        applied.add_force(body.at, force)
        applied.add_couple(body.at, ca.cross(point - applied.motion_of(body.at).position, force))
