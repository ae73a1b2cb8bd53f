"""Keeping time: absolute deadlines on the steady clock, and what became of them."""

from __future__ import annotations

import array
import threading
import time
from typing import NamedTuple

import numpy as np

from mbd_sim.geometry.pose import Array

LONG = 0.02  # seconds from which a sleep can be ended early; shorter ones are plain sleeps, which wake more punctually
RE_ANCHOR = 0.1  # seconds of lateness after which the schedule starts anew instead of catching up in a burst
BIN = 1e-5  # s, the resolution of the figures
BINS = 10_000  # up to 0.1 s; the last one holds all that is longer


class Spread(NamedTuple):
    """What a histogram holds, in s: median, 99th percentile and maximum, to a resolution of `BIN`."""

    median: float
    p99: float
    maximum: float


class Histogram:
    """Counts durations. Adding one allocates nothing; another thread may read meanwhile."""

    def __init__(self) -> None:
        self._counts = array.array("q", bytes(8 * (BINS + 1)))
        self._longest = 0.0

    def add(self, seconds: float) -> None:
        """Count a duration in s; one below zero counts as zero."""
        index = int(seconds / BIN) if seconds > 0.0 else 0
        self._counts[index if index < BINS else BINS] += 1
        if seconds > self._longest:
            self._longest = seconds

    def counts(self) -> Array:
        """A copy of the counts (BINS + 1,), from which `spread` tells what came later."""
        return np.array(self._counts, dtype=float)

    def spread(self, since: Array | None = None) -> Spread:
        """The figures of all durations, or of those since an earlier `counts()`; zeros where there are none."""
        counts = self.counts() if since is None else self.counts() - since
        running = np.cumsum(counts)
        if not running[-1]:
            return Spread(0.0, 0.0, 0.0)
        median, p99 = (int(np.searchsorted(running, part * running[-1])) for part in (0.5, 0.99))
        maximum = int(np.nonzero(counts)[0][-1])
        return Spread(*(self._longest if index >= BINS else (index + 0.5) * BIN for index in (median, p99, maximum)))


class Pacer:
    """Says when the next steps are due.

    `overruns` counts the times that the schedule had to start anew; `lateness` and `period` hold how late the steps
    began after their deadlines and after the steps before.
    """

    def __init__(self) -> None:
        self.overruns = 0
        self.lateness, self.period = Histogram(), Histogram()
        self._due = self._woke = time.perf_counter()
        self._anchored = True

    def anchor(self) -> None:
        """Start the schedule now."""
        self._due = time.perf_counter()
        self._anchored = True

    def plan(self, duration: float) -> None:
        """Set the next deadline, `duration` seconds after the last one."""
        self._due += duration

    def wait(self, wake: threading.Event) -> bool:
        """Sleep until the deadline; False where a long sleep was ended by `wake`, before the deadline."""
        rest = self._due - time.perf_counter()
        if rest > LONG and wake.wait(rest):
            return False
        if 0.0 < rest <= LONG:
            time.sleep(rest)
        now = time.perf_counter()
        late = now - self._due
        self.lateness.add(late)
        if not self._anchored:
            self.period.add(now - self._woke)
        self._anchored, self._woke = False, now
        if late > RE_ANCHOR:
            self.overruns += 1
            self.anchor()
        return True
