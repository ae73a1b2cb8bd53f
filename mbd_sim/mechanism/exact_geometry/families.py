"""Which axes around a loop are meant to be parallel, to be perpendicular, to coincide, or to meet in a point.

Axes that are parallel stay so in all positions if nothing turns between them: on one part, or across sliders. Lines
that meet in one point, or coincide, stay so if all of the loop do.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mbd_sim.base.geometry import rotation as rot
from mbd_sim.base.geometry.pose import Array
from mbd_sim.mechanism.elements.parts import Joint
from mbd_sim.mechanism.exact_geometry.loop_positions import Placement

Key = tuple[str, int]  # a joint and the number of its axis: 1 for the second one of a universal joint


@dataclass(frozen=True, eq=False)
class Axis:
    """An axis of a joint in ground's frame; `turns` says whether the joint rotates about it.

    A joint that turns about all axes has one without a direction.
    """

    key: Key
    direction: Array
    point: Array
    turns: bool


def axes_of(joint: Joint, place: Placement, to_child: bool = True) -> list[Axis]:
    """The axes of a joint in the order in which a loop crosses them."""
    if joint.type == "fixed":
        return []
    first, second = place.frames(joint)
    one, other = first.rotation @ joint.axis, second.rotation @ joint.axis
    middle = 0.5 * (first.position + second.position)
    if not joint.axis.any():
        return [Axis((joint.name, 0), np.zeros(3), middle, True)]
    if joint.type == "universal":
        last = second.rotation @ joint.second
        found = [Axis((joint.name, 0), one, middle, True), Axis((joint.name, 1), last, middle, True)]
        return found if to_child else found[::-1]
    return [Axis((joint.name, 0), rot.unit(one + other), middle, joint.kind.rotates)]


@dataclass(frozen=True, eq=False)
class Family:
    """What the axes of a loop have in common: pairs of `parallel` axes, pairs (slider, axis) of `perpendicular` ones.

    If `common` is a line, all axes and points of the `joined` joints are on it; if it is a point, all go through it.
    """

    parallel: Sequence[tuple[Key, Key]] = ()
    perpendicular: Sequence[tuple[Key, Key]] = ()
    common: str = ""
    joined: Sequence[str] = ()


def families(
    around: Sequence[tuple[Joint, bool]], place: Placement, size: float, tolerance: float, massless: str = ""
) -> Iterator[Family]:
    """The families to which a loop belongs within a tolerance in rad and parts of its size, the strictest one first.

    :param massless: the part of a guide in the loop. Where the rest of the loop does not move one of the points that
        the guide holds, it is of no account how it holds them.
    """
    yield from _with_common_axes(around, place, size, tolerance)
    for guiding in [joint for joint, _ in around if massless in (joint.parent, joint.child)]:
        rest = [(joint, to_child) for joint, to_child in around if joint is not guiding]
        yield from _with_common_axes(rest, place, size, tolerance)
    yield _parallel_runs(_axes(around, place), tolerance)


def _axes(around: Sequence[tuple[Joint, bool]], place: Placement) -> list[Axis]:
    return [axis for joint, to_child in around for axis in axes_of(joint, place, to_child)]


def _with_common_axes(
    around: Sequence[tuple[Joint, bool]], place: Placement, size: float, tolerance: float
) -> Iterator[Family]:
    """The families of joints that are all on a line, or through a point."""
    axes = _axes(around, place)
    by_name, reach = {joint.name: joint for joint, _ in around}, size * tolerance
    straight = all(one.kind.keeps_line or one.type in ("prismatic", "spherical", "fixed") for one in by_name.values())
    if straight and _coincide(axes, by_name, reach, tolerance):
        directed = [axis.key for axis in axes if axis.direction.any()]
        yield Family([(directed[0], key) for key in directed[1:]], common="line", joined=tuple(by_name))
    if all(one.kind.keeps_point for one in by_name.values()):
        center = meeting_point(axes)
        if center is not None and all(distance_of(axis, center) <= reach for axis in axes):
            yield Family(common="point", joined=tuple(by_name))


def _coincide(axes: Sequence[Axis], joints: Mapping[str, Joint], reach: float, angle: float) -> bool:
    """Whether all axes have the same direction, and all of hinges and all points are on one line."""
    lines = [axis for axis in axes if joints[axis.key[0]].kind.keeps_line]
    if not lines:
        return False
    line = lines[0]
    directed = [axis for axis in axes if axis.direction.any()]
    if any(np.linalg.norm(np.cross(line.direction, axis.direction)) > angle for axis in directed):
        return False
    return all(distance_of(line, axis.point) <= reach for axis in axes if joints[axis.key[0]].type != "prismatic")


def distance_of(axis: Axis, point: Array) -> float:
    """The distance of a point (3,) from an axis, or from the point of one without a direction, m."""
    arm = point - axis.point
    return float(np.linalg.norm(np.cross(axis.direction, arm) if axis.direction.any() else arm))


def meeting_point(axes: Sequence[Axis]) -> Array | None:
    """The point (3,) nearest to lines; None if they are parallel, or there are none."""
    if not axes:
        return None
    across = [np.eye(3) - np.outer(axis.direction, axis.direction) for axis in axes]
    matrix = np.sum(across, axis=0)
    if np.linalg.eigvalsh(matrix)[0] < 1e-2:
        return None
    right = np.sum([projection @ axis.point for projection, axis in zip(across, axes, strict=True)], axis=0)
    return np.asarray(np.linalg.solve(matrix, right))


def _parallel_runs(axes: Sequence[Axis], tolerance: float) -> Family:
    """Neighbors among the axes that turn, and sliders beside these, or beside sliders."""
    parallel, perpendicular = [], []
    for index, axis in enumerate(axes):
        for other in _neighbors(axes, index):
            if not axis.direction.any() or not other.direction.any():
                continue
            cosine = abs(float(axis.direction @ other.direction))
            sine = float(np.linalg.norm(np.cross(axis.direction, other.direction)))
            if sine <= tolerance:
                parallel.append((other.key, axis.key))
            elif cosine <= tolerance and axis.turns != other.turns:
                slider, turning = (other, axis) if axis.turns else (axis, other)
                perpendicular.append((slider.key, turning.key))
    return Family(parallel, perpendicular)


def _neighbors(axes: Sequence[Axis], index: int) -> Iterator[Axis]:
    """The axes after one, up to the first that turns."""
    for step in range(1, len(axes)):
        other = axes[(index + step) % len(axes)]
        yield other
        if other.turns:
            return
