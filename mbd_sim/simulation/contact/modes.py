"""Which gaps are closed, and which contacts stick or slide, at one instant.

Without a jump of speeds, forces are sought that keep the accelerations of all touching contacts admissible.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.simulation.contact.candidates import ATTEMPTS, NOTHING_FORCED, RESTING, Candidates, Forced, euclidean_norm
from mbd_sim.simulation.contact.problem import NoSolutionError
from mbd_sim.simulation.contact.terms import Mask, OneSidedModel, OneSidedReadings, OneSidedTerms


class ModeFinder:
    """Finds the modes of a contact model; `touching` is the gap in natural units that counts as zero."""

    def __init__(self, model: OneSidedModel, touching: float) -> None:
        self._model, self._touching = model, touching

    def is_touching(self, readings: OneSidedReadings) -> Mask:
        """Which gaps (gaps,) are zero; for clutches, whether they do not slip."""
        clutches = self._model.clutches
        limit = np.where(clutches, RESTING, self._touching)
        return np.asarray(readings.gaps <= limit * self._model.gap_units, dtype=bool)

    def find(self, time: float, y: Array, inputs: Array, forced: Forced = NOTHING_FORCED) -> Array:
        """The modes (see `OneSidedLayout`) at a state without approaching contacts.

        :raises NoSolutionError: no forces are admissible.
        """
        inputs = inputs.copy()
        for _ in range(ATTEMPTS):
            readings, terms = self._model.readings(time, y, inputs), self._model.terms(time, y, inputs)
            state = Candidates(self._model, readings, terms, self.is_touching(readings), forced)
            modes, wrong = state.solved(self._model.modes(inputs))
            if wrong is not None:
                forced = wrong
                continue
            self._model.modes(inputs)[:] = modes
            guards = self._model.readings(time, y, inputs)
            overloaded = self._overloaded(guards, terms, modes)
            if not overloaded:
                return modes
            forced = replace(forced, overloaded=forced.overloaded | overloaded)
        raise NoSolutionError("the contacts keep changing their states")

    def _overloaded(self, found: OneSidedReadings, terms: OneSidedTerms, modes: Array) -> frozenset[int]:
        """Sticking elements that carry more than they can, as where several share a load that is indeterminate."""
        model, overloaded = self._model, set[int]()
        sliding, active = model.sliding(modes), modes[model.layout.active]
        scale = model.loads * (1.0 + float(np.max(np.abs(found.forces) / model.loads, initial=0.0)))
        for index, (rows, gap) in enumerate(model.frictions):
            if index in sliding or not any(active[list(rows)]):
                continue
            force = found.forces[list(rows)]
            load = (
                terms.load(index, found.forces) if index in model.loaded else 1.0 if gap is None else found.forces[gap]
            )
            if euclidean_norm(force) > terms.sizes[index, 1] * load + 1e-9 * scale[rows[0]]:
                overloaded.add(index)
        return frozenset(overloaded)
