"""The clock of another node that a simulation follows: taken in one thread, read in the stepping thread."""

from __future__ import annotations

import threading
from collections.abc import Callable


class FollowedClock:
    """The time that another node publishes on `/clock`. A time that is less than the one before is a restart."""

    def __init__(self) -> None:
        self.time_ns: int | None = None  # None: none has arrived
        self.on_time: Callable[[], None] = lambda: None  # called after each new time
        self._beginning: int | None = None
        self._lock = threading.Lock()

    def take(self, time_ns: int) -> None:
        """Take a time in ns; a negative one is ignored."""
        if time_ns < 0:
            return
        with self._lock:
            if self.time_ns is None or time_ns < self.time_ns:
                self._beginning = time_ns
            self.time_ns = time_ns
        self.on_time()

    def take_beginning(self) -> int | None:
        """The time at which the clock has begun or restarted since the last call, in ns; None if it has not."""
        with self._lock:
            beginning, self._beginning = self._beginning, None
            return beginning
