"""What the errors of a sensor do to its exact values."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.sensors import ErrorModel
from mbd_sim.sensing.noise import Noise


class MeasurementErrors:
    """The errors of the components of a sensor's quantities, in order; see `ErrorModel`.

    `deviations` (n,) are the standard deviations of the white noise, `resolutions` (n,) those of `ErrorModel`.
    """

    def __init__(self, models: Sequence[ErrorModel], sizes: Sequence[int], period: float, noise: Noise) -> None:
        """Take an error model for each quantity, the number of its components, and the time between samples in s."""

        def each(values: Sequence[float]) -> Array:
            return np.repeat(np.array(values, dtype=float), sizes)

        self._noise = noise
        self.deviations = each([model.noise_density / math.sqrt(period) for model in models])
        self.resolutions = each([model.resolution for model in models])
        self._bias = each([model.bias for model in models])
        self._walk = each([model.bias_walk * math.sqrt(period) for model in models])
        self._limit = each([model.limit for model in models])
        self._adds = bool(np.any(self._bias) or np.any(self._walk) or np.any(self.deviations))
        self._rounded = np.flatnonzero(self.resolutions)
        self._steps = self.resolutions[self._rounded]
        self._limits = bool(np.any(np.isfinite(self._limit)))
        self._walks, self._is_noisy = bool(np.any(self._walk)), bool(np.any(self.deviations))

    def added(self, sample: int) -> Array | None:
        """(n,) what is added to the exact values; None if nothing ever is."""
        if not self._adds:
            return None
        error = self._bias.copy()
        if self._walks:
            error += self._walk * self._noise.walk(sample)
        if self._is_noisy:
            error += self.deviations * self._noise.white(sample)
        return error

    def rounded_and_limited(self, values: Array) -> Array:
        """(n,) values as multiples of the resolution, ties to even ones, within the limits."""
        if len(self._rounded):
            values = values.copy()
            values[self._rounded] = np.rint(values[self._rounded] / self._steps) * self._steps
        return np.maximum(np.minimum(values, self._limit), -self._limit) if self._limits else values
