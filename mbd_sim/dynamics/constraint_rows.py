"""Constraints as scalar rows, written on the symbols of the bodies (Géradin & Rixen; Nikravesh, ch. 7).

A holonomic row is a function of the poses that stays zero; its velocity is found by differentiation. A nonholonomic
one is a velocity that stays zero.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import assert_never

import casadi as ca
import numpy as np

from mbd_sim.dynamics.body_symbols import Bodies, Frame
from mbd_sim.dynamics.spatial_algebra import constant
from mbd_sim.dynamics.time_functions import function_of
from mbd_sim.geometry import rotation as rot
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism import constraints as c
from mbd_sim.mechanism.records import Attachment, Joint, Mechanism
from mbd_sim.mechanism.source import Location


@dataclass(frozen=True, eq=False)
class Row:
    """One scalar constraint of the joint or constraint at `owner`, which `what` describes.

    A holonomic one has a `position` that stays zero, in `unit`, a nonholonomic one a `velocity`, linear in the twists.
    `factors` are those of joint coordinates, which the position leaves out.
    """

    owner: Location
    what: str
    position: ca.SX | None = None
    velocity: ca.SX | None = None
    unit: str = "m"
    factors: Mapping[str, float] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The owner's name and what is constrained."""
        return f"{self.owner[1]}: {self.what}"


def constraint_rows(mechanism: Mechanism, bodies: Bodies, clock: ca.SX, turning: Collection[str] = ()) -> list[Row]:
    """The rows of all loops and constraints; `clock` is the time in the constraints' own expressions.

    The gap of a loop is measured along the axes of the part from which both ways around it start, in which a plane
    loop stays in its plane however it is carried about; for the joints in `turning` along those of one of its ends, for
    loops that turn about an axis of their own.
    """
    writer = _Writer(bodies, clock)
    rows = [
        Row(("joints", joint.name), what, position, unit="" if what.startswith(("tilt", "rotation", "angle")) else "m")
        for joint in mechanism.closing.values()
        for what, position in _loop(joint, bodies, joint.name in turning)
    ]
    return rows + [row for constraint in mechanism.constraints for row in writer.constraint(constraint)]


class _Writer:
    def __init__(self, bodies: Bodies, clock: ca.SX) -> None:
        self._bodies, self._clock = bodies, clock

    def _at(self, place: Attachment) -> Frame:
        return self._bodies.frame(place.part, place.point)

    def constraint(self, record: c.Constraint) -> Iterator[Row]:
        """The rows of a constraint."""
        owner: Location = ("constraints", record.name)
        match record:
            case c.Distance(first=first, second=second, length=expression):
                length = function_of(expression, {"t": self._clock})
                line = self._at(second).position - self._at(first).position
                yield Row(owner, "length", (ca.dot(line, line) - length * length) / (2.0 * length))
            case c.Cable(points=points, length=expression):
                total = -function_of(expression, {"t": self._clock})
                for one, other in pairwise(points):
                    total += ca.norm_2(self._at(other).position - self._at(one).position)
                yield Row(owner, "length", total)
            case c.Flat(point=point, base=base, normals=normals):
                frame = self._bodies.frame(base.part, base.point)
                line = self._at(point).position - frame.position
                for number, normal in enumerate(normals):
                    what = "distance from the plane" if len(normals) == 1 else f"distance from the line, {number + 1}"
                    yield Row(owner, what, ca.dot(frame.rotation @ constant(normal), line))
            case c.Surface(point=point, base=base, axes=axes, equations=equations):
                frame = self._bodies.frame(base.part, base.point, axes)
                place = frame.rotation.T @ (self._at(point).position - frame.position)
                names = {"x": place[0], "y": place[1], "z": place[2], "t": self._clock}
                for number, equation in enumerate(equations):
                    what = "equation" if len(equations) == 1 else f"equation {number + 1}"
                    yield Row(owner, what, function_of(equation, names), unit="")
            case c.Coupling(factors=factors, value=expression):
                value = function_of(expression, {"t": self._clock})
                unit = "m" if record.kind in ("gear", "rack") else ""
                yield Row(owner, "coordinates", -value, unit=unit, factors=factors)
            case c.Rolling():
                yield from self._rolling(owner, record)
            case c.KnifeEdge(point=point, direction=direction, plane=plane, normal=normal):
                blade, carrier = self._at(point), self._at(plane)
                up = carrier.rotation @ constant(normal)
                across = ca.cross(up, blade.rotation @ constant(direction))
                slip = blade.velocity - _carried(carrier, blade.position)
                yield Row(owner, "sideways motion", velocity=ca.dot(across / ca.norm_2(across), slip))

    def _rolling(self, owner: Location, record: c.Rolling) -> Iterator[Row]:
        """Contact, and no slip at the contact in two directions of the plane (Huston & Liu 11.10.5).

        Those of a wheel are ahead and aside, so that wheels on one axle share one of them wherever they turn to.
        """
        wheel, plane = self._at(record.center), self._at(record.plane)
        up = ca.sparsify(plane.rotation @ constant(record.normal))
        down, along = up, [plane.rotation @ constant(side) for side in rot.aligning_z(record.normal)[:, :2].T]
        if record.axis is not None:
            axis = wheel.rotation @ constant(record.axis)
            leaning = up - axis * ca.dot(up, axis)
            size = ca.sqrt(ca.dot(leaning, leaning))
            down, ahead = leaning / size, ca.cross(axis, up) / size
            along = [ahead, ca.cross(up, ahead)]
        arm = -record.radius * down
        contact = wheel.position + arm
        yield Row(owner, "contact", ca.dot(up, contact - plane.position))
        slip = wheel.velocity + ca.cross(wheel.omega, arm) - _carried(plane, contact)
        for number, direction in enumerate(along):
            yield Row(owner, f"slip {number + 1}", velocity=ca.dot(direction, slip))


def loop_ends(joint: Joint, bodies: Bodies) -> tuple[Frame, Frame]:
    """The two frames that a joint connects."""
    first, second = joint.parent_pose, joint.child_pose
    return (
        bodies.frame(joint.parent, first.position, first.rotation),
        bodies.frame(joint.child, second.position, second.rotation),
    )


def _carried(frame: Frame, point: ca.SX) -> ca.SX:
    """The velocity (3,) of a point that moves with a frame."""
    return frame.velocity + ca.cross(frame.omega, point - frame.position)


def _loop(joint: Joint, bodies: Bodies, turns: bool) -> Iterator[tuple[str, ca.SX]]:
    """The equations of a closing joint, along axes that stay or turn with the loop."""
    first, second = loop_ends(joint, bodies)
    base = bodies.base(joint.parent, joint.child)
    if not turns:
        return loop_equations(joint, first, second, bodies.frame(base, np.zeros(3)).rotation)
    if joint.parent == base and joint.type != "universal":
        first, second = second, first
    return loop_equations(joint, first, second, first.rotation)


def loop_equations(joint: Joint, first: Frame, second: Frame, base: ca.SX) -> Iterator[tuple[str, ca.SX]]:
    """What stays zero for a joint between two frames, and its name (Nikravesh, sec. 7.2).

    Shared points are compared along the axes `base` (3, 3); all other directions belong to the first frame.
    """
    gap = second.position - first.position
    axis = joint.axis if joint.axis.any() else np.array([0.0, 0.0, 1.0])
    across = rot.aligning_z(axis)[:, :2].T

    def along(direction: np.ndarray) -> ca.SX:
        return ca.sparsify(first.rotation @ constant(direction))

    def shared_point() -> Iterator[tuple[str, ca.SX]]:
        local = ca.sparsify(base.T @ gap)
        return ((f"displacement along {name}", local[place]) for place, name in enumerate("xyz"))

    def shared_line() -> Iterator[tuple[str, ca.SX]]:
        return ((f"displacement across the axis, {n + 1}", ca.dot(along(side), gap)) for n, side in enumerate(across))

    def parallel() -> Iterator[tuple[str, ca.SX]]:
        turned = ca.sparsify(second.rotation @ constant(axis))
        return ((f"tilt of the axis, {n + 1}", ca.dot(along(side), turned)) for n, side in enumerate(across))

    def same_axes() -> Iterator[tuple[str, ca.SX]]:
        for name, one, other in (("x", 1, 2), ("y", 2, 0), ("z", 0, 1)):
            yield f"rotation about {name}", ca.dot(first.rotation[:, one], second.rotation[:, other])

    for condition in joint.kind.loop_conditions:
        match condition:
            case "coincident points":
                yield from shared_point()
            case "point on axis":
                yield from shared_line()
            case "point in plane":
                yield "displacement along the normal", ca.dot(along(axis), gap)
            case "parallel axes":
                yield from parallel()
            case "equal orientations":
                yield from same_axes()
            case "constant angle between axes":
                cosine = float(joint.axis @ joint.second)
                cross = ca.dot(along(joint.axis), ca.sparsify(second.rotation @ constant(joint.second)))
                yield "angle of the axes", cross - cosine
            case "advance by the lead":
                yield "advance", _advance(joint, first, second)[0]
            case _:
                assert_never(condition)


def _advance(joint: Joint, first: Frame, second: Frame) -> tuple[ca.SX, ca.SX]:
    """The displacement less what the angle gives, by sines, so that whole turns make no difference.

    Half a turn makes one: there the other value, usually positive, is negative.
    """
    pitch, (one, two) = joint.lead / (2.0 * np.pi), rot.aligning_z(joint.axis)[:, :2].T

    def along(direction: Array) -> ca.SX:
        return ca.sparsify(first.rotation @ constant(direction))

    displacement, side = ca.dot(along(joint.axis), second.position - first.position), second.rotation @ constant(one)
    if pitch == 0.0:
        return displacement, ca.SX(1)
    cosine, sine, angle = ca.dot(along(one), side), ca.dot(along(two), side), displacement / pitch
    return pitch * (ca.sin(angle) * cosine - ca.cos(angle) * sine), ca.cos(angle) * cosine + ca.sin(angle) * sine


def senses(joint: Joint, first: Frame, second: Frame) -> list[ca.SX]:
    """What is positive where a loop is closed the right way round, not with an axis or a nut turned over."""
    conditions = joint.kind.loop_conditions
    axes = np.zeros((0, 3))
    if "equal orientations" in conditions:
        axes = np.eye(3)
    elif "parallel axes" in conditions:
        axes = joint.axis[None, :]
    found = [ca.dot(first.rotation @ constant(axis), second.rotation @ constant(axis)) for axis in axes]
    return [*found, _advance(joint, first, second)[1]] if "advance by the lead" in conditions else found
