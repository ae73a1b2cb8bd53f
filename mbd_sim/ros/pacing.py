"""Keeping time: absolute deadlines on the steady clock, and what became of them."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass

import numpy as np

LONG = 0.02  # seconds from which a sleep can be ended early; shorter ones are plain sleeps, which wake more punctually
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
        late = time.perf_counter() - self._due
        self._late[self._count % len(self._late)] = late
        self._count += 1
        if late > RE_ANCHOR:
            self.overruns += 1
            self.anchor()
        return True

    def lateness(self) -> Lateness:
        """The figures of the last few thousand deadlines."""
        late = self._late[: min(self._count, len(self._late))]
        if not len(late):
            return Lateness(0.0, 0.0, 0.0)
        median, p99 = np.quantile(late, [0.5, 0.99])
        return Lateness(float(median), float(p99), float(np.max(late)))
