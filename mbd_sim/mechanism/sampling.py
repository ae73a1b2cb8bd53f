"""The periods and delays of sensors as numbers of steps."""

from __future__ import annotations

import math
from typing import NamedTuple

from mbd_sim.errors import InputError
from mbd_sim.mechanism.sensors import Sampling

ROUND_OFF = 1e-9  # relative, of rates and delays that are computed or have units


class SamplingError(InputError):
    """A rate or a delay that is not a whole number of steps; `key` is its key."""

    def __init__(self, key: str, message: str, remedy: str) -> None:
        super().__init__(message, remedy)
        self.key = key


class SamplingSteps(NamedTuple):
    """A sensor measures every `period` steps; a measurement arrives `delay` steps later."""

    period: int
    delay: int


def steps_of(sampling: Sampling, step: float) -> SamplingSteps:
    """The period and the delay in steps of `step` s.

    :raises SamplingError: they are not whole numbers of steps; the nearest possible values are named.
    """
    return SamplingSteps(_period(sampling.rate, step), _delay(sampling.delay, step))


def _period(rate: float | None, step: float) -> int:
    if rate is None:
        return 1
    ratio = 1.0 / (rate * step)
    if ratio < 1.0 - ROUND_OFF:
        raise SamplingError(
            "rate",
            f"{rate:.12g} Hz is more than one measurement for each step of {step:g} s",
            f"Write at most {1.0 / step:.12g} Hz, or choose a smaller step.",
        )
    period = round(ratio)
    if abs(ratio - period) > ROUND_OFF * ratio:
        rates = " or ".join(f"{1.0 / (count * step):.12g} Hz" for count in (math.ceil(ratio), math.floor(ratio)))
        raise SamplingError(
            "rate",
            f"the period of {rate:.12g} Hz is not a whole number of steps of {step:g} s",
            f"The nearest rates are {rates}.",
        )
    return period


def _delay(delay: float, step: float) -> int:
    count = round(delay / step)
    if abs(delay / step - count) > ROUND_OFF * max(1, count):
        whole = math.floor(delay / step)
        delays = " or ".join(f"{number * step:.12g} s" for number in (whole, whole + 1))
        raise SamplingError(
            "delay",
            f"{delay:.12g} s is not a whole number of steps of {step:g} s",
            f"The nearest delays are {delays}.",
        )
    return count
