"""The equations of a joint that closes a loop, written on two frames (Nikravesh, sec. 7.2)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import assert_never

import casadi as ca
import numpy as np

from mbd_sim.dynamics.body_symbols import BodyFrame, BodySymbols
from mbd_sim.dynamics.spatial_algebra import constant
from mbd_sim.geometry import rotation as rot
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.joint_types import LoopCondition
from mbd_sim.mechanism.records import Joint


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
            yield LoopEquation("angle of the axes", cosine - float(axis @ second), "")
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
