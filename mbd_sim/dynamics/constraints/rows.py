"""Constraints as scalar equations, written on the symbols of the parts (Géradin & Rixen; Nikravesh, ch. 7).

A holonomic row is a function of the poses that stays zero; its velocity follows by differentiation. A nonholonomic row
is a velocity that stays zero. The rows of a joint that closes a loop are written on its two frames (Nikravesh,
sec. 7.2).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import assert_never

import casadi as ca
import numpy as np

from mbd_sim.base.geometry import rotation as rot
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.linear_algebra import product
from mbd_sim.dynamics.kinematics.poses import BodyFrame, BodySymbols
from mbd_sim.dynamics.math.expressions import function_of
from mbd_sim.dynamics.math.spatial import constant
from mbd_sim.mechanism.elements import constraints as c
from mbd_sim.mechanism.elements.constraints import two_sided
from mbd_sim.mechanism.elements.joint_types import LoopCondition
from mbd_sim.mechanism.elements.parts import Attachment, Joint
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.expression import TimeExpression
from mbd_sim.mechanism.values.source import Location


def perpendiculars(axis: Array) -> Array:
    """Two unit vectors (2, 3) perpendicular to a unit `axis` and to each other."""
    return rot.aligning_z(axis)[:, :2].T


def joint_frames(joint: Joint, bodies: BodySymbols) -> tuple[BodyFrame, BodyFrame]:
    """The frames of a joint on its parent and on its child."""
    first, second = joint.parent_pose, joint.child_pose
    return (
        bodies.frame(joint.parent, first.position, first.rotation),
        bodies.frame(joint.child, second.position, second.rotation),
    )


@dataclass(frozen=True, slots=True)
class LoopEquation:
    """An expression that a closing joint keeps at zero, its description, and its unit: m, or none for cosines."""

    quantity: str
    position: ca.SX
    unit: str = "m"


@dataclass(frozen=True, eq=False)
class _ClosingJoint:
    """A joint between two frames, and the `gap` (3,) from the first origin to the second in ground's axes.

    `base` (3, 3) are the axes along which a shared point is compared, and `base_names` describe them. All other
    directions belong to the first frame.
    """

    joint: Joint
    first: BodyFrame
    second: BodyFrame
    gap: ca.SX
    base: ca.SX
    base_names: Sequence[str]

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
    for index, direction in enumerate(closing.base_names):
        yield LoopEquation(f"displacement {direction}", gap[index])


def _shared_line(closing: _ClosingJoint) -> Iterator[LoopEquation]:
    for number, side in enumerate(perpendiculars(closing.axis), start=1):
        position = ca.dot(closing.in_first(side), closing.gap)
        yield LoopEquation(f"displacement across the axis, {number}", position)


def _parallel_axes(closing: _ClosingJoint) -> Iterator[LoopEquation]:
    axis = closing.in_second(closing.axis)
    for number, side in enumerate(perpendiculars(closing.axis), start=1):
        yield LoopEquation(f"tilt of the axis, {number}", ca.dot(closing.in_first(side), axis), "")


def _same_orientation(closing: _ClosingJoint) -> Iterator[LoopEquation]:
    for name, one, other in (("x", 1, 2), ("y", 2, 0), ("z", 0, 1)):
        cosine = ca.dot(closing.first.rotation[:, one], closing.second.rotation[:, other])
        yield LoopEquation(f"rotation about {name}", cosine, "")


def loop_equations(
    joint: Joint,
    first: BodyFrame,
    second: BodyFrame,
    base: ca.SX,
    base_names: Sequence[str] = ("along x", "along y", "along z"),
) -> Iterator[LoopEquation]:
    """The equations of a joint between two frames (Nikravesh, sec. 7.2).

    :param base: (3, 3) the axes along which a shared point is compared, in ground's axes.
    """
    closing = _ClosingJoint(joint, first, second, second.position - first.position, base, base_names)
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
            yield LoopEquation("angle of the axes", cosine - float(product(axis, second)), "")
        case "advance by the lead":
            yield LoopEquation("advance", _screw_advance(closing.joint, closing.first, closing.second)[0])
        case _:
            assert_never(condition)


def _screw_advance(joint: Joint, first: BodyFrame, second: BodyFrame) -> tuple[ca.SX, ca.SX]:
    """The displacement less that of the angle, written with sines, so that whole turns make no difference.

    Half a turn does: there the second value, otherwise positive, is negative.
    """
    pitch, (x, y) = joint.lead / (2.0 * np.pi), perpendiculars(joint.axis)

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


AXIS_NAMES = ("across the axis, 1", "across the axis, 2", "along the axis")


@dataclass(frozen=True, eq=False)
class IteratedNormal:
    """A vector (3,) that rows depend on, and that is found by iteration, of which no derivatives are formed.

    `symbols` stand for it in the rows. `value` is the vector, and `step` one more step of
    the iteration from `symbols`, both in the symbols of the parts; the rate of the step is that of the vector.
    """

    symbols: ca.SX
    value: ca.SX
    step: ca.SX

    def inserted(self, expression: ca.SX) -> ca.SX:
        """An expression with the value in place of the symbols."""
        return ca.substitute([expression], [self.symbols], [self.value])[0]


@dataclass(frozen=True, eq=False)
class ConstraintRow:
    """One scalar constraint of the joint or constraint at `owner`, whose constrained quantity is `quantity`.

    A holonomic row has a `position` that stays zero, in `unit`; a nonholonomic row has a `velocity`, linear in the
    velocities of the parts. `factors` are those of joint coordinates, which the position does not include, and neither
    the expression `less` of coordinates and time, which is subtracted. A row with an iterated `normal`, on which both
    may depend, has a position, and a velocity that is its rate.
    """

    owner: Location
    quantity: str
    position: ca.SX | None = None
    velocity: ca.SX | None = None
    unit: str = "m"
    factors: Mapping[str, float] = field(default_factory=dict)
    less: TimeExpression | None = None
    normal: IteratedNormal | None = None

    @property
    def name(self) -> str:
        """The owner's name and the constrained quantity."""
        return f"{self.owner[1]}: {self.quantity}"


def constraint_rows(
    mechanism: Mechanism, bodies: BodySymbols, time: ca.SX, own_axes: Collection[str] = ()
) -> list[ConstraintRow]:
    """The rows of all closing joints, welds of split parts and constraints; for one-sided ones see `one_sided_rows`.

    The gap of a loop is measured along the axes of the part from which both branches of the loop start: there a plane
    loop stays in its plane, however that plane moves. For the joints in `own_axes` it is measured along the axes of
    one of the joint's ends, for loops that rotate about an axis of that part.

    :param time: the symbol of time in the expressions of the constraints.
    """
    rows = [
        ConstraintRow(("joints", joint.name), equation.quantity, equation.position, unit=equation.unit)
        for joint in mechanism.closures.values()
        for equation in _loop(joint, bodies, joint.name in own_axes)
    ]
    writer = RowWriter(bodies, time)
    return rows + [row for constraint in two_sided(mechanism.constraints) for row in writer.rows_of(constraint)]


@dataclass(frozen=True, slots=True)
class SurfaceGap:
    """A point at a surface: its distance in m, its velocity (3,) along the surface, and two directions (3,) there.

    The unit `normal` (3,) is the direction in which the distance grows, and `point` (3,) the point in ground's frame.
    """

    position: ca.SX
    point: ca.SX
    normal: ca.SX
    slip: ca.SX
    sides: list[ca.SX]


class RowWriter:
    """Writes the rows of constraints on the symbols of the parts."""

    def __init__(self, bodies: BodySymbols, time: ca.SX) -> None:
        self._bodies, self._time = bodies, time

    def frame(self, attachment: Attachment) -> BodyFrame:
        """The frame at a point, with its part's axes."""
        return self._bodies.frame(attachment.part, attachment.point)

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
            case c.Clutch():
                yield ConstraintRow(_owner(record), "speed", ca.SX(1, 1), unit="", factors=record.factors)
            case _:
                assert_never(record)

    def _distance(self, record: c.Distance) -> ConstraintRow:
        """(l² - length²) / 2 length: as large as l - length near zero, and smooth where the points meet."""
        length = function_of(record.length, {"t": self._time})
        line = self.frame(record.second).position - self.frame(record.first).position
        return ConstraintRow(_owner(record), "length", (ca.dot(line, line) - length * length) / (2.0 * length))

    def _cable(self, record: c.Cable) -> ConstraintRow:
        total = -function_of(record.length, {"t": self._time})
        for one, other in pairwise(record.points):
            total += ca.norm_2(self.frame(other).position - self.frame(one).position)
        return ConstraintRow(_owner(record), "length", total)

    def _flat(self, record: c.Flat) -> Iterator[ConstraintRow]:
        base = self.frame(record.base)
        line = self.frame(record.point).position - base.position
        for number, normal in enumerate(record.normals):
            quantity = (
                "distance from the plane" if len(record.normals) == 1 else f"distance from the line, {number + 1}"
            )
            yield ConstraintRow(_owner(record), quantity, ca.dot(base.rotation @ constant(normal), line))

    def _surface(self, record: c.Surface) -> Iterator[ConstraintRow]:
        base = self._bodies.frame(record.base.part, record.base.point, record.axes)
        point = base.rotation.T @ (self.frame(record.point).position - base.position)
        names = {"x": point[0], "y": point[1], "z": point[2], "t": self._time}
        for number, equation in enumerate(record.equations):
            quantity = "equation" if len(record.equations) == 1 else f"equation {number + 1}"
            yield ConstraintRow(_owner(record), quantity, function_of(equation, names), unit="")

    def surface_gap(self, record: c.Surface) -> SurfaceGap:
        """The distance of the point from a surface, to first order, and its slip along it."""
        base, point = self._bodies.frame(record.base.part, record.base.point, record.axes), self.frame(record.point)
        x = ca.SX.sym("x", 3)
        value = function_of(record.equations[0], {"x": x[0], "y": x[1], "z": x[2], "t": self._time})
        gradient = ca.gradient(value, x)
        size = ca.norm_2(gradient)
        normal = gradient / size
        sides = perpendiculars_of(normal)
        at = base.rotation.T @ (point.position - base.position)
        distance, normal, *sides = ca.substitute([value / size, normal, *sides], [x], [at])
        slip = point.velocity - velocity_at(base, point.position)
        sides = [base.rotation @ side for side in sides]
        return SurfaceGap(distance, point.position, base.rotation @ normal, slip, sides)

    def _coupling(self, record: c.Coupling) -> ConstraintRow:
        unit = "m" if record.kind in ("gear", "rack") else ""
        if record.value.state:
            return ConstraintRow(_owner(record), "coordinates", ca.SX(1, 1), None, unit, record.factors, record.value)
        value = function_of(record.value, {"t": self._time})
        return ConstraintRow(_owner(record), "coordinates", -value, unit=unit, factors=record.factors)

    def _rolling(self, record: c.Rolling) -> Iterator[ConstraintRow]:
        """Contact, and no slip at the contact along two directions of the plane (Huston & Liu, sec. 11.10.5)."""
        wheel, plane = self.frame(record.center), self.frame(record.plane)
        arm, normal, directions = self.rolling_contact(record)
        contact = wheel.position + arm
        yield ConstraintRow(_owner(record), "contact", ca.dot(normal, contact - plane.position))
        slip = wheel.velocity + ca.cross(wheel.omega, arm) - velocity_at(plane, contact)
        for number, direction in enumerate(directions):
            yield ConstraintRow(_owner(record), f"slip {number + 1}", velocity=ca.dot(direction, slip))

    def rolling_contact(self, record: c.Rolling) -> tuple[ca.SX, ca.SX, list[ca.SX]]:
        """From a wheel center to its point nearest to the plane (3,), the normal (3,), and two directions (3,) across.

        The directions of a wheel are forward and sideways. Wheels on one axle then share a row in any position.
        """
        wheel, plane = self.frame(record.center), self.frame(record.plane)
        normal = ca.sparsify(plane.rotation @ constant(record.normal))
        up, directions = normal, [plane.rotation @ constant(side) for side in perpendiculars(record.normal)]
        if record.axis is not None:
            axis = wheel.rotation @ constant(record.axis)
            in_disc = normal - axis * ca.dot(normal, axis)
            size = ca.sqrt(ca.dot(in_disc, in_disc))
            up, forward = in_disc / size, ca.cross(axis, normal) / size
            directions = [forward, ca.cross(normal, forward)]
        return -record.radius * up, normal, directions

    def _knife_edge(self, record: c.KnifeEdge) -> ConstraintRow:
        blade, plane = self.frame(record.point), self.frame(record.plane)
        normal = plane.rotation @ constant(record.normal)
        sideways = ca.cross(normal, blade.rotation @ constant(record.direction))
        slip = blade.velocity - velocity_at(plane, blade.position)
        return ConstraintRow(_owner(record), "sideways motion", velocity=ca.dot(sideways / ca.norm_2(sideways), slip))


def _owner(record: c.Constraint) -> Location:
    return "constraints", record.name


def perpendiculars_of(normal: ca.SX) -> list[ca.SX]:
    """Two unit vectors (3,) perpendicular to a unit `normal` (3,) and to each other (Duff et al. 2017)."""
    x, y, z = ca.vertsplit(ca.densify(normal))
    sign = ca.if_else(z >= 0.0, 1.0, -1.0)
    a = -1.0 / (sign + z)
    b = x * y * a
    return [ca.vertcat(1.0 + sign * x * x * a, sign * b, -sign * x), ca.vertcat(b, sign + y * y * a, -y)]


def velocity_at(frame: BodyFrame, point: ca.SX) -> ca.SX:
    """The velocity (3,) of a point that is fixed in a frame's part, in ground's axes."""
    return frame.velocity + ca.cross(frame.omega, point - frame.position)


def _loop(joint: Joint, bodies: BodySymbols, own_axes: bool) -> Iterator[LoopEquation]:
    """The equations of a closing joint, along axes of the common carrier or of one of its ends.

    Of axes of an end, one is the joint's axis: along it, the ends of a plane loop always coincide.
    """
    first, second = joint_frames(joint, bodies)
    carrier = bodies.common_carrier(joint.parent, joint.child)
    if not own_axes:
        return loop_equations(joint, first, second, bodies.frame(carrier, np.zeros(3)).rotation)
    if joint.parent == carrier and joint.type != "universal":
        first, second = second, first
    if "parallel axes" in joint.kind.loop_conditions and np.count_nonzero(joint.axis) > 1:
        return loop_equations(joint, first, second, first.rotation @ constant(rot.aligning_z(joint.axis)), AXIS_NAMES)
    return loop_equations(joint, first, second, first.rotation)
