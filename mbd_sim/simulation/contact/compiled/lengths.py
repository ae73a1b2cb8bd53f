"""Lengths of the motions in which friction turns slip, in the subset of Python that is compiled."""

from __future__ import annotations

import math

from mbd_sim.compiler.ir.python_kinds import Array
from mbd_sim.simulation.contact.compiled.collocation import MISSED
from mbd_sim.simulation.contact.compiled.instant.contacts import Contacts, rate_at, turning_at
from mbd_sim.simulation.contact.compiled.instant.sliding import forward, slip, speed_of
from mbd_sim.simulation.contact.compiled.trial import TrialPart

ACCURATE = 1e-9  # of natural units, error of such a motion
SHORTER = 0.8  # of a length that should be accurate, or after which a slip velocity has changed by `TURNING`
LEAST = 0.05  # of a length whose error is too large
LONGER = 4.0  # than the last part of a step that a next one may be
BEYOND = 1.02  # of the length up to a stop, as the slopes at the start tell it, that a motion may have
CLOSED = 1.5  # the same up to an impact: a gap that has risen beyond round-off is then clearly negative
SOON = 0.1  # of a length, within which a gap that closes limits it
NEAR = 0.5  # cosine of the angle by which it may turn meanwhile
LAYER = 5.5  # of 1 / rate: the length at which the slope of a decay is missed by 1/32 of it
MOST_SHARES = 20
FORESEEN = 0.5  # of a length, beyond which that is tried


def length_to_stop(c: Contacts, m: TrialPart, length: float, ahead: Array) -> float:
    """A length, or little more than that up to a stop of a slip that turns, as the slopes at the start tell it."""
    found = length
    for k in range(c.frictions):
        speed = speed_of(c, m.before, k)
        if m.sliding.turning[k] and speed > c.slow:
            slowing = (speed - forward(c, m.sliding, ahead, k)) / length
            if slowing > 0.0:
                found = min(found, BEYOND * speed / slowing)
    return found


def length_to_close(c: Contacts, m: TrialPart, length: float, ahead: Array) -> float:
    """A length, or little more than that up to where a gap closes soon, as the slopes at the start tell it.

    So ends what an impact elsewhere has raised by little.

    :param ahead: the gaps and rates after the length, with these slopes.
    """
    found = length
    for gap in range(c.gaps):
        if m.inputs[c.first_mode + gap] == 0.0 and not c.clutches[gap] and not c.slots[gap]:
            rate, height = m.before[rate_at(c, gap)], max(0.0, m.before[1 + gap])
            pull = (rate - ahead[rate_at(c, gap)]) / length
            if rate > 0.0 and rate * rate + 2.0 * pull * height > 2.0 * pull * c.tolerance * c.gap_units[gap] > 0.0:
                time = (rate + math.sqrt(rate * rate + 2.0 * pull * height)) / pull
                if time < SOON * length:
                    found = min(found, CLOSED * time)
    return found


def length_of_transient(c: Contacts, m: TrialPart, longest: float, ahead: Array) -> float:
    """A length in which slips across their directions, which decay as friction turns them, should be accurate.

    Where a command has jumped, the slopes of such slips decay as exp(-rate t). The polynomial through the nodes misses
    that at the start by (z / (z + 5.5))^5 of it, with z = rate length, within a factor of two.

    :param ahead: the readings after the length `m.span[0]` with the slopes at the start.
    """
    found = longest
    for k in range(c.frictions):
        if m.sliding.turning[k]:
            x, y = m.sliding.directions[2 * k], m.sliding.directions[2 * k + 1]
            across = abs(x * slip(c, ahead, k, 1) - y * slip(c, ahead, k, 0)) / (m.span[0] * c.unit_speed)
            rate = turning_at(c, m.before, k)
            for _ in range(MOST_SHARES):
                part = rate * found / (rate * found + LAYER)
                error = MISSED * found * across * part * part * part * part * part
                if error <= ACCURATE:
                    break
                found *= share_with(error)
    return found if found < FORESEEN * longest else longest


def share_with(error: float) -> float:
    """The share of a length in which a motion should be accurate, from its error."""
    ratio = ACCURATE / max(error, 1e-6 * ACCURATE)
    root = math.sqrt(math.sqrt(math.sqrt(ratio)))
    return min(LONGER, max(LEAST, SHORTER * root * math.sqrt(root)))


def turns_little(c: Contacts, m: TrialPart) -> bool:
    """Whether no slip has turned so far that its direction would count as reversed."""
    for k in range(c.frictions):
        if m.sliding.turning[k]:
            x, y = m.sliding.directions[2 * k], m.sliding.directions[2 * k + 1]
            along = slip(c, m.after, k, 0) * x + slip(c, m.after, k, 1) * y
            if abs(along) < NEAR * speed_of(c, m.after, k):
                return False
    return True
