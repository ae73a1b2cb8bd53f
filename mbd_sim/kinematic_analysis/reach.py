"""How far a drive can go, and errors that say so."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbd_sim.errors import InputError
from mbd_sim.interrupts import interruptible_tracing
from mbd_sim.kinematic_analysis.curve_tracing import TracedCurve, traced_curve
from mbd_sim.kinematic_analysis.drive_line import CurvePoint, DriveLine
from mbd_sim.kinematic_analysis.kinematic_system import KinematicSystem, UnreachableError
from mbd_sim.kinematic_analysis.prescribed_drives import is_rotation
from mbd_sim.kinematic_analysis.singular_points import VANISHING, Kind, is_singular
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.short_repr import short_repr

TURN = 2.0 * np.pi
FAR = 20.0  # sizes of the mechanism, up to which displacements are followed


@dataclass(frozen=True)
class ReachableRange:
    """The interval of a drive in rad or m that can be reached from the start position, and what bounds it.

    An angle that goes round, and a displacement that has no end within a large distance, are infinite, with a bound "".
    """

    lower: float
    upper: float
    lower_bound: Kind | str
    upper_bound: Kind | str

    __repr__ = short_repr


@interruptible_tracing()
def reachable_range(mechanism: Mechanism, drive: str) -> ReachableRange:
    """How far the only drive of a mechanism can go in either direction from the start position in the file.

    :raises InputError: there is no such coordinate, or the mechanism has several degrees of freedom.
    :raises MechanismError: see `KinematicSystem`.
    """
    return _reach(KinematicSystem(mechanism, [drive]))


def _reach(system: KinematicSystem) -> ReachableRange:
    name, start = system.drives[0], system.start[system.q_driven]
    travel = TURN if is_rotation(system.mechanism, name) else FAR * system.constraints.size
    ends: list[tuple[float, Kind | str]] = []
    for sign in (-1.0, 1.0):
        line = DriveLine(system, start, start + sign * travel)
        curve = traced_curve(line, line.forward(system.start, 0.0, 1.0), through=False)
        if curve.singular:
            point = curve.singular[-1][1]
            ends.append((float(line.drives(point.s)[0]), point.kind))
        else:
            ends.append((sign * np.inf, ""))
    return ReachableRange(ends[0][0], ends[1][0], ends[0][1], ends[1][1])


def require_regular(system: KinematicSystem, line: DriveLine, first: CurvePoint) -> None:
    """Refuse to begin at a dead point or a change point, where the direction of the motion is not determined.

    :raises UnreachableError: the motion begins at one.
    """
    if is_singular(first.margin) or abs(first.pace) < VANISHING:
        kind = "change point" if is_singular(first.margin) else "dead point"
        raise UnreachableError(
            f"{system.mechanism.name}: the motion begins at a {kind}, at {_where(system, line, first.s)}, where its "
            "direction is not determined. Begin the range beside it."
        )


def require_reached(system: KinematicSystem, line: DriveLine, curve: TracedCurve) -> None:
    """Refuse a range that ends at a dead point or a change point.

    :raises UnreachableError: with the point and the reachable interval.
    """
    if not curve.singular and curve.points[-1].s == 1.0:
        return
    if not curve.singular:
        raise UnreachableError(f"{system.mechanism.name}: the end of the range cannot be reached. Give a shorter one.")
    point = curve.singular[-1][1]
    text = f"{system.mechanism.name}: the drive cannot go on at the {point.kind} at {_where(system, line, point.s)}."
    if len(system.drives) == 1:
        text += " " + _interval(system)
    raise UnreachableError(
        f"{text} Give a range within, or follow the motion through such points with --through-dead-points "
        '(dead_points="follow").'
    )


def _where(system: KinematicSystem, line: DriveLine, s: float) -> str:
    named = zip(system.drives, line.drives(s).tolist(), strict=True)
    return ", ".join(f"{name} = {shown(system.mechanism, name, value)}" for name, value in named)


def _interval(system: KinematicSystem) -> str:
    name = system.drives[0]
    try:
        reach = _reach(system)
    except InputError:
        return ""
    if np.isinf(reach.lower) and np.isinf(reach.upper):
        return ""
    first = "anywhere" if np.isinf(reach.lower) else shown(system.mechanism, name, reach.lower)
    last = "anywhere" if np.isinf(reach.upper) else shown(system.mechanism, name, reach.upper)
    start = shown(system.mechanism, name, float(system.start[system.q_driven][0]))
    return f"From the start position of the file, {start}, {name} reaches from {first} to {last}."


def shown(mechanism: Mechanism, name: str, value: float) -> str:
    """A coordinate for people: in degrees or in m."""
    return value_shown(value, rotation=is_rotation(mechanism, name))


def value_shown(value: float, *, rotation: bool) -> str:
    """An angle in rad or a displacement in m for people."""
    if rotation:
        return f"{round(float(np.degrees(value)), 9) + 0.0:.6g} deg"
    return f"{round(value, 12) + 0.0:.6g} m"
