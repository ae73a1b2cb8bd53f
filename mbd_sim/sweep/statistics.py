"""The last, least, most and root-mean-square values of quantities over the samples of runs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from mbd_sim.geometry.pose import Array
from mbd_sim.simulation.ensemble import Ensemble
from mbd_sim.sweep.quantities import EVENTS, EventCounts, Quantity, Sample

STATISTICS = ("final", "least", "most", "rms")


class Statistics:
    """Statistics of named quantities of an ensemble; of events only their numbers.

    The samples have equal distances in time, and count equally in the root mean square.
    """

    def __init__(self, quantities: Mapping[str, Quantity], ensemble: Ensemble) -> None:
        """Take the first sample; events are counted from here on."""
        self._quantities, self._ensemble = quantities, ensemble
        self._counts = [EventCounts() for _ in range(len(ensemble))]
        if any(name.startswith(EVENTS) for name in quantities):
            ensemble.observe_contacts(self._counts)
        self._last = self._sampled()
        self._least, self._most, self._squares, self._samples = self._last, self._last, self._last**2, 1

    def sample(self) -> None:
        """Take a sample of the present states."""
        self._last = self._sampled()
        self._least, self._most = np.minimum(self._least, self._last), np.maximum(self._most, self._last)
        self._squares, self._samples = self._squares + self._last**2, self._samples + 1

    def columns(self) -> dict[str, Array]:
        """A column (runs,) for each of `column_names`."""
        statistics = (self._last, self._least, self._most, np.sqrt(self._squares / self._samples))
        found: dict[str, Array] = {}
        for row, name in enumerate(self._quantities):
            columns = [values[row] for values in statistics]
            found |= dict(zip(column_names([name]), columns, strict=False))
        return found

    def _sampled(self) -> Array:
        """(quantities, runs)."""
        sample = Sample(self._ensemble, self._counts)
        values = [quantity(sample) for quantity in self._quantities.values()]
        return np.array(values).reshape(len(values), len(self._ensemble))


def column_names(quantities: Iterable[str]) -> list[str]:
    """The names of the columns of quantities: one for the number of events, otherwise one for each statistic."""
    return [
        column
        for name in quantities
        for column in ([name] if name.startswith(EVENTS) else [f"{name}.{statistic}" for statistic in STATISTICS])
    ]
