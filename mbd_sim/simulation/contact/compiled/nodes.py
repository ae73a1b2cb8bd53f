"""Values at the nodes of collocation, and where polynomials through them become negative.

In the subset of Python that is compiled.
"""

from __future__ import annotations

from mbd_sim.compiler.ir.python_kinds import Array, zeros
from mbd_sim.simulation.contact.compiled.instant.contacts import Contacts, guard_at
from mbd_sim.simulation.contact.compiled.instant.sliding import STAGES, Sliding

HALVINGS = 24  # by which the share of a length is found at which a value becomes negative
BACK = 0.25  # of a share, at which a positive value is sought after a start at zero
CLEAR = 1e-6  # of values at the nodes, by which one that begins with zero is positive behind it, beyond their errors
SOON = 1e-9  # of a length, up to which it is sought


def lagrange(c: Contacts, first: int, x: float, weights: Array) -> None:
    """The weights with which values at the nodes from the `first` on, of which 0 is the one at 0, give that at x."""
    for j in range(first, STAGES + 1):
        weights[j] = 1.0
        for k in range(first, STAGES + 1):
            if k != j:
                weights[j] *= (x - c.radau[k]) / (c.radau[j] - c.radau[k])


def keep_guards(c: Contacts, s: Sliding, stage: int, readings: Array) -> None:
    """Keep the guards at a node."""
    for k in range(c.guards):
        s.kept[stage * (c.guards + c.frictions) + k] = readings[guard_at(c, k)]


def first_crossing(c: Contacts, s: Sliding) -> float:
    """The share of the length at which a guard becomes negative first, or a slip reverses.

    The result is 1 if none is negative at a node.
    """
    first, count = 1.0, c.guards + c.frictions
    for k in range(count):
        if is_guard(c, s, k) and first > 0.0:
            tolerance = c.tolerance if k < c.guards else 0.0
            for stage in range(1, STAGES + 1):
                if s.kept[stage * count + k] < -tolerance:
                    if c.radau[stage - 1] < first:
                        first = min(first, crossing(c, s, k, stage))
                    break
    return first


def is_guard(c: Contacts, s: Sliding, k: int) -> bool:
    """Whether a value at the nodes must stay positive: a guard, or behind these the slip of an element that turns."""
    return not s.left_out[k] if k < c.guards else s.turning[k - c.guards] != 0


def crossing(c: Contacts, s: Sliding, k: int, stage: int) -> float:
    """The share of the length at which a value that is negative at a node, and not before, becomes zero.

    The result is 0 for a guard that is not clearly positive behind the start; a slip must not reverse there.
    """
    low, high, clear = c.radau[stage - 1], c.radau[stage], c.tolerance
    if stage == 1 and not s.kept[k] > c.tolerance:
        for node in range(1, STAGES + 1):
            clear = max(clear, CLEAR * abs(s.kept[node * (c.guards + c.frictions) + k]))
        while not at_share(c, s, k, BACK * high) > clear:
            high *= BACK
            if high < SOON:
                return 0.0 if k < c.guards else c.radau[1]
        low = BACK * high
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if at_share(c, s, k, middle) > 0.0:
            low = middle
        else:
            high = middle
    return high


def at_share(c: Contacts, s: Sliding, k: int, share: float) -> float:
    """A value that is known at the nodes, at a share of the length."""
    weights, found = zeros(STAGES + 1), 0.0
    lagrange(c, 0, share, weights)
    for stage in range(STAGES + 1):
        found += weights[stage] * s.kept[stage * (c.guards + c.frictions) + k]
    return found
