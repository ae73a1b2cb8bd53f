"""The energy residual as it is shown on a logarithmic scale."""

from __future__ import annotations

import numpy as np

from mbd_sim.geometry.pose import Array

LEAST = 1e-18  # J


def residual_magnitude(audit: Array) -> Array:
    """The size (n,) in J of the residual in rows (n, 7) of `Energies`.

    It is never less than the rounding of the energies that it is the difference of: below that it says nothing, and a
    residual that happens to be 0 would have no place on the scale.
    """
    rounding = np.finfo(float).eps * np.max(np.abs(audit[:, :6]), axis=1, initial=0.0)
    return np.asarray(np.maximum(np.abs(audit[:, 6]), np.maximum(0.5 * rounding, LEAST)))
