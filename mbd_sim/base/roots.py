"""Zeros of functions of one variable, by bracketing."""

from __future__ import annotations

import math
from collections.abc import Callable

ITERATIONS = 80
BACKTRACKS = 40  # halvings in search of a positive value after a start at zero


def first_zero(value: Callable[[float], float], length: float, start: float, end: float, tolerance: float) -> float:
    """Where a function on (0, `length`] that ends negative leaves its positive values, to round-off.

    :param start: its value at 0. If that is zero, up to the `tolerance`, or negative, a positive value is sought after
        it; without one the result is 0: the guard was not positive from the start.
    :param end: its value at `length`, negative.
    """
    low, f_low, high, f_high = 0.0, start, length, end
    if not f_low > tolerance:
        probe = length
        for _ in range(BACKTRACKS):
            probe *= 0.5
            found = value(probe)
            if found > tolerance:
                low, f_low = probe, found
                break
            high, f_high = probe, found
        else:
            return 0.0
    return _root(value, low, f_low, high, f_high, tolerance)


def _root(
    value: Callable[[float], float], low: float, f_low: float, high: float, f_high: float, tolerance: float
) -> float:
    """The zero between `low`, where the function is positive, and `high`, by Anderson and Björck's regula falsi.

    Where the function jumps, the first argument after that.
    """
    best, least = (low, f_low) if abs(f_low) < abs(f_high) else (high, abs(f_high))
    side = 0
    for count in range(ITERATIONS):
        middle = (low * f_high - high * f_low) / (f_high - f_low)
        if count % 4 == 3 or not low < middle < high:
            middle = 0.5 * (low + high)
        if middle in (low, high):
            break
        found = value(middle)
        if not math.isfinite(found):
            break
        if abs(found) < least:
            best, least = middle, abs(found)
        if found == 0.0:
            return middle
        if found > 0.0:
            if side > 0:
                factor = 1.0 - found / f_low
                f_high *= factor if factor > 0.0 else 0.5
            low, f_low, side = middle, found, 1
        else:
            if side < 0:
                factor = 1.0 - found / f_high
                f_low *= factor if factor > 0.0 else 0.5
            high, f_high, side = middle, found, -1
    return best if least <= tolerance else high
