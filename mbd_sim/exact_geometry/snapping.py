"""The nearest mechanism whose loops are exact: where axes are parallel, or meet, only to the digits of a file.

A loop whose equations are nearly redundant is locked, or stays open, by digits that nobody meant. At a configuration in
which the loops are closed but for these, the axes of its joints are moved as little as possible to what they have in
common, and both sides of each joint are placed at the same frame in space. So the loop closes exactly there, and in
all positions.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping

import numpy as np

from mbd_sim.exact_geometry.families import LINES, Axis, Family, Key, axes_of, families, meeting_point
from mbd_sim.exact_geometry.freedoms import advance, stacked
from mbd_sim.exact_geometry.loop_positions import NEARLY, Loops, Placement
from mbd_sim.geometry import rotation as rot
from mbd_sim.geometry.batch import Batch
from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.mechanism.records import Joint, Mechanism, Move

ROUND_OFF = 1e-13  # rad, or parts of the size


def with_exact_loops(mechanism: Mechanism, tolerance: float) -> Mechanism:
    """The mechanism with exact loops, the same one if it has nothing to mend.

    :param tolerance: in rad and parts of the size of a loop; what differs by more is meant as it is written.
    :raises TypeError: a mechanism with batches of numbers would have to be mended.
    """
    if not tolerance or not mechanism.closures:
        return mechanism
    first = _first_variant(mechanism)
    mended = _mended(first, tolerance)
    if mended is not first and first is not mechanism:
        raise TypeError("the loops of each variant are mended in another way")
    return mechanism if mended is first else mended


def _mended(mechanism: Mechanism, tolerance: float) -> Mechanism:
    loops = Loops(mechanism)
    place = loops.closed()
    if place is None:
        return mechanism
    groups = _Groups()
    mended: dict[str, Joint] = {}
    for name in loops.around:
        family = _family_of(loops, name, place, tolerance)
        if family is not None:
            joints = [joint for joint, _ in loops.around[name]]
            groups.add(family, joints)
            mended |= {joint.name: joint for joint in joints}
    if not mended:
        return mechanism
    targets = _Targets(groups, mended.values(), place)
    changed = {joint.name: targets.moved(joint) for joint in mended.values()}
    least = Move(ROUND_OFF * place.size, ROUND_OFF)
    most = Move(3.0 * tolerance * place.size, 3.0 * tolerance)
    moves = {name: _move(mended[name], joint) for name, joint in changed.items()}
    moves = {name: move for name, move in moves.items() if move.exceeds(least)}
    if not moves or any(move.exceeds(most) for move in moves.values()):
        return mechanism

    def of(joints: Mapping[str, Joint]) -> dict[str, Joint]:
        return {name: changed.get(name, joint) for name, joint in joints.items()}

    return dataclasses.replace(
        mechanism,
        joints=of(mechanism.joints),
        closing=of(mechanism.closing),
        moved={name: moves[name] for name in mechanism.all_joints if name in moves},
    )


def _family_of(loops: Loops, name: str, place: Placement, tolerance: float) -> Family | None:
    """What the axes of a loop have in common only nearly, if that keeps it from moving, or from closing; or None."""
    around = loops.around[name]
    points = [pose.position for joint, _ in around for pose in place.frames(joint)]
    size = float(np.linalg.norm(np.ptp(np.array(points), axis=0))) or place.size
    about = np.mean(points, axis=0)
    before, left_open = _redundancy(loops, name, place, about, size)
    if not before and not left_open:
        return None
    for family in families(around, place, size, tolerance):
        groups = _Groups()
        groups.add(family, [joint for joint, _ in around])
        targets = _Targets(groups, [joint for joint, _ in around], place)
        after = _nearly_zero(stacked([twist for joint, _ in around for twist in targets.twists(joint)]), about, size)
        if after < before or (left_open and after == before):
            return family
    return None


def _redundancy(loops: Loops, name: str, place: Placement, about: Array, size: float) -> tuple[int, bool]:
    """How many of a loop's equations are redundant only nearly, and whether others that are redundant contradict it."""
    twists = stacked([twist for joint, _ in loops.around[name] for twist in place.twists(joint)])
    scaled = _scaled(twists, about, size)
    left, sizes, _ = np.linalg.svd(scaled)
    sizes = np.pad(sizes, (0, 6 - len(sizes)))
    redundant = left[:, sizes <= NEARLY * max(float(np.max(sizes)), 1.0)]
    gap = redundant.T @ _scaled(loops.open_by(name, place)[:, None], about, size)
    return _nearly_zero(twists, about, size), bool(np.linalg.norm(gap) > ROUND_OFF)


def _nearly_zero(twists: Array, about: Array, size: float) -> int:
    sizes = np.linalg.svd(_scaled(twists, about, size), compute_uv=False)
    relative = sizes / max(float(np.max(sizes, initial=0.0)), 1.0)
    return int(np.sum((relative > ROUND_OFF) & (relative < NEARLY)))


def _scaled(twists: Array, about: Array, size: float) -> Array:
    """Twists (6, n) about a point, with lengths in parts of a size; translations have the length 1."""
    turning = np.any(twists[:3] != 0.0, axis=0)
    moving = twists[3:] + np.cross(twists[:3].T, about).T
    return np.vstack([twists[:3], np.where(turning, moving / size, moving)])


class _Groups:
    """Axes that are parallel, with the sliders across them, and joints on common lines and through common points."""

    def __init__(self) -> None:
        self._leader: dict[Key, Key] = {}
        self.perpendicular: list[tuple[Key, Key]] = []
        self.common: list[tuple[str, dict[str, None]]] = []

    def add(self, family: Family, joints: Iterable[Joint]) -> None:
        """Add what a loop has in common."""
        for one, other in family.parallel:
            if (first := self.leader(one)) != (second := self.leader(other)):
                self._leader[second] = first
        self.perpendicular += family.perpendicular
        if family.common:
            names = {joint.name: None for joint in joints}
            for kind, others in [*self.common]:
                if kind == family.common and not others.keys().isdisjoint(names):
                    self.common.remove((kind, others))
                    names = {**others, **names}
            self.common.append((family.common, names))

    def leader(self, key: Key) -> Key:
        """The axis that stands for all that are parallel to one."""
        while key in self._leader:
            key = self._leader[key]
        return key


class _Targets:
    """Where the axes of joints are to be: the mean direction of each group, and common lines and points."""

    def __init__(self, groups: _Groups, joints: Iterable[Joint], place: Placement) -> None:
        self._place = place
        self._axes = {axis.key: axis for joint in joints for axis in axes_of(joint, place)}
        self._direction = self._directions(groups)
        self._line: dict[str, Axis] = {}
        self._point: dict[str, Array] = {}
        for kind, names in groups.common:
            axes = [axis for axis in self._axes.values() if axis.key[0] in names]
            if kind == "line":
                self._line |= dict.fromkeys(names, self._mean_line(axes))
            else:
                center = meeting_point(axes)
                assert center is not None
                self._point |= dict.fromkeys(names, center)

    def _directions(self, groups: _Groups) -> dict[Key, Array]:
        members: dict[Key, list[Axis]] = {}
        for key, axis in self._axes.items():
            members.setdefault(groups.leader(key), []).append(axis)
        found = {}
        for axes in members.values():
            first = axes[0].direction
            signs = [1.0 if axis.direction @ first >= 0.0 else -1.0 for axis in axes]
            mean = np.sum([sign * axis.direction for sign, axis in zip(signs, axes, strict=True)], axis=0)
            mean = first if len(axes) == 1 else rot.unit(mean)
            found |= {axis.key: sign * mean for sign, axis in zip(signs, axes, strict=True)}
        across: dict[Key, list[Array]] = {}
        for slider, axis in groups.perpendicular:
            across.setdefault(slider, []).append(found[axis])
        for slider, normals in across.items():
            for key in [key for key in found if groups.leader(key) == groups.leader(slider)]:
                found[key] = _across(found[key], normals)
        return found

    def _mean_line(self, axes: list[Axis]) -> Axis:
        lines = [axis for axis in axes if axis.direction.any()]
        direction = self._direction[lines[0].key]
        point = np.mean([axis.point for axis in axes if axis.turns], axis=0)
        return Axis(lines[0].key, direction, point, True)

    def _frames(self, joint: Joint) -> tuple[Pose, Pose, Array]:
        """The frames of a joint on both sides, and its second axis in the first frame."""
        first, second = self._place.frames(joint)
        if joint.type == "fixed":
            turn = rot.to_quaternion(second.rotation @ first.rotation.T)
            half = rot.from_quaternion(rot.of_vector(0.5 * rot.rotation_vector(turn)))
            middle = Pose(0.5 * (first.position + second.position), half @ first.rotation)
            return middle, middle, joint.second
        rotations, other = [first.rotation, second.rotation], joint.second
        if joint.axis.any():
            ends = [(joint.name, 0), (joint.name, 1 if joint.type == "universal" else 0)]
            vectors = [joint.axis, joint.second if joint.type == "universal" else joint.axis]
            rotations = [
                _turning(rotation @ vector, self._direction[key]) @ rotation
                for rotation, vector, key in zip(rotations, vectors, ends, strict=True)
            ]
            if joint.type == "universal":
                other = _at_angle(joint.axis, joint.second, float(self._direction[ends[0]] @ self._direction[ends[1]]))
        if joint.type == "prismatic":
            turn = rot.to_quaternion(rotations[1] @ rotations[0].T)
            half = rot.from_quaternion(rot.of_vector(0.5 * rot.rotation_vector(turn)))
            rotations = [half @ rotations[0]] * 2
        places = self._places(joint, Pose(first.position, rotations[0]), Pose(second.position, rotations[1]))
        return Pose(places[0], rotations[0]), Pose(places[1], rotations[1]), other

    def _places(self, joint: Joint, first: Pose, second: Pose) -> tuple[Array, Array]:
        """The origins of both frames, so that the joint is at a position that it allows."""
        gap = second.position - first.position
        axis = first.rotation @ joint.axis
        match joint.type:
            case "revolute" | "universal" | "spherical":
                shared = self._on_common(joint, 0.5 * (first.position + second.position), axis)
                return shared, shared
            case "prismatic" | "cylindrical" | "screw":
                along = axis * float(axis @ gap)
                across = 0.5 * (gap - along)
                places = [first.position + across, second.position - across]
                if joint.type == "screw":
                    half = 0.5 * axis * advance(joint, first, second)
                    places = [places[0] + half, places[1] - half]
                if joint.type in LINES:
                    places = [self._on_common(joint, at, axis) for at in places]
                return places[0], places[1]
            case "planar":
                half = 0.5 * axis * float(axis @ gap)
                return first.position + half, second.position - half
        return first.position, second.position

    def _on_common(self, joint: Joint, at: Array, axis: Array) -> Array:
        """A point of a joint's axis, moved with this axis to the line or the point of its loop."""
        if (line := self._line.get(joint.name)) is not None:
            return line.point + line.direction * float(line.direction @ (at - line.point))
        if (center := self._point.get(joint.name)) is not None:
            return center if joint.type != "revolute" else center + axis * float(axis @ (at - center))
        return at

    def twists(self, joint: Joint) -> list[Array]:
        """The twists of a joint after it is moved."""
        from mbd_sim.exact_geometry.freedoms import twists_of

        first, second, other = self._frames(joint)
        return twists_of(dataclasses.replace(joint, second=other), first, second)

    def moved(self, joint: Joint) -> Joint:
        """The joint with both frames where they are to be."""
        first, second, other = self._frames(joint)
        parent, child = self._place.poses[joint.parent].inverse(), self._place.poses[joint.child].inverse()
        return dataclasses.replace(joint, parent_pose=parent @ first, child_pose=child @ second, second=other)


def _across(direction: Array, normals: list[Array]) -> Array:
    """The direction nearest to one that is perpendicular to others."""
    left, sizes, _ = np.linalg.svd(np.array(normals).T, full_matrices=True)
    rank = int(np.sum(sizes > 0.1 * sizes[0]))
    free = left[:, rank:]
    return rot.unit(free @ (free.T @ direction)) if rank < 3 else direction


def _turning(one: Array, other: Array) -> Array:
    """The smallest rotation (3, 3) that takes one unit vector to a near one."""
    axis = np.cross(one, other)
    sine, cosine = float(np.linalg.norm(axis)), float(one @ other)
    return np.eye(3) if sine == 0.0 else rot.about(axis / sine, float(np.arctan2(sine, cosine)))


def _at_angle(axis: Array, second: Array, cosine: float) -> Array:
    """The vector nearest to `second` with this cosine to the axis."""
    across = rot.unit(second - axis * float(axis @ second))
    return cosine * axis + np.sqrt(max(0.0, 1.0 - cosine**2)) * across


def _move(before: Joint, after: Joint) -> Move:
    """The larger one of the moves of both frames of a joint."""
    pairs = ((before.parent_pose, after.parent_pose), (before.child_pose, after.child_pose))
    distance = max(float(np.linalg.norm(new.position - old.position)) for old, new in pairs)
    turns = [rot.rotation_vector(rot.to_quaternion(new.rotation @ old.rotation.T)) for old, new in pairs]
    return Move(distance, max(float(np.linalg.norm(turn)) for turn in turns))


def _first_variant(mechanism: Mechanism) -> Mechanism:
    """The same mechanism, or the first variant of the frames of its joints where these are batches."""
    joints = [*mechanism.joints.values(), *mechanism.closing.values()]
    found = {joint.name: _first_of(joint) for joint in joints}
    if all(found[joint.name] is joint for joint in joints):
        return mechanism
    own = ({name: found[name] for name in of} for of in (mechanism.joints, mechanism.closing))
    return dataclasses.replace(mechanism, joints=next(own), closing=next(own))


def _first_of(joint: Joint) -> Joint:
    fields = ("axis", "second", "position", "lead")
    poses = {name: getattr(joint, name) for name in ("parent_pose", "child_pose")}
    numbers = [getattr(joint, name) for name in fields]
    numbers += [part for pose in poses.values() for part in (pose.position, pose.rotation)]
    if not any(isinstance(number, Batch) for number in numbers):
        return joint
    plain = {name: Pose(_plain(pose.position), _plain(pose.rotation)) for name, pose in poses.items()}
    return dataclasses.replace(joint, **plain, **{name: _plain(getattr(joint, name)) for name in fields})


def _plain(number: Array | Batch | float) -> Array:
    return number.values[0] if isinstance(number, Batch) else number
