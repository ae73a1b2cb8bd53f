"""Sides that lie across a round end: how flat they lie there, and whether the ends of their chords carry them."""

from __future__ import annotations

import math

from mbd_sim.compiler.ir.python_kinds import Array, Integers
from mbd_sim.simulation.contact.compiled.features.round.bodies import PlacedRound, tilt
from mbd_sim.simulation.contact.compiled.features.round.chords import (
    end_of_side_chord,
    has_long_side_chord,
    tilt_of_side,
)
from mbd_sim.simulation.contact.compiled.features.round.crossings import (
    NORMAL,
    TOWARD,
    is_at_middle,
    is_crossed,
    is_crossing,
)
from mbd_sim.simulation.contact.compiled.features.round.normals import (
    CORNER_CORNER,
    CORNER_SIDE,
    FIRST,
    KIND,
    SECOND,
    SIDE_CORNER,
    RoundBodies,
)
from mbd_sim.simulation.contact.compiled.features.round.rims import is_rim_contact
from mbd_sim.simulation.contact.compiled.features.round.rounded_edges import (
    end_of_chord,
    has_long_chord,
    is_at_rim,
    tilt_at_rim,
)
from mbd_sim.simulation.contact.compiled.features.round.slots import has_direction


def level(
    p: RoundBodies, a: PlacedRound, b: PlacedRound, key: Integers, normal: Array, toward: Array, limit: float,
    crossed: float,
) -> float:  # fmt: skip
    """In m, negative where an edge lies on the end of a body so flat that it has no normal of its own at the rim.

    There the support of the rim has no derivative; its crossings, or points of edges and the corners on this end, carry
    the edge.

    :param limit: the sine of the angle up to which it lies flat; `crossed` is that of edges with crossings.
    """
    if has_direction(p, a, b, key) and is_crossing(key[KIND]):
        return math.inf
    if key[KIND] in (SIDE_CORNER, CORNER_SIDE) and is_rim_contact(a, b, key):
        return tilt_of_side(a, b, key, normal, toward, limit, crossed)
    if key[KIND] == SIDE_CORNER and not a.hull.ruled[key[FIRST]] and b.hull.curved[key[SECOND]]:
        if is_at_middle(a, key[FIRST], b, key[SECOND]):
            return -b.hull.rims[key[SECOND]]
        if p.radius > 0.0:
            return level_at_rim(p, a, b, key, normal, toward, limit, crossed)
        if is_crossed(a, key[FIRST], b, key[SECOND]):
            limit = crossed
        return (tilt(b, key[SECOND], normal) - limit) * b.hull.rims[key[SECOND]]
    if key[KIND] == CORNER_SIDE and not b.hull.ruled[key[SECOND]] and a.hull.curved[key[FIRST]]:
        if is_at_middle(b, key[SECOND], a, key[FIRST]):
            return -a.hull.rims[key[FIRST]]
        if p.radius > 0.0:
            return level_at_rim(p, a, b, key, normal, toward, limit, crossed)
        if is_crossed(b, key[SECOND], a, key[FIRST]):
            limit = crossed
        return (tilt(a, key[FIRST], normal) - limit) * a.hull.rims[key[FIRST]]
    return math.inf


def level_at_rim(
    p: RoundBodies, a: PlacedRound, b: PlacedRound, key: Integers, normal: Array, toward: Array, limit: float,
    crossed: float,
) -> float:  # fmt: skip
    """As `level`, of a rounded edge; an ellipsoid has no rim."""
    return tilt_at_rim(a, b, key, normal, toward, limit, crossed) if is_at_rim(p, a, b, key) else math.inf


def has_chord(p: RoundBodies, a: PlacedRound, b: PlacedRound, key: Integers, toward: Array) -> bool:
    """Whether a side and a rim have a chord, both of whose ends could carry the side if they are within it."""
    if has_direction(p, a, b, key):
        return is_long_chord(p, a, b, key, toward)
    if key[KIND] == SIDE_CORNER:
        return is_crossed(a, key[FIRST], b, key[SECOND])
    return key[KIND] == CORNER_SIDE and is_crossed(b, key[SECOND], a, key[FIRST])


def is_long_chord(p: RoundBodies, a: PlacedRound, b: PlacedRound, key: Integers, toward: Array) -> bool:
    """As `has_chord`, where the direction of the rim is known at one of the ends."""
    if is_at_rim(p, a, b, key):
        return has_long_chord(a, b, key, toward)
    return key[KIND] != CORNER_CORNER and has_long_side_chord(a, b, key, toward)


def is_chord_end(p: RoundBodies, a: PlacedRound, b: PlacedRound, key: Integers, toward: Array) -> bool:
    """The direction of an end of a chord, if there is this one."""
    if is_at_rim(p, a, b, key):
        return end_of_chord(a, b, key, toward)
    return is_rim_contact(a, b, key) and end_of_side_chord(a, b, key, toward)


def tilt_over_chord(
    p: RoundBodies, a: PlacedRound, b: PlacedRound, key: Integers, meeting: Array, limit: float
) -> float:
    """How far in m the normal is tilted against an end beyond a limit, of half of the chord over the radius."""
    if is_at_rim(p, a, b, key):
        return tilt_at_rim(a, b, key, meeting[NORMAL:], meeting[TOWARD:], limit, limit)
    return tilt_of_side(a, b, key, meeting[NORMAL:], meeting[TOWARD:], limit, limit)
