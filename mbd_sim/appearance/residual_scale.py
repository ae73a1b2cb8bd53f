"""The energy residual as it is shown on a logarithmic scale."""

from __future__ import annotations

import numpy as np

from mbd_sim.geometry.pose import Array

MIN_RESIDUAL = 1e-18  # J


def residual_magnitude(energies: Array) -> Array:
    """The magnitude (n,) in J of the residual in rows (n, 7) of `Energies`.

    It is bounded below by the rounding error of the energies that it is the difference of: smaller values are not
    significant, and zero has no place on a logarithmic scale.
    """
    rounding = np.finfo(float).eps * np.max(np.abs(energies[:, :6]), axis=1, initial=0.0)
    return np.asarray(np.maximum(np.abs(energies[:, 6]), np.maximum(0.5 * rounding, MIN_RESIDUAL)))
