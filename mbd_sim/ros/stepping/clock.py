"""The clock that stepping threads follow, and what is due at a step.

The clock of another node is taken in one thread and read in the stepping thread. A stepping thread whose clock others
of this program follow waits for these. Threads that follow no clock keep time by `Pacer`. The rates of a node tell what
is due at a step.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from mbd_sim.recordings.messages.events import PublicationSchedule, publication_schedule
from mbd_sim.recordings.messages.states import Due


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


MAX_LEAD = 0.5  # simulated s by which a thread may be ahead of those that follow, as fast as possible


class Follower(Protocol):
    """What the thread that leads needs to know of a `SteppingThread`."""

    followed: FollowedClock | None

    @property
    def is_stepping(self) -> bool:
        """Whether the thread runs and is not paused."""
        ...

    @property
    def lag(self) -> float:
        """How far it is behind the clock, in s."""
        ...


class Followers(list[Follower]):
    """The threads that follow a clock."""

    def take(self, time_ns: int) -> None:
        """Pass the time of the clock in ns to them."""
        for follower in self:
            if follower.followed is not None:
                follower.followed.take(time_ns)

    @property
    def are_far_behind(self) -> bool:
        """Whether one of them is behind by more than `MAX_LEAD`; one that is paused or has failed is not."""
        return any(follower.is_stepping and follower.lag > MAX_LEAD for follower in self)


@dataclass
class Rates:
    """Rates that may change during the run.

    `real_time_factor` 0 is as fast as possible; the others are in Hz of simulated time, 0 for never: of states, of the
    clock, of markers, and of samples for the Rerun scene.
    """

    real_time_factor: float = 1.0
    publish: float = 100.0
    clock: float = 200.0
    markers: float = 0.0
    view: float = 0.0

    def due(self, tick: int, step_size: float) -> Due:
        """What is due at a tick, with steps of `step_size` (s)."""
        due = Due.NONE
        for message, schedule in self._schedules(step_size).items():
            if schedule.is_due(tick):
                due |= message
        return due

    def steps_until_due(self, tick: int, step_size: float, *, at_most: int) -> int:
        """The steps from a tick to the next one at which something is due."""
        return min([at_most, *(schedule.next_tick(tick) - tick for schedule in self._schedules(step_size).values())])

    def _schedules(self, step_size: float) -> dict[Due, PublicationSchedule]:
        rates = {
            Due.STATE: self.publish,
            Due.CLOCK: self.clock,
            Due.MARKERS: self.markers,
            Due.VIEW: self.view,
        }
        schedules = {due: publication_schedule(rate, step_size) for due, rate in rates.items()}
        return {due: schedule for due, schedule in schedules.items() if schedule is not None}
