"""A configuration in which all loops are closed as well as their geometry allows, in numbers.

Where axes are parallel only nearly, some equations of a loop are nearly redundant: to satisfy them exactly, the joints
would have to move far. They are left open here, by the little that the axes are off.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mbd_sim.base.geometry.pose import Array, Pose, identity_pose
from mbd_sim.base.linear_algebra import cross
from mbd_sim.mechanism.elements.joint_types import CommandedDrive
from mbd_sim.mechanism.elements.parts import GROUND, Joint
from mbd_sim.mechanism.exact_geometry.freedoms import displaced, displacement, gap_of, motion, stacked, twists_of
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.spanning_tree import loop_through

NEARLY = 3e-3  # a singular value of a loop's twists that counts as zero within the digits of a file
LONGEST_STEP = 0.6  # rad, or parts of the size
ITERATIONS, ATTEMPTS = 60, 12
LATELY = 10  # iterations in which a gap is at least halved if it is ever to be closed
CONVERGED = 1e-14  # step, rad or parts of the size
CLOSED, NEAR = 1e-12, 0.1  # a gap that is round-off, and how far it may take to close it; rad or parts of the size


@dataclass(frozen=True, eq=False)
class Placement:
    """The `poses` of the parts in ground's frame at coordinates `q`; `size` is that of the loops in m."""

    poses: Mapping[str, Pose]
    size: float
    q: Mapping[str, Array]

    def frames(self, joint: Joint) -> tuple[Pose, Pose]:
        """The frames of a joint on its parent and on its child."""
        return self.poses[joint.parent] @ joint.parent_pose, self.poses[joint.child] @ joint.child_pose

    def twists(self, joint: Joint) -> list[Array]:
        """The twists of a joint's child relative to its parent."""
        return twists_of(joint, *self.frames(joint))

    def is_near(self, other: Placement) -> bool:
        """Whether no part is farther from where another placement has it than `NEAR`."""
        pairs = [(self.poses[name], pose) for name, pose in other.poses.items()]
        shifts = [np.max(np.abs(one.position - pose.position)) / self.size for one, pose in pairs]
        turns = [np.max(np.abs(one.rotation - pose.rotation)) for one, pose in pairs]
        return bool(max(*shifts, *turns) < NEAR)


class Loops:
    """The loops of a mechanism: one for each joint that closes one, whether or not it has coordinates."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        split = {name: joint for name, joint in mechanism.joints.items() if joint.splits}
        self.closing: Mapping[str, Joint] = {**mechanism.closing, **split}
        self.tree = [joint for joint in mechanism.tree_joints() if not joint.splits]
        self._columns: dict[str, slice] = {}
        for joint in self.tree:
            start = sum(columns.stop - columns.start for columns in self._columns.values())
            self._columns[joint.name] = slice(start, start + (0 if joint.drive else joint.kind.nv))

    @cached_property
    def around(self) -> Mapping[str, Sequence[tuple[Joint, bool]]]:
        """The joints around each loop, beginning with the closing one, and whether each is crossed to its child."""
        carrier, joints = {joint.outboard_part: joint.name for joint in self.tree}, self.mechanism.all_joints
        return {name: self._in_order(name, loop_through(carrier, joints, name)) for name in self.closing}

    def _in_order(self, name: str, loop: Sequence[str]) -> list[tuple[Joint, bool]]:
        found, part, waiting = [(self.closing[name], True)], self.closing[name].child, list(loop)
        joints = self.mechanism.joints
        while waiting:
            following = next(one for one in waiting if part in (joints[one].parent, joints[one].child))
            waiting.remove(following)
            to_child = joints[following].parent == part
            found.append((joints[following], to_child))
            part = joints[following].child if to_child else joints[following].parent
        return found

    def at_start(self) -> Placement:
        """The poses at the start values of the file."""
        return self._placed({joint.name: start_of(joint) for joint in self.tree})

    @cached_property
    def closed(self) -> Placement | None:
        """A configuration near the start values of the file in which all loops are closed, nearly; None: not found."""
        random = np.random.default_rng(0)
        start = {joint.name: start_of(joint) for joint in self.tree}
        moving = [joint for joint in self.tree if not joint.drive]
        given = np.array([flag for joint in moving for flag in joint.fixed_in_assembly], dtype=bool)
        for free in (~given, np.ones_like(given)) if given.any() else (~given,):
            for attempt in range(ATTEMPTS):
                scatter = random.normal(size=len(free)) * free * min(2.0, 0.1 * 1.3**attempt) * (attempt > 0)
                found = self._newton(self._moved(start, scatter), free)
                if found is not None:
                    return found
        return None

    def _newton(self, q: Mapping[str, Array], free: Array) -> Placement | None:
        """Gauss-Newton without the directions in which the loops are nearly redundant, unless they close with these."""
        place = self._converged(q, free, NEARLY)
        if self._largest_gap(place) > NEARLY:
            return None
        # A chain that is stretched between its ends closes as it is written, but its last steps halve the gap only.
        exact = self._converged(place.q, free, CLOSED)
        return exact if self._largest_gap(exact) <= CLOSED and exact.is_near(place) else place

    def moved_on(self, place: Placement, change: Array) -> Placement:
        """The placement after a displacement (nv,) in rad and parts of the size, closed again, nearly."""
        q = self._moved(place.q, change * self._units(place))
        return self._converged(q, np.ones(len(change), dtype=bool), NEARLY)

    def closed_from(self, place: Placement) -> Placement:
        """A placement of a mechanism with nearly these numbers, closed nearly."""
        return self.moved_on(place, np.zeros(len(self._units(place))))

    def _converged(self, q: Mapping[str, Array], free: Array, least: float) -> Placement:
        """Gauss-Newton from q, with singular values above the `least` fraction of the largest."""
        place, largest = self._placed(q), list[float]()
        for _ in range(ITERATIONS):
            gaps, slopes = self.gaps(place)
            largest.append(float(np.max(np.abs(gaps), initial=0.0)))
            if _is_hopeless(largest):
                break
            left, sizes, right = np.linalg.svd(slopes[:, free], full_matrices=False)
            used = sizes > least * np.max(sizes, initial=0.0)
            step = np.zeros(len(free))
            step[free] = -right[used].T @ ((left[:, used].T @ gaps) / sizes[used])
            longest = float(np.max(np.abs(step), initial=0.0))
            if longest <= CONVERGED:
                break
            q = self._moved(q, step * min(1.0, LONGEST_STEP / longest) * self._units(place))
            place = self._placed(q)
        return place

    def _largest_gap(self, place: Placement) -> float:
        return float(np.max(np.abs(self.gaps(place)[0]), initial=0.0))

    def gaps(self, place: Placement) -> tuple[Array, Array]:
        """The gaps (m,) of all loops, lengths in parts of the size, and their slopes (m, nv) by the coordinates."""
        twists = {joint.name: stacked(place.twists(joint)) for joint in self.tree if not joint.drive}
        gaps, slopes = self.slopes(place, {name: (self._columns[name], twist) for name, twist in twists.items()})
        return gaps, slopes * self._units(place)

    def slopes(self, place: Placement, moves: Mapping[str, tuple[slice, Array]]) -> tuple[Array, Array]:
        """The gaps (m,), and their slopes (m, n) by twists (6, k) across joints, of which each has its columns."""
        count = max((columns.stop for columns, _ in moves.values()), default=0)
        all_gaps, all_slopes = [np.zeros(0)], [np.zeros((0, count))]
        for name, around in self.around.items():
            first, second = place.frames(self.closing[name])
            gaps, by_twist = gap_of(self.closing[name], first, second)
            twists = np.zeros((6, count))
            for joint, to_child in around:
                if joint.name in moves:
                    columns, twist = moves[joint.name]
                    twists[:, columns] = -twist if to_child else twist
            twists[3:] += cross(twists[:3].T, second.position).T
            lengths = np.where(np.any(by_twist[:, 3:], axis=1), place.size, 1.0)
            all_gaps.append(gaps / lengths)
            all_slopes.append(by_twist @ twists / lengths[:, None])
        return np.concatenate(all_gaps), np.vstack(all_slopes)

    def _units(self, place: Placement) -> Array:
        """1 rad, or the size in m, for each coordinate."""
        kinds = [one for joint in self.tree if not joint.drive for one in joint.kind.coordinates]
        return np.array([1.0 if one.rotation else place.size for one in kinds])

    def _moved(self, q: Mapping[str, Array], change: Array) -> dict[str, Array]:
        return {
            name: q[name] if columns.start == columns.stop else displaced(joint, q[name], change[columns])
            for joint, (name, columns) in zip(self.tree, self._columns.items(), strict=True)
        }

    def _placed(self, q: Mapping[str, Array]) -> Placement:
        poses = {GROUND: identity_pose()}
        for joint in self.tree:
            relative = joint.parent_pose @ motion(joint, q[joint.name]) @ joint.child_pose.inverse()
            poses[joint.outboard_part] = poses[joint.inboard] @ (relative.inverse() if joint.reversed else relative)
        return Placement(poses, self._size, q)

    @cached_property
    def _size(self) -> float:
        """The largest distance of two joints of loops on one part, or of a joint from its part's origin, m."""
        joints = {joint.name: joint for around in self.around.values() for joint, _ in around}
        places: dict[str, list[Array]] = {}
        for joint in joints.values():
            for part, pose in ((joint.parent, joint.parent_pose), (joint.child, joint.child_pose)):
                places.setdefault(part, []).append(pose.position)
        spans = [np.ptp(np.array(points), axis=0) for points in places.values()]
        spans += [np.max(np.abs(points), axis=0) for points in places.values()]
        return float(max((np.linalg.norm(span) for span in spans), default=0.0)) or 1.0

    def open_by(self, name: str, place: Placement) -> Array:
        """The twist (6,) by which a loop is open, about ground's origin."""
        return displacement(self.closing[name], *place.frames(self.closing[name]))


def _is_hopeless(gaps: Sequence[float]) -> bool:
    """Whether a gap that is far from closed has hardly become smaller lately: even a stretched chain halves it."""
    lately = min(gaps[-LATELY:])
    return len(gaps) >= 2 * LATELY and lately > NEARLY and lately > 0.5 * min(gaps[:-LATELY])


def start_of(joint: Joint) -> Array:
    """The coordinates of a joint at the start values of the file."""
    if isinstance(joint.drive, CommandedDrive):
        return np.array([joint.drive.start])
    if joint.drive:
        return np.array([expression.at(0.0) for expression in joint.drive])
    return joint.position
