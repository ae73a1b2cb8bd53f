"""What of a cylinder, or of a tube around it, a ball touches: the narrow phase of such pairs."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mbd_sim.compiler.ir.python_kinds import Array, zeros
from mbd_sim.dynamics.contact.barrel_rows import END, KEY, SIDE
from mbd_sim.simulation.contact.compiled.features.vectors import dot, place, subtract, turn

AT_SIDE, AT_EDGE, ON_END = 1, 2, 4  # keys; those of an edge and of an end are one more at the last end
SPOT = 7  # the place that `margin` writes, see `SPOT` in `pairs`: one slot has no area that could shrink


@dataclass(frozen=True)
class BallOnBarrel:
    """A ball with its `center` (3,), and a cylinder or, if the ball is `inside`, a tube with its `middle` (3,).

    Both are in the frames of their parts, as is the `axis` (3,). The cylinder has its `radius` and `half` of its
    length, in m.
    """

    center: Array
    ball: float
    middle: Array
    axis: Array
    radius: float
    half: float
    inside: bool


def put(p: BallOnBarrel, one: Array, other: Array, out: Array) -> None:
    """How far in m the center of the ball is along the axis, and beside the side."""
    center, middle, axis, line = zeros(3), zeros(3), zeros(3), zeros(3)
    place(one, p.center, center)
    place(other, p.middle, middle)
    turn(other, p.axis, axis)
    subtract(center, middle, line)
    out[0] = dot(axis, line)
    for i in range(3):
        line[i] -= axis[i] * out[0]
    out[1] = math.sqrt(dot(line, line)) - p.radius


def key_at(p: BallOnBarrel, at: Array) -> int:
    """What is nearest to the center of the ball."""
    beside, beyond = at[1], abs(at[0]) - p.half
    last = 1 if at[0] > 0.0 else 0
    if p.inside:
        return AT_EDGE + last if beyond > 0.0 else AT_SIDE
    if beside > 0.0 and beyond > 0.0:
        return AT_EDGE + last
    return ON_END + last if beyond > beside else AT_SIDE


def gap_at(p: BallOnBarrel, at: Array) -> float:
    """The distance of both in m."""
    beside, beyond, key = at[1], abs(at[0]) - p.half, key_at(p, at)
    if key == AT_SIDE:
        return (-beside if p.inside else beside) - p.ball
    if key >= ON_END:
        return beyond - p.ball
    return math.sqrt(beside * beside + beyond * beyond) - p.ball


def barrel_distance(p: BallOnBarrel, one: Array, other: Array) -> float:
    """See `NarrowPhase`."""
    at = zeros(2)
    put(p, one, other, at)
    return gap_at(p, at)


def barrel_touching(p: BallOnBarrel, one: Array, other: Array, tolerance: float, slots: Array) -> int:
    """See `NarrowPhase`."""
    at = zeros(2)
    put(p, one, other, at)
    key = key_at(p, at)
    is_edge = AT_EDGE <= key < ON_END
    if gap_at(p, at) > tolerance or (is_edge and p.ball == 0.0):  # an edge does not touch a point
        return 0
    slots[END] = 0.0 if key == AT_SIDE else 1.0 if key % 2 else -1.0
    slots[SIDE] = 1.0 if key < ON_END else 0.0
    slots[KEY] = key
    return 1


def barrel_margin(p: BallOnBarrel, one: Array, other: Array, numbers: Array, spot: Array) -> float:
    """See `NarrowPhase`. The end of a flat disc is both of its ends."""
    at, key = zeros(2), int(numbers[KEY])
    put(p, one, other, at)
    for i in range(SPOT):
        spot[i] = 0.0
    beside, beyond = at[1], abs(at[0]) - p.half
    if key == AT_SIDE:
        return -beyond
    if key >= ON_END:
        return -beside
    return beyond if p.inside else min(beside, beyond) if p.half > 0.0 else beside
