"""Mass, mass center and inertia of bodies and of composites (Huston & Liu, ch. 7).

An inertia is a symmetric matrix (3, 3) in kg·m² about the mass center: I = ∫ (r·r 1 - r rᵀ) dm, so its products
are I_xy = -∫ x y dm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbd_sim.errors import InputError
from mbd_sim.geometry import rotation as rot
from mbd_sim.geometry.batch import fsum
from mbd_sim.geometry.pose import Array, Pose


@dataclass(frozen=True, eq=False)
class MassProperties:
    """`mass` in kg, `center` (3,) in m, `inertia` (3, 3) in kg·m² about `center`."""

    mass: float
    center: Array
    inertia: Array

    def scaled(self, factor: float) -> MassProperties:
        """The properties of the body with `factor` times the mass."""
        return MassProperties(self.mass * factor, self.center, self.inertia * factor)

    def placed(self, pose: Pose) -> MassProperties:
        """These properties in the outer frame of `pose`."""
        center = pose.position + pose.rotation @ self.center
        return MassProperties(self.mass, center, pose.rotation @ self.inertia @ pose.rotation.T)

    def about(self, point: Array) -> Array:
        """The inertia (3, 3) about another point: the parallel axis theorem (Huston & Liu, sec. 7.6)."""
        k = rot.skew(self.center - point)
        return self.inertia - self.mass * (k @ k)


def composite(bodies: Sequence[MassProperties]) -> MassProperties:
    """Several bodies as one; holes have negative mass.

    :raises InputError: the holes remove all mass.
    """
    if not any(body.mass for body in bodies):
        return MassProperties(0.0, np.zeros(3), np.zeros((3, 3)))
    mass = fsum([body.mass for body in bodies])
    if mass <= 1e-12 * fsum([abs(body.mass) for body in bodies]):
        raise InputError(f"the holes remove all the mass: {mass:g} kg is left", "Make them smaller or lighter.")
    center = sum((body.mass * body.center for body in bodies), np.zeros(3)) / mass
    inertia = sum((body.about(center) for body in bodies), np.zeros((3, 3)))
    return MassProperties(mass, center, inertia)


def inertia_defect(inertia: Array) -> str | None:
    """Why no rigid body has this inertia (3, 3), or None: moments must be ≥ 0 and satisfy the triangle inequality."""
    if not np.all(np.isfinite(inertia)):
        return None  # the parameters that cause this are reported
    moments = np.linalg.eigvalsh(inertia)
    slack = 1e-9 * np.maximum(np.max(np.abs(moments)), 1e-300)
    defect = None
    if moments[0] < -slack:
        defect = "has a negative principal moment"
    elif moments[0] + moments[1] < moments[2] - slack:
        defect = "violates the triangle inequality: the largest principal moment exceeds the sum of the others"
    if defect is None:
        return None
    return f"{defect} (principal moments {', '.join(f'{moment:.6g}' for moment in moments)} kg·m²)"
