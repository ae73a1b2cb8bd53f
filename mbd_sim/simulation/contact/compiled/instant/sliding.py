"""What slides along two directions, in the subset of Python that is compiled."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mbd_sim.compiler.ir.python_kinds import Array, Integers
from mbd_sim.simulation.contact.compiled.instant.contacts import Contacts, direction_at, rate_at

STAGES = 5  # of a motion in which friction turns slip
FIXED = 1.0 + 1e-12  # length of a direction of sliding that does not turn


@dataclass(frozen=True)
class Sliding:
    """The friction elements that slide along two directions: 1 in `all`, and in `turning` if friction turns their slip.

    Their `directions` (2 frictions,) at the start can be constant in a motion with other inputs, `given`; `inputs` are
    those of the motion that is followed. If `is_collocated[0]` is 1, that is found by collocation: the `slopes` (stages
    + 1, n) at the start and at the nodes, with the directions `turns` (stages + 1, 2 frictions). Slopes change with the
    direction of each element that turns by `turned` (pairs, n) per rad, and those of slip across the directions by
    `effects` (pairs, pairs) in m/s² per rad. The `known` slopes and `known_turns` are those of a motion of the length
    `base[0]`, if that is positive. At the start and the nodes, `kept` (stages + 1, guards + frictions) are the guards,
    of which those `left_out` (guards,) make no event, and the slips of what turns along their directions.
    """

    all: Integers
    left_out: Integers
    turning: Integers
    is_collocated: Integers
    directions: Array
    given: Array
    inputs: Array
    slopes: Array
    turns: Array
    turned: Array
    effects: Array
    known: Array
    known_turns: Array
    base: Array
    kept: Array


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


def forward(c: Contacts, s: Sliding, readings: Array, element: int) -> float:
    """The slip velocity of friction along its direction at the start."""
    x, y = s.directions[2 * element], s.directions[2 * element + 1]
    return slip(c, readings, element, 0) * x + slip(c, readings, element, 1) * y


def with_directions(c: Contacts, s: Sliding, inputs: Array, directions: Array) -> None:
    """Let elements that turn keep their directions in the motion with other inputs."""
    for i in range(c.inputs):
        s.given[i] = inputs[i]
    for k in range(c.frictions):
        if s.turning[k]:
            for direction in range(2):
                at = direction_at(c, c.friction_rows[2 * k + direction])
                s.given[at] = FIXED * directions[2 * k + direction]
