"""The motion of a mechanism with one-sided rows from one state on, as the search for events tries it."""

from __future__ import annotations

import numpy as np

from mbd_sim.geometry.pose import Array
from mbd_sim.simulation.contact_terms import OneSidedModel, OneSidedReadings, address


class TrialMotion:
    """The motion from one state on, with all that was computed of it."""

    def __init__(self, model: OneSidedModel, y: Array, inputs: Array, t: float) -> None:
        self._model, self._y, self._inputs, self._t = model, y, inputs, t
        self._states: dict[float, Array] = {0.0: y.copy()}
        self._readings: dict[float, OneSidedReadings] = {}

    def state(self, length: float) -> Array:
        """The state after a length in s."""
        found = self._states.get(length)
        if found is None:
            found = self._y.copy()
            self._model.kernel.part_step(address(found), address(self._inputs), self._t, length)
            if not np.isfinite(found).all():
                raise FloatingPointError
            self._states[length] = found
        return found

    def readings(self, length: float) -> OneSidedReadings:
        """The readings after a length in s."""
        found = self._readings.get(length)
        if found is None:
            found = self._model.readings(self._t + length, self.state(length), self._inputs)
            self._readings[length] = found
        return found
