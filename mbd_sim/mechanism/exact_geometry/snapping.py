"""The nearest mechanism whose loops are exact: where axes are parallel, or meet, only to the digits of a file.

A loop whose equations are nearly redundant is locked, or stays open, by digits that nobody meant. At a configuration in
which the loops are closed but for these, the axes of its joints are moved as little as possible to what they have in
common, and both sides of each joint are placed at the same frame in space. So the loop closes exactly there, and in
all positions.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from mbd_sim.base.geometry import rotation as rot
from mbd_sim.base.geometry.batch import Batch
from mbd_sim.base.geometry.pose import Array
from mbd_sim.mechanism.elements.parts import Joint, Move
from mbd_sim.mechanism.exact_geometry.families import Family, families
from mbd_sim.mechanism.exact_geometry.freedoms import stacked
from mbd_sim.mechanism.exact_geometry.guides import guides, with_guides
from mbd_sim.mechanism.exact_geometry.loop_positions import NEARLY, Loops, Placement
from mbd_sim.mechanism.exact_geometry.mobility import mobile, with_joints
from mbd_sim.mechanism.exact_geometry.targets import Groups, Targets, exact_couplings
from mbd_sim.mechanism.mechanism import Mechanism

ROUND_OFF = 1e-13  # rad, or parts of the size


def with_exact_loops(mechanism: Mechanism, tolerance: float) -> Mechanism:
    """The mechanism with exact loops, the same one if it has nothing to mend.

    :param tolerance: in rad and parts of the size of a loop; what differs by more is meant as it is written.
    :raises TypeError: a mechanism with batches of numbers would have to be mended.
    """
    if not tolerance or not (mechanism.closures or mechanism.constraints):
        return mechanism
    first = _first_variant(mechanism)
    exact = _exact(first, tolerance)
    if exact is not first and first is not mechanism:
        raise TypeError("the loops of each variant are mended in another way")
    return mechanism if exact is first else exact


def inexact(mechanism: Mechanism, tolerance: float) -> tuple[str, ...]:
    """The names of what `with_exact_loops` would move in a mechanism that is left as it is written."""
    if not (mechanism.closures or mechanism.constraints):
        return ()
    return tuple(_exact(_first_variant(mechanism), tolerance).moved)


def _exact(mechanism: Mechanism, tolerance: float) -> Mechanism:
    loops = Loops(with_guides(mechanism, guides(mechanism)))
    if loops.closed is not None:
        mended = _mended(mechanism, loops, loops.closed, tolerance)
        if mended is not mechanism:
            loops = Loops(with_guides(mended, guides(mended)))
        mechanism = _moving(mechanism, mended, loops)
    return _with_exact_couplings(mechanism, tolerance)


def _mended(mechanism: Mechanism, loops: Loops, place: Placement, tolerance: float) -> Mechanism:
    """A mechanism with exact directions of axes."""
    found = guides(mechanism)
    massless = {guide.pin.name: guide.pin.parent for guide in found}
    groups = Groups()
    mended: dict[str, Joint] = {}
    for name in loops.around:
        family = _family_of(loops, name, place, tolerance, massless.get(name, ""))
        if family is not None:
            groups.add(family)
            mended |= {joint.name: joint for joint, _ in loops.around[name]}
    if not mended:
        return mechanism
    targets = Targets(groups, mended.values(), place)
    changed = {joint.name: targets.moved(joint) for joint in mended.values()}
    moves = {name: _move(mended[name], changed[name]) for name in mechanism.all_joints if name in changed}
    constraints = {constraint.name: constraint for constraint in mechanism.constraints}
    for guide in found:
        if guide.pin.name in changed:
            name, ends = guide.constraint.name, (changed[guide.carrier.name], changed[guide.pin.name])
            constraints[name], moves[f"constraints.{name}"] = guide.moved(
                *ends, place, targets.is_common(guide.pin.name)
            )
    least = Move(ROUND_OFF * place.size, ROUND_OFF)
    most = Move(3.0 * tolerance * place.size, 3.0 * tolerance)
    moves = {name: move for name, move in moves.items() if move.exceeds(least)}
    if not moves or any(move.exceeds(most) for move in moves.values()):
        return mechanism
    mechanism = with_joints(mechanism, changed)
    return dataclasses.replace(mechanism, constraints=tuple(constraints.values()), moved=moves)


def _moving(written: Mechanism, mended: Mechanism, loops: Loops) -> Mechanism:
    """A mechanism whose axes are mended, which has these loops, with the lengths with which they move."""
    found = guides(written)
    before = with_guides(written, found)
    changed = mobile(before, loops)
    if not changed:
        return mended
    moves = {name: _move(joint, changed[name]) for name, joint in written.all_joints.items() if name in changed}
    constraints = {constraint.name: constraint for constraint in mended.constraints}
    for guide in found:
        if guide.pin.name in changed:
            name, ends = guide.constraint.name, (changed[guide.carrier.name], changed[guide.pin.name])
            constraints[name], moves[f"constraints.{name}"] = guide.refitted(*ends)
    moves = {name: move for name, move in moves.items() if move.exceeds(Move(0.0, ROUND_OFF))}
    mechanism = with_joints(mended, changed)
    return dataclasses.replace(mechanism, constraints=tuple(constraints.values()), moved=moves)


def _with_exact_couplings(mechanism: Mechanism, tolerance: float) -> Mechanism:
    found = exact_couplings(mechanism, NEARLY, ROUND_OFF)
    if not found or any(move.angle > 3.0 * tolerance for _, move in found.values()):
        return mechanism
    constraints = [found[one.name][0] if one.name in found else one for one in mechanism.constraints]
    moves = {f"constraints.{name}": move for name, (_, move) in found.items()}
    return dataclasses.replace(mechanism, constraints=tuple(constraints), moved={**mechanism.moved, **moves})


def _family_of(loops: Loops, name: str, place: Placement, tolerance: float, massless: str) -> Family | None:
    """What the axes of a loop have in common only nearly, if that keeps it from moving, or from closing; or None."""
    around = loops.around[name]
    points = [pose.position for joint, _ in around for pose in place.frames(joint)]
    size = float(np.linalg.norm(np.ptp(np.array(points), axis=0)))
    size = size if size > tolerance * place.size else place.size  # all points of a loop may be meant to coincide
    about = np.mean(points, axis=0)
    before, left_open = _redundancy(loops, name, place, about, size)
    if not before and not left_open:
        return None
    for family in families(around, place, size, tolerance, massless):
        groups = Groups()
        groups.add(family)
        targets = Targets(groups, [joint for joint, _ in around], place)
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


def _move(before: Joint, after: Joint) -> Move:
    """The larger one of the moves of both frames of a joint."""
    pairs = ((before.parent_pose, after.parent_pose), (before.child_pose, after.child_pose))
    distance = max(float(np.linalg.norm(new.position - old.position)) for old, new in pairs)
    turns = [rot.rotation_vector(rot.to_quaternion(new.rotation @ old.rotation.T)) for old, new in pairs]
    return Move(distance, max(float(np.linalg.norm(turn)) for turn in turns))


def _first_variant(mechanism: Mechanism) -> Mechanism:
    """A mechanism with the first variant of its joints and constraints where these have batches of numbers."""
    own = {name: _first(getattr(mechanism, name)) for name in ("joints", "closing", "constraints")}
    if all(own[name] is getattr(mechanism, name) for name in own):
        return mechanism
    return dataclasses.replace(mechanism, **own)


def _first(value: Any) -> Any:
    """A value with the first variant of each batch in it."""
    match value:
        case Batch():
            return value.values[0]
        case tuple():
            parts = tuple(_first(one) for one in value)
            return value if all(new is old for new, old in zip(parts, value, strict=True)) else parts
        case Mapping():
            items = {key: _first(one) for key, one in value.items()}
            return value if all(items[key] is value[key] for key in items) else items
        case _ if dataclasses.is_dataclass(value) and not isinstance(value, type):
            fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
            changed = {name: new for name, old in fields.items() if (new := _first(old)) is not old}
            return dataclasses.replace(value, **changed) if changed else value
    return value
