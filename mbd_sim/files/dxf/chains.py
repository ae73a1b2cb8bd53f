"""Lines and arcs of a drawing in any order, joined to closed chains, and these as the points of outlines."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from mbd_sim.base.errors import InputError
from mbd_sim.files.dxf.drawing import Place, Stretch

GAP = 1e-5  # of the size of a drawing, up to which ends meet


def closed_chains(stretches: Sequence[Stretch], layer: str) -> list[list[Stretch]]:
    """The chains, the largest first; each begins where its first line or arc does.

    :raises InputError: there are none, a chain is not closed, or more than two ends meet.
    """
    if not stretches:
        raise InputError(f"layer '{layer}' has no lines, arcs, polylines or circles", "Draw the outline there.")
    size = max(max(map(abs, (*one.start, *one.end))) for one in stretches)
    span = _span(stretches) or size
    left, chains = list(stretches), list[list[Stretch]]()
    while left:
        chain = [left.pop(0)]
        while math.dist(chain[-1].end, chain[0].start) > GAP * span:
            chain.append(_next(chain[-1].end, left, GAP * span, layer))
        chains.append(chain)
    _require_single_ends(chains, GAP * span, layer)
    return sorted(chains, key=_span, reverse=True)


def _span(stretches: Sequence[Stretch]) -> float:
    """The diagonal of the box around all ends."""
    places = [place for one in stretches for place in (one.start, one.end, one.through or one.end)]
    return math.hypot(*(max(place[axis] for place in places) - min(place[axis] for place in places) for axis in (0, 1)))


def _next(end: Place, left: list[Stretch], gap: float, layer: str) -> Stretch:
    """The line or arc that begins or ends at a place, turned so that it begins there; it is removed from the rest."""
    distances = [(math.dist(end, place), index, side) for index, one in enumerate(left)
                 for side, place in enumerate((one.start, one.end))]  # fmt: skip
    distance, index, side = min(distances, default=(math.inf, 0, 0))
    if distance > gap:
        at = f"[{end[0]:.6g}, {end[1]:.6g}] m"
        rest = f", and the nearest other end is {distance:.3g} m away" if left else ""
        raise InputError(f"the outline on layer '{layer}' is not closed: it ends at {at}{rest}", "Close the gap.")
    found = left.pop(index)
    return found.back() if side else found


def _require_single_ends(chains: Sequence[Sequence[Stretch]], gap: float, layer: str) -> None:
    """Refuse places at which more than two lines meet: which of them is the outline would be a guess."""
    starts = [one.start for chain in chains for one in chain]
    ordered = sorted(starts)
    for index, place in enumerate(ordered):
        for other in ordered[index + 1 :]:
            if other[0] - place[0] > gap:
                break
            if math.dist(place, other) <= gap:
                at = f"[{place[0]:.6g}, {place[1]:.6g}] m"
                raise InputError(f"more than two lines of layer '{layer}' meet at {at}", "Leave one outline there.")


def outline_points(chain: Sequence[Stretch], origin: Place) -> list[Any]:
    """The entries of an outline in a mechanism file, in m from the origin."""

    def moved(place: Place) -> list[float]:
        return [place[0] - origin[0], place[1] - origin[1]]

    points: list[Any] = [moved(chain[0].start)]
    for one in chain:
        if one.through is None:
            points.append(moved(one.end))
        else:
            points.append({"to": moved(one.end), "through": moved(one.through)})
    if chain[-1].through is None:
        points.pop()  # a line to the first point closes the outline
    else:
        points[-1]["to"] = list(points[0])
    return points
