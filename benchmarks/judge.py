"""The reference: energies, constraint violation, accelerations, and the state after three seconds."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.plan import Array
from mbd_sim import Simulation

END = 3.0  # s


class Judge:
    """Measures the states of all simulators with the same functions."""

    def __init__(self, text: str) -> None:
        self.sim = Simulation.from_text(text)
        self._model = self.sim.model

    def _y(self, q: Array, u: Array) -> Array:
        y = self._model.start.copy()
        y[self._model.q_range], y[self._model.u_range] = q, u
        return y

    def energy(self, q: Array, u: Array) -> float:
        """T + V in J."""
        return self._model.energies(0.0, self._y(q, u)).total

    def violation(self, q: Array, u: Array) -> float:
        """The violation of the loops in m."""
        return self._model.violation(0.0, self._y(q, u)).position

    def accelerations(self, q: Array, u: Array) -> Array:
        """Without efforts."""
        return self._rates(self._y(q, u))[self._model.u_range]

    def _rates(self, y: Array) -> Array:
        rates = self._model.equations.rates
        found = rates.call([0.0, y, np.zeros(len(self.sim.u))])[0]
        return np.array(found).ravel()

    @cached_property
    def _reference(self) -> Array:
        """(n, steps): the states from 0 to END by SciPy's adaptive DOP853 at its tightest tolerance."""
        size = self._model.u_range.stop
        y = self._model.start.copy()

        def rates(_: float, state: Array) -> Array:
            y[:size] = state
            return self._rates(y)[:size]

        times = np.linspace(0.0, END, 61)
        return solve_ivp(rates, (0.0, END), y[:size].copy(), "DOP853", times, rtol=2.3e-14, atol=1e-14).y

    @cached_property
    def largest_kinetic_energy(self) -> float:
        """In J, over the first three seconds: to which energy drifts are relative."""
        count = len(self.sim.q)
        states = self._reference.T
        return max(self._model.energies(0.0, self._y(state[:count], state[count:])).kinetic for state in states)

    def error(self, q: Array, u: Array) -> float:
        """Of a state at t = END, relative to its largest component."""
        expected = self._reference[:, -1]
        return float(np.max(np.abs(np.concatenate([q, u]) - expected)) / np.max(np.abs(expected)))
