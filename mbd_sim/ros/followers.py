"""The stepping threads of this program that follow the clock of another one, which waits for them."""

from __future__ import annotations

from typing import Protocol

from mbd_sim.ros.followed_clock import FollowedClock

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
