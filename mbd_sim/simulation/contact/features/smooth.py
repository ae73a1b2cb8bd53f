"""Two convex bodies, at least one of them round, for `smooth` and `smooth_distances` in `compiled.features.round`."""

from __future__ import annotations

from itertools import product

import numpy as np

from mbd_sim.dynamics.contact.smooth_rows import FOUND_AT, SMOOTH_SIZE
from mbd_sim.mechanism.elements.contacts import Curved, Solid
from mbd_sim.simulation.contact.compiled.features.round.normals import (
    CORNER_CORNER,
    CORNER_SIDE,
    SIDE_CORNER,
    RoundBodies,
)
from mbd_sim.simulation.contact.features.narrow_phase import Bounds, CompiledPhase
from mbd_sim.simulation.contact.features.round_bodies import RoundBody, hull_of, round_body

NEAR = 1e-7  # of the size of both bodies, within which two points of contact are one


class SmoothPair(CompiledPhase):
    """Two convex bodies of which at least one is round: see `NarrowPhase`."""

    def __init__(self, first: Curved | Solid, second: Curved | Solid, slots: int) -> None:
        bodies = round_body(first), round_body(second)
        radius, reach = bodies[0].radius + bodies[1].radius, bodies[0].reach + bodies[1].reach
        keys = _iterated(*bodies, rounded=radius > 0.0)
        numbers = np.array(keys, dtype=np.int64).ravel()
        record = RoundBodies(
            hull_of(bodies[0]), hull_of(bodies[1]), radius, NEAR * reach, reach, slots, len(keys), numbers
        )
        bounds = Bounds(bodies[0].center, bodies[0].reach), Bounds(bodies[1].center, bodies[1].reach)
        super().__init__("smooth", record, bounds, slots, SMOOTH_SIZE, iterates=True, found_at=FOUND_AT)


def _iterated(one: RoundBody, other: RoundBody, *, rounded: bool) -> list[tuple[int, int, int, int]]:
    """The kinds and indices of pairs of features whose normals are iterated."""
    corners = product(range(len(one.corners)), range(len(other.corners)))
    keys = [(CORNER_CORNER, i, j, 0) for i, j in corners if rounded or _can_meet(one, i, other, j)]
    keys += [(SIDE_CORNER, i, j, 0) for i, j in _side_corners(one, other, rounded)]
    keys += [(CORNER_SIDE, i, j, 0) for j, i in _side_corners(other, one, rounded)]
    return keys


def _can_meet(one: RoundBody, i: int, other: RoundBody, j: int) -> bool:
    """Whether sharp corners can meet at a smooth place: not a point with a point or with a rim."""
    smooth = (
        one.curved[i] and len(one.corners) == 1 and not one.faces,
        other.curved[j] and len(other.corners) == 1 and not other.faces,
    )
    return bool((one.curved[i] and other.curved[j]) or any(smooth))


def _side_corners(one: RoundBody, other: RoundBody, rounded: bool) -> list[tuple[int, int]]:
    """The sides of one body and the corners of another that can meet at a smooth place."""
    return [
        (i, j)
        for i, j in product(range(len(one.sides)), range(len(other.corners)))
        if rounded or one.ruled[i] or other.curved[j]
    ]
