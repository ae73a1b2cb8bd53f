"""At which steps messages of a rate are due: counted in steps, so that no rate drifts or depends on when it was set."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache

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
