"""Mass, first and second moments of parts, which are polynomials in masses and lengths also for composite parts."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import Part


@dataclass(frozen=True, eq=False)
class MassMoments:
    """Of a part about the origin of its frame, in its axes.

    `mass` in kg, `first` (3,) = m c in kg·m with the center of mass c, and `second` (3, 3), the inertia tensor, in
    kg·m².
    """

    mass: float | ca.SX
    first: Array | ca.SX
    second: Array | ca.SX


def mass_moments(part: Part) -> MassMoments:
    """Those of a part in numbers (Huston & Liu, sec. 7.6: the parallel axis theorem)."""
    c = part.center
    return MassMoments(part.mass, part.mass * c, part.inertia + part.mass * (c @ c * np.eye(3) - np.outer(c, c)))
