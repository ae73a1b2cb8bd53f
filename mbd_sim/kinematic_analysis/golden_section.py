"""Where a function of one variable is least."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


def least_place(function: Callable[[float], float], low: float, high: float, sections: int) -> float:
    """The place between two others at which a function with one minimum there is least, by golden section.

    :param sections: each of which leaves 0.618 of the interval.
    """
    one, other = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    at_one, at_other = function(one), function(other)
    for _ in range(sections):
        if at_one < at_other:
            high, other, at_other = other, one, at_one
            one = high - GOLDEN * (high - low)
            at_one = function(one)
        else:
            low, one, at_one = one, other, at_other
            other = low + GOLDEN * (high - low)
            at_other = function(other)
    return 0.5 * (low + high)
