"""The one-sided rows of a mechanism: gaps with their friction, and dry friction that sticks.

A gap is a position g ≥ 0, or for a one-way clutch a speed ≥ 0. Friction acts along one or two slip velocities. That of
joints depends on the forces that they transmit across their axes.

Where contacts are, and the forces that they exert there, are expressed here too.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import assert_never

import casadi as ca
import numpy as np

from mbd_sim.base.errors import InputError, MechanismError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.geometry.rotation import aligning_z
from mbd_sim.dynamics.constraints.rows import ConstraintRow, RowWriter, perpendiculars, velocity_at
from mbd_sim.dynamics.contact.barrel_rows import BARREL_SIZE, barrel_touch, has_one_row
from mbd_sim.dynamics.contact.cluster_rows import cluster_touch
from mbd_sim.dynamics.contact.feature_rows import SLOT_SIZE, slot_touch
from mbd_sim.dynamics.contact.outline_rows import outline_touch
from mbd_sim.dynamics.contact.planar.planar_solids import between_outlines, in_plane
from mbd_sim.dynamics.contact.rows.pools import SlotPool, pooled
from mbd_sim.dynamics.contact.shapes import Touch, touch, with_rim_points, with_slip_in_plane, without_repeated
from mbd_sim.dynamics.contact.smooth_rows import SMOOTH_SIZE, smooth_touch
from mbd_sim.dynamics.kinematics.links import Link
from mbd_sim.dynamics.kinematics.poses import BodyFrame, BodySymbols
from mbd_sim.dynamics.math.expressions import function_of
from mbd_sim.dynamics.math.laws import dry_friction
from mbd_sim.dynamics.math.spatial import constant, is_absent
from mbd_sim.mechanism.elements import constraints as c
from mbd_sim.mechanism.elements.constraints import Bound, ContactLaw, is_one_sided
from mbd_sim.mechanism.elements.contacts import Ball, Barrel, Cluster, Contact, Face, PlanarBody, Solid
from mbd_sim.mechanism.elements.parts import GROUND, Joint
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.source import Location


@dataclass(frozen=True, eq=False)
class JointLoad:
    """The force across a joint's axis in N, affine in the contact forces λ (rows,): `unloaded` (k,) + `by_force` λ.

    The k = 1, 2 or 3 components are those that do not vanish in every motion. `factor` is k_s μ while the joint slides
    in the direction k_s = ±1, and 0 otherwise; `sign` is the stored sign of a single component. `near` (k,) is the
    force under the given forces among the inputs.
    """

    row: int
    unloaded: ca.SX
    by_force: ca.SX
    factor: ca.SX
    sign: ca.SX
    near: ca.SX

    @property
    def components(self) -> int:
        """k."""
        return int(self.unloaded.shape[0])

    def size(self, forces: ca.SX) -> ca.SX:
        """|N| in N."""
        components = self.unloaded + self.by_force @ forces
        return ca.fabs(components[0]) if self.components == 1 else ca.sqrt(ca.dot(components, components))

    @property
    def start(self) -> ca.SX:
        """A direction (k,) near that of the force, from which it is iterated."""
        if self.components == 1:
            return self.sign
        size = ca.sqrt(ca.dot(self.near, self.near))
        first = ca.SX(ca.DM([1.0] + [0.0] * (self.components - 1)))
        return ca.if_else(size > 0.0, self.near / ca.fmax(size, 1e-300), first)


def transmitted_force(links: Sequence[Link], joint: Joint, transmitted: Sequence[ca.SX]) -> ca.SX:
    """The force (k,) that a joint transmits: across the axis of a slider, and in all directions of a hinge.

    :param transmitted: F_L (6,) on each link through its joint.
    """
    index = next(number for number, link in enumerate(links) if link.joint.name == joint.name)
    force = transmitted[index][3:]
    if joint.type == "prismatic":
        axis = links[index].axes.axis
        force = constant(aligning_z(axis)[:, :2].T if np.count_nonzero(axis) > 1 else _others(axis)) @ force
    return ca.sparsify(force)


def _others(axis: np.ndarray) -> np.ndarray:
    """The coordinate directions (2, 3) other than that of an axis."""
    return np.delete(np.eye(3), int(np.argmax(np.abs(axis))), axis=0)


@dataclass(frozen=True, eq=False)
class ContactPlace:
    """The place of a gap in ground's frame, all (3,): its `point` in m, its `normal`, and the `sides` of its slip rows.

    These are the directions of the forces that unit multipliers exert on the first part of the contact: that of the
    constrained point, of the wheel, or of the end of a rope.
    """

    point: ca.SX
    normal: ca.SX
    sides: tuple[ca.SX, ...] = ()

    @property
    def in_one_vector(self) -> ca.SX:
        """All in (12,), with two sides."""
        return ca.vertcat(self.point, self.normal, *self.sides)

    def with_numbers(self, old: ca.SX, new: ca.SX) -> ContactPlace:
        """The place with other symbols for the numbers of a slot."""
        point, normal, *sides = ca.substitute([self.point, self.normal, *self.sides], [old], [new])
        return ContactPlace(point, normal, tuple(sides))


def placed_forces(
    places: Sequence[tuple[ContactPlace, Sequence[ConstraintRow]]],
    rows: Sequence[ConstraintRow],
    forces: ca.SX,
    in_state: Callable[[ca.SX], ca.SX],
) -> ca.SX:
    """The points in m, the forces in N and the normals (9, places), in ground's frame.

    :param places: each with the row of its gap, and those of its slip.
    :param rows: those that have multipliers; other slip cannot occur.
    :param forces: the multipliers λ (rows,).
    :param in_state: expresses expressions of the parts' poses in the state.
    """
    index, columns = {row: number for number, row in enumerate(rows)}, []
    for place, own in places:
        force = ca.SX(3, 1)
        for row, direction in zip(own, (place.normal, *place.sides), strict=False):
            if row in index:
                force += forces[index[row]] * in_state(direction)
        columns.append(ca.vertcat(in_state(place.point), force, in_state(place.normal)))
    return ca.horzcat(ca.SX(9, 0), *columns)


@dataclass(frozen=True, eq=False)
class Gap:
    """A one-sided row: its position, or for a `clutch` its rate, is not negative.

    `slip` are up to two rows whose rates are the slip velocities at the contact. Stops, plays and clutches have
    no `place`. `bodies` are the names of the two shapes of a contact, for people. The geometry of a slot of a
    `contact` depends on its `numbers`, see `feature_rows`. Rows of all its slots are written with those of the first.
    Slots of a `pool` are written as those of its example.
    """

    row: ConstraintRow
    law: ContactLaw
    slip: tuple[ConstraintRow, ...] = ()
    clutch: bool = False
    place: ContactPlace | None = None
    bodies: tuple[str, str] | None = None
    contact: Contact | None = None
    numbers: ca.SX | None = None
    pool: SlotPool | None = None


@dataclass(frozen=True, eq=False)
class StickingFriction:
    """Dry friction against the rate of a row: `sliding(v)` is its size in motion, `static` at rest, in N or N·m.

    For a loaded `joint` both are times the force that this joint transmits across its axis.
    """

    row: ConstraintRow
    sliding: Callable[[ca.SX], ca.SX]
    static: ca.SX
    joint: Joint | None = None


def one_sided_rows(
    mechanism: Mechanism,
    bodies: BodySymbols,
    time: ca.SX,
    t: ca.SX,
    length: float,
    still: int | None,
    across: Array | None,
    places: Mapping[str, float],
    rotations: Mapping[str, Array],
) -> tuple[list[Gap], list[StickingFriction]]:
    """All gaps and all sticking friction: joints, constraints, then contacts.

    :param time: the symbol of time in the rows.
    :param t: the symbol of time in the forces.
    :param length: the natural one in m.
    :param still: see `touch`.
    :param across: (3,) the normal of the plane in which all parts move, if there is one.
    :param places: of the parts along this axis, in m.
    :param rotations: (3, 3) of the parts and ground at the start.
    """
    gaps: list[Gap] = []
    frictions: list[StickingFriction] = []
    for joint in mechanism.joints.values():
        gaps += _stops(joint)
        if joint.friction is not None and joint.friction.sticks:
            frictions.append(_joint_friction(joint))
    writer = RowWriter(bodies, time)
    for constraint in mechanism.constraints:
        if isinstance(constraint, c.Clutch) and constraint.capacity is not None:
            frictions.append(_friction_clutch(constraint, writer, t))
        elif is_one_sided(constraint):
            gaps += _gaps_of(constraint, writer)
    rigid, pools = [contact for contact in mechanism.contacts if contact.rigid], list[SlotPool]()
    if still is None:
        rigid, pools = pooled(rigid, mechanism)
    for contact in without_repeated(rigid, still):
        try:
            shadows = between_outlines(contact, rotations)
        except InputError as error:
            raise MechanismError([mechanism.source.problem_of(("contacts", contact.name), error)]) from error
        moving = shadows if still is None else in_plane(shadows, still, places)
        if moving is None:
            message = "{} and {} never touch: they are beside each other along the axis along which nothing moves"
            remedy = "Move their shapes into one plane, or remove the contact."
            problem = message.format(*map(repr, contact.names))
            raise MechanismError([mechanism.source.problem(("contacts", contact.name), problem, remedy)])
        if moving.slots and not has_one_row(moving, still):
            gaps += _slots(moving, bodies, length, across if moving.still is None else None)
        else:
            gaps += [_shape_gap(each, bodies, still, across) for each in with_rim_points(contact, still)]
    for pool in pools:
        gaps += _slots_of_pool(pool, bodies, length)
    return gaps, frictions


def _shape_gap(contact: Contact, bodies: BodySymbols, still: int | None, across: Array | None) -> Gap:
    touching, face = touch(contact, *_frames(contact, bodies), still), contact.second
    if still is None or (isinstance(face, Face) and face.normal[still] != 0.0):
        touching = with_slip_in_plane(touching, across)
    return _gap_of(contact, touching, bodies)


def _slots(contact: Contact, bodies: BodySymbols, length: float, across: Array | None) -> Iterator[Gap]:
    """The gaps of a contact whose features change: all have the rows of the first one, with its numbers."""
    numbers, touching = _touch_of_slots(contact, bodies, length)
    gap = _gap_of(contact, with_slip_in_plane(touching, across), bodies)
    assert gap.place is not None
    for slot in range(1, contact.slots + 1):
        quantity = f"{contact.quantity} {slot}" if contact.slots > 1 else contact.quantity
        own = numbers if slot == 1 else ca.SX.sym("features", numbers.shape[0])
        slips = (
            dataclasses.replace(row, quantity=f"{quantity} slip {number}")
            for number, row in enumerate(gap.slip, start=1)
        )
        yield dataclasses.replace(
            gap,
            row=dataclasses.replace(gap.row, quantity=quantity),
            slip=tuple(slips),
            place=gap.place if slot == 1 else gap.place.with_numbers(numbers, own),
            contact=contact,
            numbers=own,
        )


def _slots_of_pool(pool: SlotPool, bodies: BodySymbols, length: float) -> Iterator[Gap]:
    """The gaps of a pool, whose bodies and places are not known before the slots are in use."""
    numbers = ca.SX.sym("features", SLOT_SIZE)
    touching = slot_touch(numbers, *_frames(pool.example, bodies), length, None)
    gap = _gap_of(pool.example, touching, bodies)
    for slot in range(1, pool.slots + 1):
        slips = (dataclasses.replace(row, quantity=f"{slot} slip {number}") for number, row in enumerate(gap.slip, 1))
        yield dataclasses.replace(
            gap,
            row=dataclasses.replace(gap.row, quantity=str(slot)),
            slip=tuple(slips),
            bodies=None,
            contact=pool.example,
            numbers=numbers if slot == 1 else ca.SX.sym("features", SLOT_SIZE),
            pool=pool,
        )


def _touch_of_slots(contact: Contact, bodies: BodySymbols, length: float) -> tuple[ca.SX, Touch]:
    """The numbers of a slot of a contact, and its geometry."""
    frames = _frames(contact, bodies)
    match contact.first, contact.second:
        case Cluster(), Face() as face:
            numbers = ca.SX.sym("features", SLOT_SIZE)
            return numbers, cluster_touch(numbers, *frames, face, length)
        case Ball() as ball, Barrel() as barrel:
            numbers = ca.SX.sym("features", BARREL_SIZE)
            return numbers, barrel_touch(contact, numbers, (ball, barrel), frames, length)
        case PlanarBody() as one, PlanarBody() as other:
            numbers = ca.SX.sym("features", SLOT_SIZE)
            return numbers, outline_touch(numbers, (one, other), *frames, length)
        case Solid() as one, Solid() as other:
            numbers = ca.SX.sym("features", SLOT_SIZE)
            crossing = contact.still is None and min(len(one.vertices), len(other.vertices)) > 1
            apart = one.radius + other.radius > 0.0
            return numbers, slot_touch(numbers, *frames, length, contact.still, crossing=crossing, apart=apart)
        case one, other:
            numbers = ca.SX.sym("features", SMOOTH_SIZE)
            return numbers, smooth_touch((one, other), numbers, frames, length)


def _frames(contact: Contact, bodies: BodySymbols) -> tuple[BodyFrame, BodyFrame]:
    first, second = (bodies.frame(body.at.part, body.at.point) for body in (contact.first, contact.second))
    return first, second


def _gap_of(contact: Contact, touching: Touch, bodies: BodySymbols) -> Gap:
    first, second = _frames(contact, bodies)
    law = contact.law
    assert isinstance(law, ContactLaw)
    owner = ("contacts", contact.name)
    iterated = touching.iterated
    slip = velocity_at(first, touching.point) - velocity_at(second, touching.point)
    rate = None if iterated is None else ca.dot(touching.normal, slip)
    if rate is not None and touching.lift is not None:
        rate -= touching.lift_cosine * bodies.rate(touching.lift)
    row = ConstraintRow(owner, contact.quantity, touching.distance, rate, normal=iterated)
    directions = (touching.normal, *touching.sides)
    point, normal, *sides = (
        (touching.point, *directions) if iterated is None else map(iterated.inserted, (touching.point, *directions))
    )
    place = ContactPlace(point, normal, tuple(sides))
    if is_absent(law.static_friction):
        return Gap(row, law, place=place, bodies=contact.names)
    slips = _slip_rows(owner, f"{contact.quantity} slip", slip, touching.sides)
    slips = tuple(dataclasses.replace(each, normal=iterated) for each in slips)
    return Gap(row, law, slips, place=place, bodies=contact.names)


def _stops(joint: Joint) -> Iterator[Gap]:
    """The rigid stops of a joint: q ≥ lower, and q ≤ upper, for each coordinate that has them."""
    for limits, name, coordinate in zip(joint.limits, joint.motion_names, joint.kind.coordinates, strict=False):
        if limits is None or limits.restitution is None:
            continue
        law, which = ContactLaw(limits.restitution), f"{coordinate.label.removeprefix('.')} ".lstrip()
        for end, sign, bound in (("lower limit", 1.0, limits.lower), ("upper limit", -1.0, limits.upper)):
            factors, position = {name: sign}, ca.SX(-sign * bound)
            owner, unit = ("joints", joint.name), coordinate.unit
            yield Gap(ConstraintRow(owner, f"{which}{end}", position, unit=unit, factors=factors), law)


def _joint_friction(joint: Joint) -> StickingFriction:
    law, (name,) = joint.friction, joint.motion_names
    assert law is not None
    unit = joint.kind.coordinates[0].unit
    row = ConstraintRow(("joints", joint.name), "friction", ca.SX(1, 1), unit=unit, factors={name: 1.0})
    if not is_absent(law.static_coefficient):
        return StickingFriction(row, lambda speed: ca.SX(law.coefficient), ca.SX(law.static_coefficient), joint)
    return StickingFriction(row, lambda speed: dry_friction(law, speed), ca.SX(law.static))


def _friction_clutch(record: c.Clutch, writer: RowWriter, t: ca.SX) -> StickingFriction:
    assert record.capacity is not None
    capacity = ca.fmax(function_of(record.capacity, {"t": t}), 0.0)
    (row,) = writer.rows_of(record)
    return StickingFriction(row, lambda speed: capacity, record.static * capacity)


def _gaps_of(record: c.Constraint, writer: RowWriter) -> Iterator[Gap]:
    """The gaps of a one-sided constraint."""
    match record:
        case c.Distance(law=ContactLaw() as law) | c.Cable(law=ContactLaw() as law):
            row = _bounded(next(writer.rows_of(record)), record.bound)
            yield Gap(row, law, place=_end_of_line(record, writer))
        case c.Flat(law=ContactLaw() as law):
            yield _plane_gap(record, law, writer)
        case c.Surface(law=ContactLaw() as law):
            yield _surface_gap(record, law, writer)
        case c.Rolling(law=ContactLaw() as law):
            contact, *slip = writer.rows_of(record)
            arm, normal, directions = writer.rolling_contact(record)
            place = ContactPlace(writer.frame(record.center).position + arm, normal, tuple(directions))
            yield Gap(contact, law, () if is_absent(law.static_friction) else tuple(slip), place=place)
        case c.Coupling(play=play) if play is not None:
            law, (row,) = ContactLaw(play.restitution), writer.rows_of(record)
            assert row.position is not None
            for quantity, sign in (("play, lower end", 1.0), ("play, upper end", -1.0)):
                factors = {name: sign * factor for name, factor in record.factors.items()}
                position = sign * row.position + play.half
                yield Gap(dataclasses.replace(row, quantity=quantity, position=position, factors=factors), law)
        case c.Coupling(law=ContactLaw() as law):
            row = _bounded(next(writer.rows_of(record)), record.bound)
            across = ConstraintRow(("constraints", record.name), "slip", ca.SX(1, 1), factors=record.slip)
            yield Gap(row, law, (across,) if record.slip and not is_absent(law.static_friction) else ())
        case c.Clutch(law=ContactLaw() as law):
            yield Gap(next(writer.rows_of(record)), law, clutch=True)
        case c.Distance() | c.Cable() | c.Flat() | c.Surface() | c.Rolling() | c.Coupling() | c.Clutch():
            raise ValueError(f"constraint {record.name} is not one-sided")
        case c.KnifeEdge():
            raise ValueError("a knife edge has no gap")
        case _:
            assert_never(record)


def _bounded(row: ConstraintRow, bound: Bound | None) -> ConstraintRow:
    """A row as a gap: its position where that is at least 0, the negative of it where it is at most 0."""
    assert row.position is not None
    if bound == "at_least":
        return row
    factors = {name: -factor for name, factor in row.factors.items()}
    return dataclasses.replace(row, position=-row.position, factors=factors)


def _end_of_line(record: c.Distance | c.Cable, writer: RowWriter) -> ContactPlace:
    """The last end of a rope or strut, or the first where the last is on ground; the direction is along the line."""
    points = record.points if isinstance(record, c.Cable) else (record.first, record.second)
    end, other = (points[0], points[1]) if points[-1].part == GROUND else (points[-1], points[-2])
    line = writer.frame(end).position - writer.frame(other).position
    return ContactPlace(writer.frame(end).position, _outward(line / ca.norm_2(line), record.bound))


def _plane_gap(record: c.Flat, law: ContactLaw, writer: RowWriter) -> Gap:
    """The distance of a point from a plane, and the two components of its velocity along the plane."""
    row = _bounded(next(writer.rows_of(record)), record.bound)
    base, point = writer.frame(record.base), writer.frame(record.point)
    normal = _outward(base.rotation @ constant(record.normals[0]), record.bound)
    if is_absent(law.static_friction):
        return Gap(row, law, place=ContactPlace(point.position, normal))
    slip = point.velocity - velocity_at(base, point.position)
    sides = [base.rotation @ constant(side) for side in perpendiculars(record.normals[0])]
    place = ContactPlace(point.position, normal, tuple(sides))
    return Gap(row, law, _slip_rows(("constraints", record.name), "slip", slip, sides), place=place)


def _surface_gap(record: c.Surface, law: ContactLaw, writer: RowWriter) -> Gap:
    """f / |∇f|: on the surface its gradient is the unit normal, so that its multiplier is the normal force."""
    gap = writer.surface_gap(record)
    row = ConstraintRow(("constraints", record.name), "distance from the surface", gap.position)
    slip = () if is_absent(law.static_friction) else _slip_rows(row.owner, "slip", gap.slip, gap.sides)
    place = ContactPlace(gap.point, _outward(gap.normal, record.bound), tuple(gap.sides))
    return Gap(_bounded(row, record.bound), law, slip, place=place)


def _outward(normal: ca.SX, bound: Bound | None) -> ca.SX:
    """The direction (3,) in which the gap grows, from that in which the position grows."""
    return normal if bound == "at_least" else -normal


def _slip_rows(owner: Location, quantity: str, slip: ca.SX, sides: Sequence[ca.SX]) -> tuple[ConstraintRow, ...]:
    return tuple(
        ConstraintRow(owner, f"{quantity} {number}", velocity=ca.dot(side, slip))
        for number, side in enumerate(sides, start=1)
    )
