"""What slides along two directions, in the subset of Python that is compiled."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mbd_sim.compiler.ir.python_kinds import Array, Integers
from mbd_sim.simulation.contact.compiled.instant.contacts import Contacts, direction_at, rate_at
from mbd_sim.simulation.contact.compiled.search import TrialPart

FIXED = 1.0 + 1e-12  # length of a direction of sliding that does not turn


@dataclass(frozen=True)
class Sliding:
    """The friction elements that slide along two directions: 1 in `all`.

    Those whose slip turns are 1 in `turning`, and those whose friction is `steady` while their slip turns fast. Their
    `directions` (2 frictions,) can be constant in a motion with other inputs, `given`; `inputs` are those of the motion
    that is followed.
    """

    all: Integers
    turning: Integers
    steady: Integers
    directions: Array
    given: Array
    inputs: Array


def is_pair(c: Contacts, element: int) -> bool:
    """Whether friction has two directions."""
    return c.friction_rows[2 * element + 1] >= 0


def hypot(x: float, y: float) -> float:
    """The length of a vector, without overflow."""
    most = max(abs(x), abs(y))
    if most == 0.0:
        return 0.0
    a, b = x / most, y / most
    return most * math.sqrt(a * a + b * b)


def slip(c: Contacts, readings: Array, element: int, direction: int) -> float:
    """The slip along one of two directions."""
    return readings[rate_at(c, c.friction_rows[2 * element + direction])]


def speed_of(c: Contacts, readings: Array, element: int) -> float:
    """The size of a slip along two directions."""
    return hypot(slip(c, readings, element, 0), slip(c, readings, element, 1))


def change_of_slip(c: Contacts, before: Array, after: Array, element: int) -> float:
    """The size of the change of a slip."""
    x = slip(c, after, element, 0) - slip(c, before, element, 0)
    return hypot(x, slip(c, after, element, 1) - slip(c, before, element, 1))


def with_directions(c: Contacts, m: TrialPart, s: Sliding, marks: Integers) -> None:
    """Let some elements keep their directions in the motion with other inputs."""
    for i in range(c.inputs):
        s.given[i] = m.inputs[i]
    for k in range(c.frictions):
        if marks[k]:
            for direction in range(2):
                at = direction_at(c, c.friction_rows[2 * k + direction])
                s.given[at] = FIXED * s.directions[2 * k + direction]
