"""Constraints as scalar equations, written on the symbols of the parts (Géradin & Rixen; Nikravesh, ch. 7).

A holonomic row is a function of the poses that stays zero; its velocity follows by differentiation. A nonholonomic row
is a velocity that stays zero.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple, assert_never

import casadi as ca
import numpy as np

from mbd_sim.dynamics.body_symbols import BodyFrame, BodySymbols
from mbd_sim.dynamics.spatial_algebra import constant
from mbd_sim.dynamics.time_functions import function_of
from mbd_sim.geometry import rotation as rot
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism import constraints as c
from mbd_sim.mechanism.joint_types import LoopCondition
from mbd_sim.mechanism.records import Attachment, Joint, Mechanism
from mbd_sim.mechanism.source import Location


@dataclass(frozen=True, eq=False)
class ConstraintRow:
    """One scalar constraint of the joint or constraint at `owner`, described by `what`.

    A holonomic row has a `position` that stays zero, in `unit`; a nonholonomic row has a `velocity`, linear in the
    velocities of the parts. `factors` are those of joint coordinates, which the position does not include.
    """

    owner: Location
    what: str
    position: ca.SX | None = None
    velocity: ca.SX | None = None
    unit: str = "m"
    factors: Mapping[str, float] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The owner's name and the constrained quantity."""
        return f"{self.owner[1]}: {self.what}"


def constraint_rows(
    mechanism: Mechanism, bodies: BodySymbols, time: ca.SX, own_axes: Collection[str] = ()
) -> list[ConstraintRow]:
    """The rows of all closing joints and constraints.

    The gap of a loop is measured along the axes of the part from which both branches of the loop start: there a plane
    loop stays in its plane, however it is carried about. For the joints in `own_axes` it is measured along the axes of
    one of the joint's ends, for loops that rotate about an axis of that part.

    :param time: the symbol of time in the expressions of the constraints.
    """
    rows = [
        ConstraintRow(("joints", joint.name), equation.what, equation.position, unit=equation.unit)
        for joint in mechanism.closing.values()
        for equation in _loop(joint, bodies, joint.name in own_axes)
    ]
    writer = _RowWriter(bodies, time)
    return rows + [row for constraint in mechanism.constraints for row in writer.rows_of(constraint)]


class _RowWriter:
    """Writes the rows of constraints on the symbols of the parts."""

    def __init__(self, bodies: BodySymbols, time: ca.SX) -> None:
        self._bodies, self._time = bodies, time

    def _at(self, place: Attachment) -> BodyFrame:
        return self._bodies.frame(place.part, place.point)

    def rows_of(self, record: c.Constraint) -> Iterator[ConstraintRow]:
        """The rows of a constraint."""
        match record:
            case c.Distance():
                yield self._distance(record)
            case c.Cable():
                yield self._cable(record)
            case c.Flat():
                yield from self._flat(record)
            case c.Surface():
                yield from self._surface(record)
            case c.Coupling():
                yield self._coupling(record)
            case c.Rolling():
                yield from self._rolling(record)
            case c.KnifeEdge():
                yield self._knife_edge(record)
            case _:
                assert_never(record)

    def _distance(self, record: c.Distance) -> ConstraintRow:
        """(l² - length²) / 2 length: as large as l - length near zero, and smooth where the points meet."""
        length = function_of(record.length, {"t": self._time})
        line = self._at(record.second).position - self._at(record.first).position
        return ConstraintRow(_owner(record), "length", (ca.dot(line, line) - length * length) / (2.0 * length))

    def _cable(self, record: c.Cable) -> ConstraintRow:
        total = -function_of(record.length, {"t": self._time})
        for one, other in pairwise(record.points):
            total += ca.norm_2(self._at(other).position - self._at(one).position)
        return ConstraintRow(_owner(record), "length", total)

    def _flat(self, record: c.Flat) -> Iterator[ConstraintRow]:
        base = self._at(record.base)
        line = self._at(record.point).position - base.position
        for number, normal in enumerate(record.normals):
            what = "distance from the plane" if len(record.normals) == 1 else f"distance from the line, {number + 1}"
            yield ConstraintRow(_owner(record), what, ca.dot(base.rotation @ constant(normal), line))

    def _surface(self, record: c.Surface) -> Iterator[ConstraintRow]:
        base = self._bodies.frame(record.base.part, record.base.point, record.axes)
        point = base.rotation.T @ (self._at(record.point).position - base.position)
        names = {"x": point[0], "y": point[1], "z": point[2], "t": self._time}
        for number, equation in enumerate(record.equations):
            what = "equation" if len(record.equations) == 1 else f"equation {number + 1}"
            yield ConstraintRow(_owner(record), what, function_of(equation, names), unit="")

    def _coupling(self, record: c.Coupling) -> ConstraintRow:
        value = function_of(record.value, {"t": self._time})
        unit = "m" if record.kind in ("gear", "rack") else ""
        return ConstraintRow(_owner(record), "coordinates", -value, unit=unit, factors=record.factors)

    def _rolling(self, record: c.Rolling) -> Iterator[ConstraintRow]:
        """Contact, and no slip at the contact along two directions of the plane (Huston & Liu, sec. 11.10.5).

        The directions of a wheel are forward and sideways. Wheels on one axle then share a row in any position.
        """
        wheel, plane = self._at(record.center), self._at(record.plane)
        normal = ca.sparsify(plane.rotation @ constant(record.normal))
        up, directions = normal, [plane.rotation @ constant(side) for side in _perpendiculars(record.normal)]
        if record.axis is not None:
            axis = wheel.rotation @ constant(record.axis)
            in_disc = normal - axis * ca.dot(normal, axis)
            size = ca.sqrt(ca.dot(in_disc, in_disc))
            up, forward = in_disc / size, ca.cross(axis, normal) / size
            directions = [forward, ca.cross(normal, forward)]
        arm = -record.radius * up
        contact = wheel.position + arm
        yield ConstraintRow(_owner(record), "contact", ca.dot(normal, contact - plane.position))
        slip = wheel.velocity + ca.cross(wheel.omega, arm) - _velocity_at(plane, contact)
        for number, direction in enumerate(directions):
            yield ConstraintRow(_owner(record), f"slip {number + 1}", velocity=ca.dot(direction, slip))

    def _knife_edge(self, record: c.KnifeEdge) -> ConstraintRow:
        blade, plane = self._at(record.point), self._at(record.plane)
        normal = plane.rotation @ constant(record.normal)
        sideways = ca.cross(normal, blade.rotation @ constant(record.direction))
        slip = blade.velocity - _velocity_at(plane, blade.position)
        return ConstraintRow(_owner(record), "sideways motion", velocity=ca.dot(sideways / ca.norm_2(sideways), slip))


def _owner(record: c.Constraint) -> Location:
    return "constraints", record.name


def _velocity_at(frame: BodyFrame, point: ca.SX) -> ca.SX:
    """The velocity (3,) of a point that is fixed in a frame's part, in ground's axes."""
    return frame.velocity + ca.cross(frame.omega, point - frame.position)


def _perpendiculars(axis: Array) -> Array:
    """Two unit vectors (2, 3) perpendicular to a unit `axis` and to each other."""
    return rot.aligning_z(axis)[:, :2].T


def joint_frames(joint: Joint, bodies: BodySymbols) -> tuple[BodyFrame, BodyFrame]:
    """The frames of a joint on its parent and on its child."""
    first, second = joint.parent_pose, joint.child_pose
    return (
        bodies.frame(joint.parent, first.position, first.rotation),
        bodies.frame(joint.child, second.position, second.rotation),
    )


class LoopEquation(NamedTuple):
    """An expression that a closing joint keeps at zero, its description, and its unit: m, or none for cosines."""

    what: str
    position: ca.SX
    unit: str = "m"


@dataclass(frozen=True, eq=False)
class _ClosingJoint:
    """A joint between two frames, and the `gap` (3,) from the first origin to the second in ground's axes.

    `base` (3, 3) are the axes along which a shared point is compared. All other directions belong to the first frame.
    """

    joint: Joint
    first: BodyFrame
    second: BodyFrame
    gap: ca.SX
    base: ca.SX

    @property
    def axis(self) -> Array:
        """The joint's axis (3,), or z if it has none."""
        return self.joint.axis if self.joint.axis.any() else np.array([0.0, 0.0, 1.0])

    def in_first(self, direction: Array) -> ca.SX:
        """A direction (3,) fixed in the first frame, in ground's axes."""
        return ca.sparsify(self.first.rotation @ constant(direction))

    def in_second(self, direction: Array) -> ca.SX:
        """A direction (3,) fixed in the second frame, in ground's axes."""
        return ca.sparsify(self.second.rotation @ constant(direction))


def _shared_point(closing: _ClosingJoint) -> Iterator[LoopEquation]:
    gap = ca.sparsify(closing.base.T @ closing.gap)
    for index, name in enumerate("xyz"):
        yield LoopEquation(f"displacement along {name}", gap[index])


def _shared_line(closing: _ClosingJoint) -> Iterator[LoopEquation]:
    for number, side in enumerate(_perpendiculars(closing.axis), start=1):
        position = ca.dot(closing.in_first(side), closing.gap)
        yield LoopEquation(f"displacement across the axis, {number}", position)


def _parallel_axes(closing: _ClosingJoint) -> Iterator[LoopEquation]:
    axis = closing.in_second(closing.axis)
    for number, side in enumerate(_perpendiculars(closing.axis), start=1):
        yield LoopEquation(f"tilt of the axis, {number}", ca.dot(closing.in_first(side), axis), "")


def _same_orientation(closing: _ClosingJoint) -> Iterator[LoopEquation]:
    for name, one, other in (("x", 1, 2), ("y", 2, 0), ("z", 0, 1)):
        cosine = ca.dot(closing.first.rotation[:, one], closing.second.rotation[:, other])
        yield LoopEquation(f"rotation about {name}", cosine, "")


def _loop(joint: Joint, bodies: BodySymbols, own_axes: bool) -> Iterator[LoopEquation]:
    """The equations of a closing joint, along axes of the common carrier or of one of its ends."""
    first, second = joint_frames(joint, bodies)
    carrier = bodies.common_carrier(joint.parent, joint.child)
    if not own_axes:
        return loop_equations(joint, first, second, bodies.frame(carrier, np.zeros(3)).rotation)
    if joint.parent == carrier and joint.type != "universal":
        first, second = second, first
    return loop_equations(joint, first, second, first.rotation)


def loop_equations(joint: Joint, first: BodyFrame, second: BodyFrame, base: ca.SX) -> Iterator[LoopEquation]:
    """The equations of a joint between two frames (Nikravesh, sec. 7.2).

    :param base: (3, 3) the axes along which a shared point is compared, in ground's axes.
    """
    closing = _ClosingJoint(joint, first, second, second.position - first.position, base)
    for condition in joint.kind.loop_conditions:
        yield from _equations_of(condition, closing)


def _equations_of(condition: LoopCondition, closing: _ClosingJoint) -> Iterator[LoopEquation]:
    match condition:
        case "coincident points":
            yield from _shared_point(closing)
        case "point on axis":
            yield from _shared_line(closing)
        case "point in plane":
            position = ca.dot(closing.in_first(closing.axis), closing.gap)
            yield LoopEquation("displacement along the normal", position)
        case "parallel axes":
            yield from _parallel_axes(closing)
        case "equal orientations":
            yield from _same_orientation(closing)
        case "constant angle between axes":
            axis, second = closing.joint.axis, closing.joint.second
            cosine = ca.dot(closing.in_first(axis), closing.in_second(second))
            yield LoopEquation("angle of the axes", cosine - float(axis @ second), "")
        case "advance by the lead":
            yield LoopEquation("advance", _screw_advance(closing.joint, closing.first, closing.second)[0])
        case _:
            assert_never(condition)


def _screw_advance(joint: Joint, first: BodyFrame, second: BodyFrame) -> tuple[ca.SX, ca.SX]:
    """The displacement less that of the angle, written with sines, so that whole turns make no difference.

    Half a turn does: there the second value, otherwise positive, is negative.
    """
    pitch, (x, y) = joint.lead / (2.0 * np.pi), _perpendiculars(joint.axis)

    def in_first(direction: Array) -> ca.SX:
        return ca.sparsify(first.rotation @ constant(direction))

    displacement = ca.dot(in_first(joint.axis), second.position - first.position)
    side = second.rotation @ constant(x)
    if pitch == 0.0:
        return displacement, ca.SX(1)
    cosine, sine, angle = ca.dot(in_first(x), side), ca.dot(in_first(y), side), displacement / pitch
    return pitch * (ca.sin(angle) * cosine - ca.cos(angle) * sine), ca.cos(angle) * cosine + ca.sin(angle) * sine


def branch_checks(joint: Joint, first: BodyFrame, second: BodyFrame) -> list[ca.SX]:
    """Expressions that are positive if a loop is closed in the right assembly mode: no axis or nut is flipped."""
    conditions = joint.kind.loop_conditions
    axes = np.zeros((0, 3))
    if "equal orientations" in conditions:
        axes = np.eye(3)
    elif "parallel axes" in conditions:
        axes = joint.axis[None, :]
    cosines = [ca.dot(first.rotation @ constant(axis), second.rotation @ constant(axis)) for axis in axes]
    return [*cosines, _screw_advance(joint, first, second)[1]] if "advance by the lead" in conditions else cosines
