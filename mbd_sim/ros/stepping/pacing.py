"""When the next steps are due in real time: absolute deadlines on the steady clock, and how well they were met."""

from __future__ import annotations

import array
import threading
import time
from dataclasses import dataclass

import numpy as np

from mbd_sim.base.geometry.pose import Array

# Longer sleeps (s) can be interrupted; shorter ones are plain sleeps, which wake more punctually.
INTERRUPTIBLE_SLEEP = 0.02
LONGEST_SLEEP = 3600.0  # s; a deadline may be further away than threads can wait
MAX_LATENESS = 0.1  # s from which the schedule restarts instead of catching up in a burst
BIN = 1e-5  # s, the resolution of the histogram
BINS = 10_000  # up to 0.1 s; the last bin holds everything longer


@dataclass(frozen=True, slots=True)
class DurationSummary:
    """Median, 99th percentile and maximum of durations in s, to a resolution of `BIN`."""

    median: float
    p99: float
    maximum: float

    def in_words(self) -> str:
        """A clause for a log line on lateness."""
        return (
            f"late by {1e3 * self.median:.2f} ms (median), {1e3 * self.p99:.2f} ms (p99), "
            f"{1e3 * self.maximum:.1f} ms (maximum)"
        )


class Histogram:
    """Counts durations. Adding one allocates nothing; another thread may read meanwhile."""

    def __init__(self) -> None:
        self._counts = array.array("q", bytes(8 * (BINS + 1)))
        self._longest = 0.0

    def add(self, seconds: float) -> None:
        """Count a duration in s; a negative one counts as zero."""
        index = int(seconds / BIN) if seconds > 0.0 else 0
        self._counts[index if index < BINS else BINS] += 1
        if seconds > self._longest:
            self._longest = seconds

    def counts(self) -> Array:
        """A copy of the counts (BINS + 1,), for a later call of `summary`."""
        return np.array(self._counts, dtype=float)

    def summary(self, since: Array | None = None) -> DurationSummary:
        """Statistics of all durations, or of those since an earlier `counts()`; zeros if there are none."""
        counts = self.counts() if since is None else self.counts() - since
        cumulative = np.cumsum(counts)
        if not cumulative[-1]:
            return DurationSummary(0.0, 0.0, 0.0)
        median, p99 = (int(np.searchsorted(cumulative, part * cumulative[-1])) for part in (0.5, 0.99))
        maximum = int(np.nonzero(counts)[0][-1])
        indices = (median, p99, maximum)
        return DurationSummary(*(self._longest if index >= BINS else (index + 0.5) * BIN for index in indices))


class Pacer:
    """Decides when the next steps are due.

    `overruns` counts restarts of the schedule because of lateness. `running` is the real time in s that the steps up to
    the last deadline took, without pauses and other interruptions of the schedule. `lateness` holds how long after
    their deadlines the steps began, `period` how long after the steps before.
    """

    def __init__(self) -> None:
        self.overruns = 0
        self.running = 0.0
        self.lateness, self.period = Histogram(), Histogram()
        self._deadline = self._last_wake = time.perf_counter()
        self._anchored = True

    def anchor(self) -> None:
        """Restart the schedule now, as after a pause."""
        self._deadline = self._last_wake = time.perf_counter()
        self._anchored = True

    def pass_deadline(self) -> None:
        """Set the deadline to now, as when running as fast as possible."""
        now = time.perf_counter()
        self.running += now - self._last_wake
        self._deadline = self._last_wake = now
        self._anchored = True

    def delay(self, duration: float) -> None:
        """Shift the schedule by `duration` seconds in which no step could be taken."""
        self._deadline += duration
        self._last_wake += duration

    def plan(self, duration: float) -> None:
        """Set the next deadline, `duration` seconds after the last one."""
        self._deadline += duration

    def wait(self, wake: threading.Event) -> bool:
        """Sleep until the deadline; False if `wake` interrupted a long sleep before it, or it is still far away."""
        rest = self._deadline - time.perf_counter()
        if rest > INTERRUPTIBLE_SLEEP and (wake.wait(min(rest, LONGEST_SLEEP)) or rest > LONGEST_SLEEP):
            return False
        if 0.0 < rest <= INTERRUPTIBLE_SLEEP:
            time.sleep(rest)
        now = time.perf_counter()
        lateness = now - self._deadline
        self.lateness.add(lateness)
        if not self._anchored:
            self.period.add(now - self._last_wake)
        self.running += now - self._last_wake
        self._anchored, self._last_wake = False, now
        if lateness > MAX_LATENESS:
            self.overruns += 1
            self.anchor()
        return True
