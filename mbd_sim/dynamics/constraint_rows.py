"""Constraints as scalar equations, written on the symbols of the parts (Géradin & Rixen; Nikravesh, ch. 7).

A holonomic row is a function of the poses that stays zero; its velocity follows by differentiation. A nonholonomic row
is a velocity that stays zero.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import assert_never

import casadi as ca
import numpy as np

from mbd_sim.dynamics.body_symbols import BodyFrame, BodySymbols
from mbd_sim.dynamics.loop_equations import LoopEquation, joint_frames, loop_equations, perpendiculars
from mbd_sim.dynamics.spatial_algebra import constant
from mbd_sim.dynamics.time_functions import function_of
from mbd_sim.geometry import rotation as rot
from mbd_sim.mechanism import constraints as c
from mbd_sim.mechanism.expression import TimeExpression
from mbd_sim.mechanism.one_sided import two_sided
from mbd_sim.mechanism.records import Attachment, Joint, Mechanism
from mbd_sim.mechanism.source import Location

AXIS_NAMES = ("across the axis, 1", "across the axis, 2", "along the axis")


@dataclass(frozen=True, eq=False)
class ConstraintRow:
    """One scalar constraint of the joint or constraint at `owner`, whose constrained quantity is `quantity`.

    A holonomic row has a `position` that stays zero, in `unit`; a nonholonomic row has a `velocity`, linear in the
    velocities of the parts. `factors` are those of joint coordinates, which the position does not include, and neither
    the expression `less` of coordinates and time, which is subtracted.
    """

    owner: Location
    quantity: str
    position: ca.SX | None = None
    velocity: ca.SX | None = None
    unit: str = "m"
    factors: Mapping[str, float] = field(default_factory=dict)
    less: TimeExpression | None = None

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
