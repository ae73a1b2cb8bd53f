"""The ticks of a run: its states and events with their times, for a recorder in a script and for the node.

At which ticks messages of a rate are due is counted in steps, so that no rate drifts or depends on when it was set.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache

from mbd_sim.recordings.messages.states import Due, Snapshot
from mbd_sim.simulation.run.events import RESTARTS, Event, EventKind, Payload
from mbd_sim.simulation.run.simulation import BaseSimulation


@dataclass
class RunClock:
    """The simulated clock of a run: `ticks` are its steps of `step_ns` ns across resets, of which 0 is at `zero_ns`."""

    step_ns: int
    ticks: int = 0
    zero_ns: int = 0

    @property
    def ns(self) -> int:
        """The time in ns; it goes back only when a reset asks for it, or a followed clock does."""
        return self.zero_ns + self.ticks * self.step_ns

    @property
    def whole_steps(self) -> int:
        """The whole steps since the clock was zero."""
        return self.ns // self.step_ns

    def set(self, time_ns: int) -> None:
        """Set the clock to a time in ns."""
        self.zero_ns = time_ns - self.ticks * self.step_ns


class Journal:
    """Stamps the states and events of a simulation with ticks, which count its steps across resets."""

    def __init__(self, simulation: BaseSimulation, first_tick: int = 0) -> None:
        self.clock = RunClock(round(simulation.step_size * 1e9), first_tick)
        self._simulation, self._steps = simulation, simulation.steps

    def count_steps(self) -> None:
        """Follow the steps that the simulation has taken."""
        self.clock.ticks += self._simulation.steps - self._steps
        self._steps = self._simulation.steps

    def event(self, kind: EventKind, payload: Payload = None) -> Event:
        """An event that happens now; after a restart, ticks count on from here."""
        if kind in RESTARTS:
            self._steps = self._simulation.steps
        self.count_steps()
        return Event(kind, payload, self.clock.ticks, self.clock.ns)

    def snapshot(self, due: Due = Due.STATE, repeated: bool = False, taken: float = math.inf) -> Snapshot:
        """The present state, for what is due."""
        simulation, clock = self._simulation, self.clock
        arrivals = simulation.arrivals if Due.SENSORS in due else ()
        return Snapshot(clock.ticks, clock.ns, simulation.time, simulation.snapshot(), due, repeated, arrivals, taken)


_TOLERANCE = 1_000_000  # a message is due up to this fraction of a step early, for rates and steps that are rounded


@dataclass(frozen=True)
class PublicationSchedule:
    """Message k of a rate r (Hz) is due at the first step at or after the time k / r; tick 0 has message 0.

    `each_tick` is the number of messages for each step, at most 1. With 333 Hz and steps of 1 ms, messages are due
    after 4, 7, 10, 13 … steps: 333 in each second.
    """

    each_tick: Fraction

    def is_due(self, tick: int) -> bool:
        """Whether a message is due after this number of steps."""
        return self._count(tick) > self._count(tick - 1)

    def next_tick(self, tick: int) -> int:
        """The number of steps after which the next message is due, greater than `tick`."""
        p, q = self.each_tick.numerator, self.each_tick.denominator
        number = self._count(tick) + 1
        return -((p - number * q * _TOLERANCE) // (p * _TOLERANCE))

    def _count(self, tick: int) -> int:
        """How many messages after the first are due up to this tick."""
        p, q = self.each_tick.numerator, self.each_tick.denominator
        return (p * (tick * _TOLERANCE + 1)) // (q * _TOLERANCE)


@lru_cache(maxsize=64)
def publication_schedule(rate: float, step_size: float) -> PublicationSchedule | None:
    """The schedule of a rate (Hz) for steps of `step_size` (s); None for rate 0, which is never due."""
    if not rate > 0.0:
        return None
    # Decimal digits give the numbers that the user wrote: the float 0.001 is a little more than a thousandth.
    return PublicationSchedule(min(Fraction(repr(float(rate))) * Fraction(repr(float(step_size))), Fraction(1)))


def attained_rate(rate: float, step_size: float) -> float:
    """The messages per second (Hz) at a rate asked: at most one for each step of `step_size` (s)."""
    return min(rate, 1.0 / step_size)


def rate_remark(name: str, rate: float, step_size: float) -> str:
    """A sentence if a rate (Hz) exceeds one message for each step of `step_size` (s), or ""."""
    attained = attained_rate(rate, step_size)
    if attained * (1.0 + 1e-9) >= rate:
        return ""
    return (
        f"{name} is {rate:g} Hz, but the state changes only with each step of {step_size:g} s: "
        f"messages are sent at {attained:g} Hz. Lower {name}, or choose a smaller step."
    )
