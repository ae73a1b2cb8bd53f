"""The coordinates that an analysis without dynamics prescribes: their ranges, and the mechanism without its drives."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mbd_sim.dynamics.initial_conditions import rheonomic
from mbd_sim.errors import InputError, MechanismError, Problem, listed, nearest
from mbd_sim.mechanism.drives import CommandedDrive
from mbd_sim.mechanism.names import split_assignment
from mbd_sim.mechanism.records import Joint, Mechanism
from mbd_sim.mechanism_file.bare_angles import bare_argument_remark
from mbd_sim.mechanism_file.override import number_at
from mbd_sim.mechanism_file.value_parser import parse_value, split_unit

EXAMPLE = "Write for example crank=0:360deg, or crank=0:360deg:73 for 73 positions."


@dataclass(frozen=True)
class DriveRange:
    """A coordinate that moves from `start` to `stop`, in rad or m; with `start` = `stop` it is held there."""

    name: str
    start: float
    stop: float


def drive_range(text: str, mechanism: Mechanism) -> tuple[DriveRange, int | None]:
    """Read `NAME=START:STOP`, `NAME=START:STOP:COUNT` or `NAME=VALUE`, and the number of positions if it is given.

    A unit after the last value is that of the first one too, unless this has its own.

    :raises InputError: the text cannot be read, or there is no such coordinate.
    """
    name, rest = split_assignment(text)
    words = [word.strip() for word in rest.split(":")]
    if not all(words) or len(words) > 3:
        raise InputError(f"'{text}' gives no range of a drive", EXAMPLE)
    unit, count = _unit_of(mechanism, name), None
    if len(words) == 3:
        if not words[2].isdigit() or int(words[2]) < 2:
            raise InputError(f"{text}: the number of positions cannot be '{words[2]}'", EXAMPLE)
        count = int(words.pop())
    try:
        if len(words) == 2 and not split_unit(words[0])[1] and (last := split_unit(words[1])[1]):
            words[0] = f"${{{words[0]}}} {last}"
        values = [parse_value(_plain(word), mechanism.parameters, unit) for word in words]
    except InputError as error:
        raise InputError(f"{text}: {error.message}", error.remedy or EXAMPLE) from error
    return DriveRange(name, values[0], values[-1]), count


def bare_range_remark(text: str, mechanism: Mechanism) -> str:
    """A sentence if the text of a range has an angle beyond a full turn without a unit, or ""."""
    name, rest = split_assignment(text)
    values = [_plain(word.strip()) for word in rest.split(":")[:2]]
    if any(split_unit(value)[1] for value in values if isinstance(value, str)) or not is_rotation(mechanism, name):
        return ""
    return bare_argument_remark(text, values)


def drive_speed(text: str, mechanism: Mechanism, drives: Sequence[DriveRange]) -> float:
    """The speed of the first drive that moves, such as `60rpm`, in rad/s or m/s.

    :raises InputError: it is not one.
    """
    moving = next((one.name for one in drives if one.start != one.stop), drives[0].name)
    unit = "rad/s" if is_rotation(mechanism, moving) else "m/s"
    try:
        speed = parse_value(_plain(text), mechanism.parameters, unit)
    except InputError as error:
        raise InputError(f"the speed {text}: {error.message}", error.remedy) from error
    if speed < 0.0:
        raise InputError(f"the speed {text} is negative", "Exchange the ends of the range instead.")
    return speed


def parameter_value(text: str, mechanism: Mechanism) -> tuple[str, float]:
    """The key and the number in SI units of `KEY=VALUE`.

    :raises InputError: the text cannot be read, or its unit does not fit.
    :raises MechanismError: there is no such key.
    """
    key, value = split_assignment(text)
    if not key or not value:
        raise InputError(f"'{text}' gives no value", "Write for example l=0.1mm.")
    return key, parameter_number(text, key, value, mechanism)


def parameter_number(text: str, key: str, value: str, mechanism: Mechanism) -> float:
    """The number in SI units of a `value` for a key of the file, which is part of an argument `text`.

    :raises InputError: it is none, or has a unit that does not fit.
    :raises MechanismError: there is no such key.
    """
    try:
        return number_at(mechanism, key, _plain(value), mechanism.parameters)
    except InputError as error:
        raise InputError(f"{text}: '{value}' {error.message}", error.remedy) from error


def position_count(given: Sequence[tuple[DriveRange, int | None]], default: int) -> int:
    """The number of positions of drives that move together.

    :raises InputError: the ranges contain different numbers.
    """
    counts = {count for _, count in given if count is not None}
    if len(counts) > 1:
        raise InputError("the drives move together, but have different numbers of positions", "Give one number.")
    return counts.pop() if counts else default


def undriven(mechanism: Mechanism, names: Sequence[str]) -> Mechanism:
    """The mechanism at rest, with a coordinate in place of each drive that is among the `names`, where it is at t = 0.

    :raises InputError: there is no such coordinate, or it is named twice, or its motion cannot be prescribed.
    :raises MechanismError: something else depends on time.
    """
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise InputError(f"{listed(twice)} is driven twice", "Give one range.")
    for name in names:
        _unit_of(mechanism, name)
    joints = {
        key: _at_rest(_without_drive(joint) if joint.drive and set(joint.motion_names) & {*names} else joint)
        for key, joint in mechanism.joints.items()
    }
    changed = replace(mechanism, joints=joints)
    if rheonomic(changed):
        what = listed(list(changed.driven_names)) or "its constraints"
        message = f"{mechanism.name} also moves as a function of time: {what}"
        raise MechanismError([Problem(message, "Give a range for these drives too, or a constant in the file.")])
    return changed


def joint_of(mechanism: Mechanism, name: str) -> Joint | None:
    """The joint of the spanning tree to which a coordinate belongs."""
    return next((joint for joint in mechanism.joints.values() if name in joint.motion_names), None)


def is_rotation(mechanism: Mechanism, name: str) -> bool:
    """Whether a coordinate is an angle."""
    joint = joint_of(mechanism, name)
    return joint is not None and joint.kind.coordinates[joint.motion_names.index(name)].rotation


def drivable(mechanism: Mechanism) -> tuple[str, ...]:
    """The coordinates whose motion can be prescribed: all but the rotations of spherical and free joints."""
    return tuple(name for joint in mechanism.joints.values() for name in joint.motion_names if _is_scalar(joint, name))


def coordinate_columns(mechanism: Mechanism) -> tuple[int, ...]:
    """The index in q of each coordinate (nv,) of a mechanism without drives; -1 for rotations in space."""
    found, first = list[int](), 0
    for joint in mechanism.joints.values():
        kind = joint.kind
        plain = kind.nv if kind.quaternion is None else kind.quaternion
        found += [first + index if index < plain else -1 for index in range(kind.nv)]
        first += kind.nq
    return tuple(found)


def coordinate_index(mechanism: Mechanism, name: str) -> int:
    """The index in u of a coordinate of a mechanism without drives.

    :raises InputError: there is none of this name.
    """
    if name not in mechanism.coordinate_names:
        remedy = nearest(name, mechanism.coordinate_names)
        if name in mechanism.closing:
            remedy = f"It closes a loop: write 'cut: true' at another joint of the loop. {remedy}"
        raise InputError(f"there is no coordinate '{name}'", remedy)
    return mechanism.coordinate_names.index(name)


def _is_scalar(joint: Joint, name: str) -> bool:
    kind = joint.kind
    return kind.quaternion is None or not kind.coordinates[joint.motion_names.index(name)].rotation


def _unit_of(mechanism: Mechanism, name: str) -> str:
    known = drivable(mechanism)
    if name in known:
        return "rad" if is_rotation(mechanism, name) else "m"
    if name in mechanism.closing:
        message = f"'{name}' closes a loop, and so has no coordinate that can be driven"
        raise InputError(message, f"Write 'cut: true' at another joint of its loop, or drive one of {listed(known)}.")
    if joint_of(mechanism, name) is not None:
        raise InputError(f"'{name}' is a component of a rotation, which cannot be driven alone", nearest("", known))
    raise InputError(f"there is no coordinate '{name}'", nearest(name, known) or "Nothing in this mechanism moves.")


def _without_drive(joint: Joint) -> Joint:
    if isinstance(joint.drive, CommandedDrive):
        position = [joint.drive.start]
    else:
        position = [expression.at(0.0) for expression in joint.drive]
    count = len(position)
    return replace(
        joint,
        drive=(),
        position=np.array(position),
        velocity=np.zeros(count),
        fixed_in_assembly=(True,) * count,
    )


def _at_rest(joint: Joint) -> Joint:
    return (
        joint
        if joint.drive
        else replace(joint, velocity=np.zeros(joint.kind.nv), fixed_speeds=(False,) * joint.kind.nv)
    )


def _plain(word: str) -> float | str:
    try:
        value = float(word)
    except ValueError:
        return word
    return value if math.isfinite(value) else word
