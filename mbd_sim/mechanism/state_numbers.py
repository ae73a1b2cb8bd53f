"""The numbers that the names in an expression stand for at a state, for messages and pictures."""

from __future__ import annotations

from mbd_sim.errors import InputError
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.drives import STATES, CommandedDrive, commanded_drives
from mbd_sim.mechanism.expression import TIME, StateName, TimeExpression
from mbd_sim.mechanism.records import Mechanism

DIFFERENCE = 1e-6  # s, for the speeds of driven joints


def state_numbers(mechanism: Mechanism, expression: TimeExpression, time: float, y: Array) -> dict[str, float]:
    """The time and the coordinates and speeds in an expression, by the names that it uses.

    :param y: the state of the mechanism, which begins with its coordinates and speeds.
    """
    found = {TIME: time} if TIME in expression.variables else {}
    for name in expression.state:
        found[name.written] = _number(mechanism, name, time, y)
    return found


def _number(mechanism: Mechanism, name: StateName, time: float, y: Array) -> float:
    moving = [joint for joint in mechanism.joints.values() if not joint.drive]
    owner = next((joint for joint in mechanism.joints.values() if name.coordinate in joint.motion_names), None)
    if owner is None:
        return float("nan")
    index = owner.motion_names.index(name.coordinate)
    drives = list(commanded_drives(mechanism))
    coordinates = sum(joint.kind.nq for joint in moving)
    if isinstance(owner.drive, CommandedDrive):
        return float(y[coordinates + STATES * drives.index(owner.name) + name.speed])
    if owner.drive:
        return _driven(owner.drive[index], name.speed, time)
    before = moving[: moving.index(owner)]
    if name.speed:
        start = coordinates + STATES * len(drives) + sum(joint.kind.nv for joint in before)
    else:
        start = sum(joint.kind.nq for joint in before)
    return float(y[start + index])


def _driven(drive: TimeExpression, speed: bool, time: float) -> float:
    try:
        if not speed:
            return drive.at(time)
        return (drive.at(time + DIFFERENCE) - drive.at(time - DIFFERENCE)) / (2.0 * DIFFERENCE)
    except InputError:
        return float("nan")


def value_at(mechanism: Mechanism, expression: TimeExpression, time: float, y: Array) -> float:
    """The value of an expression of the time and the state.

    :raises InputError: it has no finite value.
    """
    return expression.value(state_numbers(mechanism, expression, time, y))
