"""Where a value will become zero, from an approximate motion, in the subset of Python that is compiled.

Each place at which a value is tried costs a motion up to there, with dozens of evaluations. Where collocation or a
cubic between both ends says where bodies are, nearly, it costs about one. The root finder tries the places that are
foreseen so, and what it finds is a zero of the exact values.
"""

from __future__ import annotations

import math

from mbd_sim.compiler.ir.python_kinds import Array, zeros
from mbd_sim.simulation.contact.compiled.collocation import guess, state_at
from mbd_sim.simulation.contact.compiled.instant.contacts import (
    START,
    Contacts,
    read_poses,
    read_rates,
    readings_size,
)
from mbd_sim.simulation.contact.compiled.sliding import STAGES
from mbd_sim.simulation.contact.compiled.trial import APART, BESIDE, FEATURES, TrialPart, value_in

FORESEEN = 4  # attempts of the root finder at places that are foreseen
PLACES = 40  # tried for each of them
CLOSE = 1e-3  # of the latest value, which the next one may have by that


def may_foresee(c: Contacts, what: int) -> bool:
    """Whether a value follows from the poses of parts, which are read far sooner than a motion is found."""
    return what in (APART, BESIDE, FEATURES) and c.gaps_and_rates != 0


def foreseen(
    c: Contacts, m: TrialPart, what: int, index: int, place: float, value: float, other: float, enough: float
) -> float:
    """Where a value becomes zero between its latest place and another one; the latest place where that is not known.

    :param value: at the latest place, with the opposite sign of that at the other one.
    :param enough: how far from zero it may be.
    """
    shift, found, f_found, share = value - near_value(c, m, place, what, index), place, value, 0.5
    new, f_new, old, f_old = place, value, other, near_value(c, m, other, what, index) + shift
    low, f_low, close = old, f_old, max(enough, CLOSE * abs(value))
    if (f_old > 0.0) == (f_new > 0.0):
        return place
    for _ in range(PLACES):
        share = next_share(new, f_new, low, f_low, old, f_old) if old != low else f_new / (f_new - f_low)
        found = new + share * (low - new)
        if not min(new, low) < found < max(new, low):
            return found
        f_found = near_value(c, m, found, what, index) + shift
        if abs(f_found) <= close or not math.isfinite(f_found):
            return found
        if (f_found > 0.0) == (f_new > 0.0):
            old, f_old = new, f_new
        else:
            old, f_old, low, f_low = low, f_low, new, f_new
        new, f_new = found, f_found
    return found


def next_share(x: float, f: float, other: float, f_other: float, old: float, f_old: float) -> float:
    """Where between x and the other end of a bracket a zero is sought next, after an older place.

    Inverse quadratic interpolation where it is monotonic in the bracket, else the middle: T. R. Chandrupatla, A new
    hybrid quadratic/bisection algorithm for finding the zero of a nonlinear function without using derivatives,
    Advances in Engineering Software 28 (1997) 145-149.
    """
    position, height = (x - other) / (old - other), (f - f_other) / (f_old - f_other)
    if not (height * height < position and (1.0 - height) * (1.0 - height) < 1.0 - position):
        return 0.5
    slope = (old - x) / (other - x)
    return f / (f_other - f) * f_old / (f_other - f_old) + slope * f / (f_old - f) * f_other / (f_old - f_other)


def near_value(c: Contacts, m: TrialPart, length: float, what: int, index: int) -> float:
    """About the value after a length in s."""
    state, readings, places = zeros(c.size), zeros(readings_size(c)), zeros(c.places)
    near(c, m, length, state)
    if what == BESIDE:
        read_rates(c, m.t + length, state, m.inputs, readings)
    read_poses(c, m.t + length, state, m.inputs, places)
    return value_in(c, m, readings, places, what, index)


def near(c: Contacts, m: TrialPart, length: float, state: Array) -> None:
    """About the state after a length in s: by collocation, or else by the cubic with the slopes at both ends."""
    n, span, time, readings, x = c.size, m.span[0], zeros(1), zeros(readings_size(c)), 0.0
    if m.sliding.is_collocated[0]:
        guess(c, m.sliding, length)
        state_at(c, m.sliding, m.y, length, STAGES, state)
        return
    if m.ends[2 * n] != span:
        m.ends[2 * n], time[0] = span, m.t
        START(c.start, time, m.y, m.inputs, m.ends, readings)
        time[0] = m.t + span
        START(c.start, time, m.end, m.inputs, m.ends[n:], readings)
    x = length / span
    for i in range(n):
        change, first, last = m.end[i] - m.y[i], span * m.ends[i], span * m.ends[n + i]
        state[i] = m.y[i] + x * (first + x * (3.0 * change - 2.0 * first - last + x * (first + last - 2.0 * change)))
