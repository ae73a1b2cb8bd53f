"""Keeping time: absolute deadlines on the steady clock, and what became of them."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

RE_ANCHOR = 0.1  # seconds of lateness after which the schedule starts anew instead of catching up in a burst


@dataclass(frozen=True)
class Lateness:
    """How late the steps began, in s, over the last few thousand wake-ups."""

    median: float
    p99: float
    maximum: float


class Pacer:
    """Says when the next steps are due. `overruns` counts the times that the schedule had to start anew."""

    def __init__(self) -> None:
        self.overruns = 0
        self._due = time.perf_counter()
        self._late = np.zeros(4096)
        self._count = 0

    def anchor(self) -> None:
        """Start the schedule now."""
        self._due = time.perf_counter()

    def wait(self, duration: float) -> None:
        """Sleep until `duration` seconds after the last deadline."""
        self._due += duration
        rest = self._due - time.perf_counter()
        if rest > 0.0:
            time.sleep(rest)
        late = time.perf_counter() - self._due
        self._late[self._count % len(self._late)] = late
        self._count += 1
        if late > RE_ANCHOR:
            self.overruns += 1
            self.anchor()

    def lateness(self) -> Lateness:
        """The figures of the last few thousand deadlines."""
        late = self._late[: min(self._count, len(self._late))]
        if not len(late):
            return Lateness(0.0, 0.0, 0.0)
        median, p99 = np.quantile(late, [0.5, 0.99])
        return Lateness(float(median), float(p99), float(np.max(late)))
