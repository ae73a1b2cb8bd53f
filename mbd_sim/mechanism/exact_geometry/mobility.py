"""The nearest geometry with which loops move that are locked, or stay open, by digits that nobody meant.

Overconstrained loops such as three cranks of equal length, or Bennett's four hinges, of which no two axes are parallel,
move only with exact lengths and directions. Whether a file means such a loop is found numerically. If the conditions of
nearly redundant directions are left out, the loops move along a path. If these directions stay nearly redundant on all
of it, the nearest geometry is sought with which all loops are closed at several places of the path: by the Gauss-Newton
method, with the least changes of the written numbers, each in units of its last digit. That geometry is meant only if
the changes are within the digits.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mbd_sim.base.geometry import rotation as rot
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.mechanism.elements.parts import Joint
from mbd_sim.mechanism.exact_geometry.digits import Digits, half_unit_of_angles
from mbd_sim.mechanism.exact_geometry.loop_positions import NEARLY, Loops, Placement, start_of
from mbd_sim.mechanism.mechanism import Mechanism

PLACES, STRIDE = 12, 0.5  # on the path, and the distance between two of them, rad or parts of the size
ROUND_OFF, CLOSED = 1e-13, 1e-14  # a singular value or a gap that is round-off, and one that is closed
_Places = Sequence[Placement]
PARALLEL = 1e-12  # the sine of the angle between axes that are parallel
MOST_TURN = 4.0  # rad, by changes of 1 of the components of a quaternion
WITHIN = 1.0 - 1e-6  # half units of the last digit
ITERATIONS, ATTEMPTS, LAWSON = 30, 3, 100


def mobile(written: Mechanism, loops: Loops) -> dict[str, Joint]:
    """The joints that are to be moved so that the loops of a mechanism move, by their names; none if nothing is.

    :param loops: those of the mechanism with exact directions of axes.
    """
    place, mended = loops.closed, loops.mechanism
    if place is None or not _is_nearly_redundant(loops, [place], _rank(loops, place)):
        return {}
    turned = {name: _turned(joint, mended.all_joints[name]) for name, joint in written.all_joints.items()}
    mechanism = _without_drives(with_joints(written, turned))
    loops = Loops(mechanism)
    start = loops.closed
    if start is None or not _is_nearly_redundant(loops, [start], _rank(loops, start)):
        return {}
    places = _path(loops, start)
    rank = max((_rank(loops, place) for place in places), default=0)
    places = [place for place in places if _rank(loops, place) == rank]
    if len(places) < PLACES // 2 or not _is_nearly_redundant(loops, places, rank):
        return {}
    found = _Fit(mechanism, rank).changed(places)
    return {name: _placed(mended.all_joints[name], joint) for name, joint in found.items()}


def _placed(joint: Joint, other: Joint) -> Joint:
    """A joint with the frames of another one."""
    return dataclasses.replace(joint, parent_pose=other.parent_pose, child_pose=other.child_pose)


def _without_drives(mechanism: Mechanism) -> Mechanism:
    def freed(joint: Joint) -> Joint:
        fixed = (True,) * joint.kind.nv
        return dataclasses.replace(joint, drive=(), position=start_of(joint), fixed_in_assembly=fixed)

    joints = {name: freed(joint) if joint.drive else joint for name, joint in mechanism.joints.items()}
    return dataclasses.replace(mechanism, joints=joints)


def _path(loops: Loops, start: Placement) -> list[Placement]:
    """Places along the directions in which the loops move if what is nearly redundant is left out."""
    random = np.random.default_rng(0)
    places, ahead = [start], np.zeros(0)
    for _ in range(PLACES):
        _, slopes = loops.gaps(places[-1])
        _, sizes, right = np.linalg.svd(slopes)
        free = right[_large(sizes) :]
        wanted = random.normal(size=slopes.shape[1]) if not len(ahead) else ahead
        along = free.T @ (free @ wanted)
        if not along.any():
            break
        ahead = along / np.max(np.abs(along))
        place = loops.moved_on(places[-1], STRIDE * ahead)
        if np.max(np.abs(loops.gaps(place)[0])) > NEARLY or place.is_near(places[-1]):
            break
        places.append(place)
    return places


def _large(sizes: Array) -> int:
    return int(np.sum(sizes > NEARLY * np.max(sizes, initial=0.0)))


def _rank(loops: Loops, place: Placement) -> int:
    return _large(np.linalg.svd(loops.gaps(place)[1])[1])


def _is_nearly_redundant(loops: Loops, places: _Places, rank: int) -> bool:
    """Whether equations beyond the rank are redundant only nearly, or are not satisfied, at some place."""
    for place in places:
        gaps, slopes = loops.gaps(place)
        left = np.linalg.svd(slopes)[0][:, rank:]
        if max(np.max(np.abs(left.T @ slopes), initial=0.0), np.max(np.abs(left.T @ gaps), initial=0.0)) > ROUND_OFF:
            return True
    return False


class _Fit:
    """Gauss-Newton for the numbers of joint frames with which loops are closed at all places of a path."""

    def __init__(self, mechanism: Mechanism, rank: int) -> None:
        massless = {joint.outboard_part for joint in mechanism.tree_joints()} - {*mechanism.bodies}
        self._mechanism = mechanism
        self._rank = rank
        names = dict.fromkeys(joint.name for around in Loops(mechanism).around.values() for joint, _ in around)
        self._joints = [mechanism.all_joints[name] for name in names]
        self._steps = _steps(self._joints, mechanism.source.data, massless)

    def changed(self, places: _Places) -> dict[str, Joint]:
        """The joints with the numbers that are found; none if they are not within their digits."""
        numbers = np.zeros(self._steps.shape[1])  # the changes in half units of their last digits
        if not len(numbers):
            return {}
        for _ in range(ATTEMPTS):
            numbers, places, rows, gap = self._closing(numbers, places)
            if gap > ROUND_OFF or np.max(np.abs(numbers)) <= WITHIN:
                break
            numbers = _evened(rows, numbers)
        if gap > ROUND_OFF or np.max(np.abs(numbers)) > WITHIN:
            return {}
        mechanism = self._with(numbers)
        return {name: mechanism.all_joints[name] for name in (joint.name for joint in self._joints)}

    def _closing(self, numbers: Array, places: _Places) -> tuple[Array, _Places, Array, float]:
        """Numbers nearby with which loops close at all places, the independent equations there, and the gap left."""
        best, share, change, rows = np.inf, 0.1, 0.0 * numbers, np.zeros((0, len(numbers)))
        for _ in range(ITERATIONS):
            loops = Loops(self._with(numbers + change))
            found = [loops.closed_from(place) for place in places]
            slopes, open_by = self._equations(loops, found)
            gap = float(np.max(np.abs(open_by)))
            if gap < best:
                numbers, places, best, share = numbers + change, found, gap, 0.5 * share
                left, sizes, right = np.linalg.svd(slopes, full_matrices=False)
                along = left.T @ open_by
            else:
                share *= 8.0
            if best < CLOSED:
                break
            # Equations that depend on the others with exact geometry do so up to the error that it still has. Where two
            # kinds of linkages that move meet, the slopes vanish in proportion to that error.
            used = sizes > sizes[0] * min(1e-3, max(5.0 * best, share * np.sqrt(best)))
            rows = right[used]
            change = -rows.T @ (along[used] / sizes[used])
        return numbers, places, rows, best

    def _with(self, numbers: Array) -> Mechanism:
        steps = (self._steps @ numbers).reshape(-1, 12)
        new = {joint.name: _moved(joint, step) for joint, step in zip(self._joints, steps, strict=True)}
        return with_joints(self._mechanism, new)

    def _equations(self, loops: Loops, places: _Places) -> tuple[Array, Array]:
        """By how much the redundant equations are open at all places, and their slopes by the numbers."""
        all_rows, all_gaps = [], []
        for place in places:
            gaps, slopes = loops.gaps(place)
            left = np.linalg.svd(slopes)[0][:, self._rank :]
            all_rows.append(left.T @ (self._slopes(loops, place) @ self._steps))
            all_gaps.append(left.T @ gaps)
        return np.vstack(all_rows), np.concatenate(all_gaps)

    def _slopes(self, loops: Loops, place: Placement) -> Array:
        """The slopes (m, n) of the gaps by the numbers."""
        moves = {}
        for number, joint in enumerate(self._joints):
            twists = []
            frames = place.frames(joint)
            for sign, part, frame in zip((1.0, -1.0), (joint.parent, joint.child), frames, strict=True):
                axes = sign * place.poses[part].rotation.T
                turns = np.hstack([axes, np.cross(frame.position, axes)])
                twists += [np.hstack([np.zeros((3, 3)), axes]), turns]
            moves[joint.name] = slice(12 * number, 12 * number + 12), np.vstack(twists).T
        return loops.slopes(place, moves)[1]


def _evened(rows: Array, numbers: Array) -> Array:
    """Numbers that satisfy the same equations to first order, with the smallest largest one (Lawson's algorithm)."""
    wanted, weights = rows @ numbers, np.ones(len(numbers))
    for _ in range(LAWSON):
        weights = np.maximum(weights * np.abs(numbers), 1e-9)
        weights /= np.max(weights)
        free = weights**-0.5
        numbers = free * np.linalg.lstsq(rows * free, wanted, rcond=None)[0]
    return numbers


def with_joints(mechanism: Mechanism, new: Mapping[str, Joint]) -> Mechanism:
    """The mechanism with new joints in place of those with these names."""

    def of(joints: Mapping[str, Joint]) -> dict[str, Joint]:
        return {name: new.get(name, joint) for name, joint in joints.items()}

    return dataclasses.replace(mechanism, joints=of(mechanism.joints), closing=of(mechanism.closing))


def _turned(joint: Joint, other: Joint) -> Joint:
    """A joint in its place, with the directions of another one."""
    pairs = ((joint.parent_pose, other.parent_pose), (joint.child_pose, other.child_pose))
    parent, child = (Pose(pose.position, turned.rotation) for pose, turned in pairs)
    return dataclasses.replace(other, parent_pose=parent, child_pose=child)


def _steps(joints: Sequence[Joint], data: Any, massless: set[str]) -> Array:
    """The steps (n, k) of frames, twelve for each joint, by half units of the last digits of what is written.

    Axes that are parallel on a part turn together. The length of a rod is a number, its direction is not.
    """
    frames = [
        (part, pose, pose.rotation @ joint.axis)
        for joint in joints
        for part, pose in ((joint.parent, joint.parent_pose), (joint.child, joint.child_pose))
    ]
    lengths = Digits(number for _, pose, _ in frames for number in pose.position)
    angle = MOST_TURN * half_unit_of_angles(data)
    columns: list[Array] = []
    groups: list[tuple[str, Array, Array]] = []
    for start, (part, pose, axis) in zip(range(0, 6 * len(frames), 6), frames, strict=True):
        units = lengths.half_units(pose.position)
        if part in massless or not pose.position.any():
            units = np.where(pose.position == 0.0, 0.0, units)
        steps = np.zeros((6, 6 * len(frames)))
        steps[:, start : start + 6] = np.diag([*units, angle, angle, angle])
        columns += [step for step in steps[:3] if step.any()]
        if angle and np.count_nonzero(axis) > 1:
            turning = (turns for name, other, turns in groups if name == part and _are_parallel(axis, other))
            if (turns := next(turning, None)) is None:
                groups.append((part, axis, steps[3:]))
            else:
                turns += steps[3:]
    columns += [turn for *_, turns in groups for turn in turns]
    return np.array(columns).reshape(-1, 6 * len(frames)).T


def _are_parallel(one: Array, other: Array) -> bool:
    return float(np.linalg.norm(np.cross(one, other))) < PARALLEL


def _moved(joint: Joint, step: Array) -> Joint:
    parent, child = (
        Pose(pose.position + change[:3], rot.from_quaternion(rot.of_vector(change[3:])) @ pose.rotation)
        for pose, change in zip((joint.parent_pose, joint.child_pose), step.reshape(2, 6), strict=True)
    )
    return dataclasses.replace(joint, parent_pose=parent, child_pose=child)
