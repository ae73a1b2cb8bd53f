"""What the digits of a mechanism file mean: where the axes of joints are to be, and the ratios of couplings.

What the loops of a mechanism have in common is applied to all of them at once. Couplings may repeat each other but for
the digits of their ratios: with coordinates q, couplings are C q = v, and repeat each other if there is a y with
yᵀ C = 0 and yᵀ v = 0. Where these are zero only nearly, the entries of C and v are changed as little as possible; those
that are zero stay so.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

import numpy as np

from mbd_sim.base.geometry import rotation as rot
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.mechanism.elements.constraints import Constraint, Coupling
from mbd_sim.mechanism.elements.parts import Joint, Move
from mbd_sim.mechanism.exact_geometry.families import Axis, Family, Key, axes_of, meeting_point
from mbd_sim.mechanism.exact_geometry.freedoms import advance, twists_of
from mbd_sim.mechanism.exact_geometry.loop_positions import Placement
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.expression import TimeExpression


class Groups:
    """Axes that are parallel, with the sliders across them, and joints on common lines and through common points."""

    def __init__(self) -> None:
        self._leader: dict[Key, Key] = {}
        self.perpendicular: list[tuple[Key, Key]] = []
        self.common: list[tuple[str, dict[str, None]]] = []

    def add(self, family: Family) -> None:
        """Add what a loop has in common."""
        for one, other in family.parallel:
            if (first := self.leader(one)) != (second := self.leader(other)):
                self._leader[second] = first
        self.perpendicular += family.perpendicular
        if family.common:
            names = dict.fromkeys(family.joined)
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


class Targets:
    """Where the axes of joints are to be: the mean direction of each group, and common lines and points."""

    def __init__(self, groups: Groups, joints: Iterable[Joint], place: Placement) -> None:
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

    def _directions(self, groups: Groups) -> dict[Key, Array]:
        members: dict[Key, list[Axis]] = {}
        for key, axis in self._axes.items():
            members.setdefault(groups.leader(key), []).append(axis)
        found: dict[Key, Array] = {}
        for axes in members.values():
            first = axes[0].direction
            signs = [1.0 if axis.direction @ first >= 0.0 else -1.0 for axis in axes]
            mean = np.sum([sign * axis.direction for sign, axis in zip(signs, axes, strict=True)], axis=0)
            mean = first if len(axes) == 1 else rot.unit(mean)
            found |= {axis.key: sign * mean for sign, axis in zip(signs, axes, strict=True)}
        across: dict[Key, list[Array]] = {}
        for slider, turning in groups.perpendicular:
            across.setdefault(slider, []).append(found[turning])
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
        conditions, kind = joint.kind.loop_conditions, joint.kind
        if kind.keeps_point:
            shared = self._on_common(joint, 0.5 * (first.position + second.position), axis)
            return shared, shared
        if "point on axis" in conditions:
            along = axis * float(axis @ gap)
            across = 0.5 * (gap - along)
            places = [first.position + across, second.position - across]
            if kind.advances:
                half = 0.5 * axis * advance(joint, first, second)
                places = [places[0] + half, places[1] - half]
            if kind.keeps_line:
                places = [self._on_common(joint, at, axis) for at in places]
            return places[0], places[1]
        if "point in plane" in conditions:
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

    def is_common(self, name: str) -> bool:
        """Whether a joint is on the line, or at the point, that the joints of its loop have in common."""
        return name in self._line or name in self._point

    def twists(self, joint: Joint) -> list[Array]:
        """The twists of a joint after it is moved."""
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
    found: Array = cosine * axis + np.sqrt(max(0.0, 1.0 - cosine**2)) * across
    return found


def exact_couplings(mechanism: Mechanism, nearly: float, round_off: float) -> dict[str, tuple[Constraint, Move]]:
    """The couplings of which a ratio changes, and by which part, by their names.

    :param nearly: a singular value that counts as zero within the digits of a file, and `round_off` what is zero.
    """
    found = [one for one in mechanism.constraints if isinstance(one, Coupling) and _is_linear(one)]
    if len(found) < 2:
        return {}
    columns = list(dict.fromkeys(name for one in found for name in one.factors))
    rows, scaled = _equilibrated(np.array([[one.factors.get(name, 0.0) for name in columns] for one in found]))
    left, sizes, _ = np.linalg.svd(scaled)
    sizes = np.pad(sizes, (0, len(found) - len(sizes)))
    stresses = left[:, sizes < nearly]
    values = np.array([one.value.at(0.0) for one in found])
    offsets = rows * values
    if np.abs(stresses.T @ np.column_stack([scaled, offsets])).max(initial=0.0) <= round_off:
        return {}
    parts = _relative_changes(scaled, stresses)
    of_values = _relative_changes(offsets[:, None], stresses)[:, 0]
    share = np.abs(offsets) / (np.max(np.abs(offsets)) or 1.0)  # a value may be a small difference of large ones
    changed: dict[str, tuple[Constraint, Move]] = {}
    for one, part, of_value, value, of_largest in zip(found, parts, of_values, values, share, strict=True):
        largest = float(np.max(np.abs([*part, of_value * of_largest])))
        if largest > round_off:
            factors = {name: one.factors[name] * (1.0 + part[columns.index(name)]) for name in one.factors}
            offset = TimeExpression(repr(float(value * (1.0 + of_value))), {}) if of_value else one.value
            changed[one.name] = dataclasses.replace(one, factors=factors, value=offset), Move(0.0, largest)
    return changed


def _is_linear(coupling: Coupling) -> bool:
    return coupling.law is None and coupling.play is None and not coupling.value.variables


def _equilibrated(matrix: Array) -> tuple[Array, Array]:
    """The factors (m,) of the rows, and the matrix (m, n) with rows and columns whose entries are about 1 or 0."""
    used, (count, _) = np.nonzero(matrix), matrix.shape
    unknown = np.zeros((len(used[0]), sum(matrix.shape)))  # the logarithms of the factors of rows and columns
    entries = np.arange(len(unknown))
    unknown[entries, used[0]] = unknown[entries, count + used[1]] = 1.0
    factors = np.exp(np.linalg.lstsq(unknown, -np.log(np.abs(matrix[used])), rcond=None)[0])
    return factors[:count], factors[:count, None] * matrix * factors[count:]


def _relative_changes(matrix: Array, stresses: Array) -> Array:
    """The parts (m, n) by which the entries change so that all combinations `stresses` (m, k) of the rows are zero."""
    changes = np.zeros_like(matrix)
    for number, column in enumerate(matrix.T):
        used = column != 0.0
        change = -np.linalg.lstsq(stresses[used].T, stresses.T @ column, rcond=None)[0]
        changes[used, number] = change / column[used]
    return changes
