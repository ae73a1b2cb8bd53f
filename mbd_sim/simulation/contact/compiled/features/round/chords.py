"""The round side of a cylinder or a cone that lies on a round end, nearly or entirely: the ends of its chord carry it.

Each of them is a point of the rim that touches the side, see `rims`; a pair of features with two of those has a sign,
as that of an edge has (`crossings`, `rounded_edges`).
"""

from __future__ import annotations

from mbd_sim.compiler.ir.python_kinds import Array, Integers, zeros
from mbd_sim.simulation.contact.compiled.features.round.bodies import CROSSED, PlacedRound
from mbd_sim.simulation.contact.compiled.features.round.crossings import CROSSING, MARGIN, NORMAL, TOWARD
from mbd_sim.simulation.contact.compiled.features.round.normals import (
    EDGE_RIM,
    FIRST,
    KIND,
    PARALLEL,
    SECOND,
    SIDE_CORNER,
    SIGN,
)
from mbd_sim.simulation.contact.compiled.features.round.rims import (
    NUMBERS,
    PointOfRim,
    RimContact,
    follow,
    nearest_of_rim,
    place_rim,
)
from mbd_sim.simulation.contact.compiled.features.vectors import add, dot, scale, size_of


def end_of_side_chord(a: PlacedRound, b: PlacedRound, key: Integers, toward: Array) -> bool:
    """The direction of one end of the chord of a round side across a round end; False where there is none."""
    rim, other, corner, sign, side, normal = a, b, key[FIRST], 1.0, key[SECOND], zeros(3)
    if key[KIND] == EDGE_RIM:
        rim, other, corner, sign, side = b, a, key[SECOND], -1.0, key[FIRST]
    m = RimContact(rim, corner, other, other.hull.ends[2 * side], side, zeros(3), zeros(3))
    at = PointOfRim(zeros(3), zeros(3), zeros(3), zeros(3), zeros(3), zeros(NUMBERS))
    nearest_of_rim(a, b, key, toward, normal)
    place_rim(m)
    scale(-sign, toward, at.outward)
    if key[SIGN] * share_of(m, at.outward) < 0.0:  # the other end is nearer
        mirror(m, at.outward, at.outward)
    follow(m, at)
    scale(-sign, at.outward, toward)
    return key[SIGN] * share_of(m, at.outward) > CROSSED


def tilt_of_side(
    a: PlacedRound, b: PlacedRound, key: Integers, normal: Array, toward: Array, limit: float, crossed: float
) -> float:  # fmt: skip
    """How far in m a normal is tilted beyond a limit where a round side lies on an end: see `level` in `flat_sides`.

    :param crossed: the limit over half of a chord, whose ends carry the side.
    """
    share = abs(share_at(a, b, key, toward))
    radius = b.hull.rims[key[SECOND]] if key[KIND] in (SIDE_CORNER, EDGE_RIM) else a.hull.rims[key[FIRST]]
    return (abs(dot(normal, toward)) - (crossed * share if share > CROSSED else limit)) * radius


def add_chord_margin(a: PlacedRound, b: PlacedRound, key: Integers, out: Array) -> None:
    """Replace the margin to the end of a body by that of an end of a chord to other ways in which both can touch."""
    radius, share = a.hull.rims[key[FIRST]], -key[SIGN] * share_at(a, b, key, out[TOWARD:])
    if key[KIND] == EDGE_RIM:
        radius, share = b.hull.rims[key[SECOND]], -share
    out[MARGIN] = min(share - CROSSED, CROSSING * share - abs(dot(out[NORMAL:], out[TOWARD:]))) * radius


def has_long_side_chord(a: PlacedRound, b: PlacedRound, key: Integers, toward: Array) -> bool:
    """Whether a round side and a rim have a chord both of whose ends can carry the side."""
    return abs(share_at(a, b, key, toward)) > CROSSED


def share_at(a: PlacedRound, b: PlacedRound, key: Integers, toward: Array) -> float:
    """`share_of` the round side and the rim of a key."""
    rim, other, corner, side = a, b, key[FIRST], key[SECOND]
    if key[KIND] in (SIDE_CORNER, EDGE_RIM):
        rim, other, corner, side = b, a, key[SECOND], key[FIRST]
    m = RimContact(rim, corner, other, other.hull.ends[2 * side], side, zeros(3), zeros(3))
    place_rim(m)
    return share_of(m, toward)


def share_of(m: RimContact, outward: Array) -> float:
    """The part of a direction along a round side, seen along the axis: half of the chord over the radius at its end."""
    level = zeros(3)
    along_end(m, level)
    return dot(level, outward)


def mirror(m: RimContact, outward: Array, out: Array) -> None:
    """From one end of a chord of a round side toward the other one, if the side lies level."""
    level = zeros(3)
    along_end(m, level)
    add(outward, -2.0 * dot(level, outward), level, out)


def along_end(m: RimContact, out: Array) -> None:
    """The direction of the axis of a round side, seen along that of the rim; zero if both are parallel."""
    direction = m.other.directions[3 * m.side :]
    add(direction, -dot(m.axis, direction), m.axis, out)
    size = size_of(out)
    scale(1.0 / size if size > PARALLEL else 0.0, out, out)
