"""Points at which the drives do not determine the motion: dead points and change points, located to round-off.

At a dead point the drives reverse: their velocity along the curve of configurations is zero, and the determinant of the
equations for the dependent velocities with it. At a change point the equations of the curve themselves lose rank: two
branches of the motion meet, as in a parallelogram linkage lying flat (Uicker, Pennock & Shigley, ch. 1).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from mbd_sim.geometry.pose import Array
from mbd_sim.kinematic_analysis.drive_line import CurvePoint, DriveLine
from mbd_sim.kinematic_analysis.golden_section import least_place
from mbd_sim.simulation.event_location import first_zero

VANISHING = 1e-6  # margin that counts as zero, at a point found to round-off
FARTHEST = 0.5  # rad, or sizes of the mechanism, within which a dead point is sought
NODES = np.array([-1.0, -0.85, -0.6, -0.35, 0.35, 0.6, 0.85, 1.0])  # of the interpolation about a change point
NEIGHBORHOOD = 0.06  # rad, or sizes of the mechanism, of this interpolation
SECTIONS = 16  # of the golden section search for the least margin

Kind = Literal["dead point", "change point"]


@dataclass(frozen=True, eq=False)
class SingularPoint:
    """The configuration q (nq,) of a singular point at the place s on the line of the drives."""

    q: Array
    s: float
    kind: Kind


def is_singular(margin: float) -> bool:
    """Whether a point is a change point."""
    return margin < VANISHING


def dead_point(line: DriveLine, before: CurvePoint, after: CurvePoint) -> SingularPoint:
    """The dead point between two points of the curve, where the pace of the drives changes its sign."""
    if after.pace == 0.0:
        return SingularPoint(after.q, after.s, "dead point")
    sign = 1.0 if before.pace > 0.0 else -1.0

    def pace(distance: float) -> float:
        found = line.beyond(before, distance)
        return float("nan") if found is None else sign * found.pace

    length = 1e-3
    while not (end := pace(length)) < 0.0 and length < FARTHEST:
        length *= 1.5
    distance = first_zero(pace, length, sign * before.pace, end, 1e-12)
    found = line.beyond(before, distance)
    assert found is not None
    return SingularPoint(found.q, found.s, "dead point")


def change_point(line: DriveLine, low: CurvePoint, middle: CurvePoint, high: CurvePoint) -> SingularPoint | None:
    """The change point among three points of the curve in order; None if the margin does not vanish there.

    The first two points may be the same: then the margin changes its sign between them and the third.

    The margin, with the sign changed on one side, is an analytic function of s. Its zero follows from interpolation at
    places on both sides, at which the equations are regular.
    """
    place = _lowest(line, low, middle, high)
    reach = NEIGHBORHOOD / line.length
    values, configurations = [], []
    for s in place + reach * NODES:
        found = _at(line, low, high, float(s))
        if found is None:
            return None
        values.append(found.margin)
        configurations.append(found.q)
    signed = np.array(values) * np.sign(NODES)
    polynomial = np.polyfit(NODES, signed, len(NODES) - 1)
    roots = np.roots(polynomial)
    real = roots[np.abs(roots.imag) < 1e-9].real
    if not len(real) or abs(root := float(real[np.argmin(np.abs(real))])) > 0.3:
        return None
    near = _at(line, low, high, place + reach * (root + 1e-3))
    if near is None or near.margin > 0.02 * max(values):
        return None
    q = np.array([np.polyval(np.polyfit(NODES, column, len(NODES) - 1), root) for column in np.array(configurations).T])
    s = place + reach * root
    return SingularPoint(q, s, "change point")


def _lowest(line: DriveLine, low: CurvePoint, middle: CurvePoint, high: CurvePoint) -> float:
    """Where the margin is least, nearly."""
    a, b = low.s, high.s
    if middle is low:  # one interval, in which the margin changes its sign
        return (a * high.margin + b * low.margin) / (low.margin + high.margin)

    def margin(s: float) -> float:
        found = _at(line, low, high, s)
        return np.inf if found is None else found.margin

    return least_place(margin, a, b, SECTIONS)


def _at(line: DriveLine, low: CurvePoint, high: CurvePoint, s: float) -> CurvePoint | None:
    """The point at s of the branch through two points."""
    part = (s - low.s) / (high.s - low.s)
    guess = line.system.displaced(low.q + part * (high.q - low.q), np.zeros(line.system.layout.nv))
    q = line.system.closed_at(guess, line.drives(s))
    return None if q is None else line.point(q, s, low.tangent)
