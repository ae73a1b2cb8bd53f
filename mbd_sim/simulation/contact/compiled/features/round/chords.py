"""The side of a cylinder or a cone that lies on a round end, nearly or entirely: the ends of its chord carry it.

Each of them is a point of the rim that touches the side, see `rims`; a pair of features with two of those has a sign,
as that of an edge has (`crossings`, `rounded_edges`). The line of the side that touches is its *ruling*.
"""

from __future__ import annotations

import math

from mbd_sim.compiler.ir.python_kinds import Array, Integers, zeros
from mbd_sim.simulation.contact.compiled.features.round.bodies import CROSSED, PlacedRound
from mbd_sim.simulation.contact.compiled.features.round.crossings import CROSSING, MARGIN, NORMAL, TOWARD
from mbd_sim.simulation.contact.compiled.features.round.normals import (
    CORNER_SIDE,
    EDGE_RIM,
    FIRST,
    KIND,
    PARALLEL,
    RIM_EDGE,
    SECOND,
    SIDE_CORNER,
    SIGN,
)
from mbd_sim.simulation.contact.compiled.features.round.rims import (
    NUMBERS,
    PointOfRim,
    RimContact,
    follow,
    is_rim_contact,
    place_rim,
    start_of_side,
)
from mbd_sim.simulation.contact.compiled.features.vectors import add, copy, divide, dot, scale, size_of

LEVEL_SIDE = 1e-3  # sine of the tilt against the axis over the part of the chord, below which a side has a chord


def is_side_at_rim(a: PlacedRound, b: PlacedRound, key: Integers) -> bool:
    """Whether the features of a key are a round side and a rim, without a sign."""
    return key[KIND] in (SIDE_CORNER, CORNER_SIDE) and is_rim_contact(a, b, key)


def is_end_of_chord(a: PlacedRound, b: PlacedRound, key: Integers) -> bool:
    """Whether the features of a key are a round side and a rim, at one of the ends of a chord."""
    return key[KIND] in (EDGE_RIM, RIM_EDGE) and is_rim_contact(a, b, key)


def end_of_side(a: PlacedRound, b: PlacedRound, key: Integers, toward: Array) -> bool:
    """The direction of the end of a chord of a key; False where there is none."""
    rim, other, corner, side, sign = a, b, key[FIRST], key[SECOND], 1.0
    if key[KIND] == EDGE_RIM:
        rim, other, corner, side, sign = b, a, key[SECOND], key[FIRST], -1.0
    m = RimContact(rim, corner, other, other.hull.ends[2 * side], side, zeros(3), zeros(3))
    at = PointOfRim(zeros(3), zeros(3), zeros(3), zeros(3), zeros(3), zeros(NUMBERS))
    level = zeros(3)
    place_rim(m)
    if not start_of_side(m, key[SIGN], level, at.outward):
        return False
    follow(m, at)
    scale(-sign, at.outward, toward)
    return key[SIGN] * dot(level, at.outward) > CROSSED


def part_of_chord(a: PlacedRound, b: PlacedRound, key: Integers, normal: Array, toward: Array) -> float:
    """At an end of a chord, half of this over the radius of the rim: the part of its direction along the ruling."""
    rim, other, side, sign, ruling = a, b, key[SECOND], 1.0, zeros(3)
    if key[KIND] in (SIDE_CORNER, EDGE_RIM):
        rim, other, side, sign = b, a, key[FIRST], -1.0
    cosine = other.hull.cosines[side]
    copy(other.directions[3 * side :], ruling)
    add(ruling, -sign * cosine, normal, ruling)
    divide(ruling, size_of(ruling))
    rise = dot(ruling, rim.normals)
    level = 1.0 - rise * rise
    return -sign * dot(ruling, toward) / math.sqrt(level) if level > PARALLEL * PARALLEL else 0.0


def tilt_of_side(
    a: PlacedRound, b: PlacedRound, key: Integers, normal: Array, toward: Array, limit: float
) -> float:  # fmt: skip
    """How far in m the normal is tilted against the axis of the rim beyond a `limit`, a sine, or that of a chord."""
    part = abs(part_of_chord(a, b, key, normal, toward))
    if part > CROSSED:
        limit = LEVEL_SIDE * part
    return (dot(normal, toward) - limit) * radius_of(a, b, key)


def add_chord_margin(a: PlacedRound, b: PlacedRound, key: Integers, out: Array) -> None:
    """Replace the margin to the end of the body by that of an end of a chord to other ways in which both can touch."""
    part = key[SIGN] * part_of_chord(a, b, key, out[NORMAL:], out[TOWARD:])
    out[MARGIN] = min(part - CROSSED, CROSSING * part - dot(out[NORMAL:], out[TOWARD:])) * radius_of(a, b, key)


def radius_of(a: PlacedRound, b: PlacedRound, key: Integers) -> float:
    """The radius of the rim of a key."""
    return b.hull.rims[key[SECOND]] if key[KIND] in (SIDE_CORNER, EDGE_RIM) else a.hull.rims[key[FIRST]]
