"""Centrodes and inflection circles: the paths of the instant center of two links, in one link and in the other.

The moving centrode rolls on the fixed one. Points on the inflection circle have no normal acceleration: it passes
through the pole P and the inflection pole P + a_P/ω², where a_P is the acceleration of the moving link's point at P,
so that its diameter is |a_P|/ω² (Bottema & Roth 1979, ch. 8).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.errors import InputError, nearest
from mbd_sim.base.short_repr import record
from mbd_sim.mechanism.elements.parts import GROUND
from mbd_sim.studies.plane_motion.snapshot import PlanarDrive, PlaneSnapshot

Complexes = NDArray[np.complex128]

SLOW = 1e-6  # angular velocity relative to the largest, at which the pole counts as infinite


@record
class Centrodes:
    """The pole of a `part` relative to ground over the rows (n,) of a motion, nan where it is at infinity.

    `fixed` (n,) are its places in ground's plane; `moving` (n,) those in the axes of the part.
    """

    part: str
    fixed: Complexes
    moving: Complexes


@record
class InflectionCircle:
    """The `pole` of a part, its `inflection_pole`, and the circle between them: `center` and `radius` in m."""

    part: str
    pole: complex
    inflection_pole: complex

    @property
    def center(self) -> complex:
        """Its center."""
        return 0.5 * (self.pole + self.inflection_pole)

    @property
    def radius(self) -> float:
        """Its radius."""
        return 0.5 * abs(self.inflection_pole - self.pole)


def centrodes(motion: PlanarDrive, part: str) -> Centrodes:
    """The centrodes of a part over the rows of a motion.

    :raises InputError: there is no such part, or it does not move.
    """
    name = _link_of(motion, part)
    rows = [row for row in range(len(motion.motion)) if np.all(np.isfinite(motion.motion.u[row]))]
    links = [motion.at(row).links[name] for row in rows]
    largest = max((abs(link.omega) for link in links), default=0.0)
    fixed = np.full(len(motion.motion), complex(np.nan, np.nan))
    moving = fixed.copy()
    for row, link in zip(rows, links, strict=True):
        if abs(link.omega) > SLOW * largest:
            fixed[row] = 1j * link.velocity / link.omega
            moving[row] = (fixed[row] - link.place) / link.turn
    return Centrodes(part, fixed, moving)


def inflection_circle(snapshot: PlaneSnapshot, part: str) -> InflectionCircle | None:
    """The inflection circle of a part; None if it does not turn at this instant."""
    link = next(one for one in snapshot.links.values() if part in one.parts)
    rates = max(abs(one.omega) for one in snapshot.links.values())
    if abs(link.omega) <= SLOW * rates:
        return None
    pole = 1j * link.velocity / link.omega
    return InflectionCircle(part, pole, pole + link.acceleration_of(pole) / link.omega**2)


def _link_of(motion: PlanarDrive, part: str) -> str:
    """The link of a part.

    :raises InputError: there is none, or it is ground.
    """
    names = [name for group in motion.groups for name in group]
    if part not in names:
        raise InputError(f"there is no part '{part}'", nearest(part, names))
    name = next(group[0] for group in motion.groups if part in group)
    if name == GROUND:
        raise InputError(f"'{part}' does not move", "Name a part that moves.")
    return name
