"""Where a quantity of a motion is least and greatest, between the rows of a table as well."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.interrupts import interruptible
from mbd_sim.base.roots import first_zero
from mbd_sim.base.short_repr import short_repr
from mbd_sim.studies.kinematic_analysis.drive_line import least_place
from mbd_sim.studies.kinematic_analysis.loads import CouplerAndFollower, TransmissionAngle
from mbd_sim.studies.kinematic_analysis.motion import DrivenMotion

STANDSTILL = 1e-12  # velocity of an output, relative to the largest, that is round-off
ROUNDING = 1e-12  # by which a value between two rows must be more extreme than in them
SECTIONS = 60  # of the golden section search


@dataclass(frozen=True)
class Extreme:
    """An extreme `value` of a quantity, in rad or m, where the first moving drive is at `drive` in rad or m."""

    value: float
    drive: float
    greatest: bool

    __repr__ = short_repr


@interruptible()
def limit_positions(motion: DrivenMotion, output: str) -> tuple[Extreme, ...]:
    """The positions in rad or m at which a coordinate reverses, in the order of the motion.

    There its mechanical advantage is infinite; driven by this coordinate, the mechanism would have dead points there.

    :raises InputError: there is no such coordinate.
    """
    motion.require_output(output)
    ratios, found = motion.ratio(output).copy(), list[Extreme]()
    ratios[np.abs(ratios) <= STANDSTILL * np.nanmax(np.abs(ratios), initial=0.0)] = 0.0
    for row in range(len(motion) - 1):
        before, after = float(ratios[row]), float(ratios[row + 1])
        begins = row == 0 and before == 0.0 and after != 0.0
        # A limit position in a row belongs to the interval before it.
        if not (before * after < 0.0 or (after == 0.0 and before != 0.0) or begins):
            continue
        width, sign = float(motion.s[row + 1] - motion.s[row]), 1.0 if before > 0.0 else -1.0

        def slope(part: float, row: int = row, width: float = width, sign: float = sign) -> float:
            return sign * _ratio(motion, output, motion.at(row, float(motion.s[row]) + part * width))

        part = 0.0 if begins else 1.0 if after == 0.0 else first_zero(slope, 1.0, sign * before, sign * after, 1e-9)
        s = float(motion.s[row]) + part * width
        drive = float(motion.line.drives(s)[motion.leading])
        rising = after < 0.0 if begins else before > 0.0
        greatest = bool(rising == (motion.direction[row] > 0.0))
        found.append(Extreme(_position(motion, output, motion.at(row, s)), drive, greatest))
    return tuple(found)


def _ratio(motion: DrivenMotion, output: str, q: Array) -> float:
    """The velocity of an output for a unit speed of the drive; nan at a dead point."""
    rates = motion.unit_rates(q)
    if rates is None:
        return float("nan")
    if output in motion.mechanism.closing:
        return motion.closing_joint(output).rates(q, *rates)[0]
    return float(rates[0][motion.index(output)])


def _position(motion: DrivenMotion, output: str, q: Array) -> float:
    if output in motion.mechanism.closing:
        return motion.closing_joint(output).position(q)
    return float(q[motion.columns[motion.index(output)]])


@interruptible()
def transmission_extremes(motion: DrivenMotion, joints: CouplerAndFollower) -> tuple[Extreme, Extreme]:
    """The least and the greatest transmission angle in rad."""
    angle = TransmissionAngle(motion.system, joints)
    values = np.array([angle(q) for q in motion.q])
    return _extreme(motion, angle, values, greatest=False), _extreme(motion, angle, values, greatest=True)


def _extreme(motion: DrivenMotion, angle: TransmissionAngle, values: Array, *, greatest: bool) -> Extreme:
    sign = -1.0 if greatest else 1.0
    row = int(np.argmin(sign * values))
    best, place = float(values[row]), float(motion.s[row])
    singular = {one.row for one in motion.singular}

    def signed(first: int, s: float) -> float:
        try:
            return sign * angle(motion.at(first, s))
        except InputError:
            if singular.isdisjoint((first, first + 1)):
                raise
            return np.inf  # two configurations meet in the singular row, and Newton's method fails so close to it

    for first in (row - 1, row):
        if 0 <= first < len(motion) - 1:
            low, high = float(motion.s[first]), float(motion.s[first + 1])
            s = least_place(partial(signed, first), low, high, SECTIONS)
            if (value := signed(first, s)) < sign * best - ROUNDING:
                best, place = sign * value, s
    return Extreme(best, float(motion.line.drives(place)[motion.leading]), greatest)
