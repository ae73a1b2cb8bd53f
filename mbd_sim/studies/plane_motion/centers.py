"""Instant centers of all pairs of links, by the theorem of Aronhold and Kennedy and by velocities.

The instant center of two links is where both have the same velocity. It is a pin, or at infinity across a slide; the
centers of three links are on a line, so that two such lines give each further center (Aronhold 1872, Kennedy 1886).
By velocities, (V_i - V_j) + i (ω_i - ω_j) p = 0. Centers are homogeneous: x, y and a weight, which is 0 at infinity.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.short_repr import record
from mbd_sim.studies.plane_motion.snapshot import PlaneSnapshot, RigidLink

ROUND_OFF = 1e-9
SAME = 1e-7  # of unit vectors that are the same point
PARALLEL = 1e-6  # sine of the angle of two lines, below which their common point is uncertain

Pair = tuple[str, str]


@record
class InstantCenter:
    """The instant center of two links: at `place` in m, or at infinity in the unit `direction`.

    `found_by` is "joint", "Kennedy", or "velocities" where lines of centers do not determine it.
    """

    links: Pair
    place: complex | None
    direction: complex | None
    found_by: str


def instant_centers(snapshot: PlaneSnapshot) -> dict[Pair, InstantCenter]:
    """The instant centers of all pairs of links that move relative to each other, by their names in order.

    With n links, there are up to n (n - 1)/2.
    """
    by_lines = kennedy_centers(snapshot)
    found = {}
    for pair in combinations(snapshot.links, 2):
        one, other = (snapshot.links[name] for name in pair)
        of_velocities = center_by_velocities(one, other, snapshot)
        if of_velocities is None:
            continue
        vector, found_by = by_lines.get(pair, (of_velocities, "velocities"))
        found[pair] = _center(pair, vector, found_by, snapshot.size)
    return found


def center_by_velocities(one: RigidLink, other: RigidLink, snapshot: PlaneSnapshot) -> Array | None:
    """The center (3,) as a homogeneous unit vector, with lengths in sizes of the mechanism; None without motion."""
    velocity, omega = one.velocity - other.velocity, one.omega - other.omega
    place = 1j * velocity / snapshot.size
    vector = np.array([place.real, place.imag, omega])
    rates = [abs(link.velocity) / snapshot.size + abs(link.omega) for link in snapshot.links.values()]
    size = float(np.linalg.norm(vector))
    if size <= ROUND_OFF * max(rates):
        return None
    vector[2] = 0.0 if abs(omega) <= ROUND_OFF * size else omega
    return np.asarray(vector / np.linalg.norm(vector))


def kennedy_centers(snapshot: PlaneSnapshot) -> dict[Pair, tuple[Array, str]]:
    """The centers (3,) that joints and lines of centers give, with what gave them."""
    names, size = list(snapshot.links), snapshot.size
    order = {name: index for index, name in enumerate(names)}
    found: dict[Pair, tuple[Array, str]] = {}
    for joint in snapshot.joints:
        first, second = sorted(joint.links, key=lambda name: order[name])
        vector = np.array([joint.place.real / size, joint.place.imag / size, 1.0])
        if joint.direction:
            across = 1j * joint.direction
            vector = np.array([across.real, across.imag, 0.0])
        found[first, second] = (vector / np.linalg.norm(vector), "joint")
    missing = [pair for pair in combinations(names, 2) if pair not in found]
    while missing:
        best: tuple[float, Pair, Array] | None = None
        for pair in missing:
            sharpness, vector = _common_point(pair, names, order, found)
            if sharpness > PARALLEL and (best is None or sharpness > best[0]):
                best = sharpness, pair, vector
        if best is None:
            break
        found[best[1]] = (best[2], "Kennedy")
        missing.remove(best[1])
    return found


def _common_point(
    pair: Pair, names: list[str], order: Mapping[str, int], found: Mapping[Pair, tuple[Array, str]]
) -> tuple[float, Array]:
    """The common point of the lines through known centers with third links, and the sine of the best angle of two."""
    lines = []
    for third in names:
        if third in pair:
            continue
        one, other = (_ordered(name, third, order) for name in pair)
        if one in found and other in found:
            line = np.cross(found[one][0], found[other][0])
            length = float(np.linalg.norm(line))
            if length > SAME:
                lines.append(line / length)
    best, point = 0.0, np.zeros(3)
    for first, second in combinations(lines, 2):
        crossing = np.cross(first, second)
        sharpness = float(np.linalg.norm(crossing))
        if sharpness > best:
            best, point = sharpness, crossing / sharpness
    return best, point


def _ordered(one: str, other: str, order: Mapping[str, int]) -> Pair:
    return (one, other) if order[one] < order[other] else (other, one)


def _center(pair: Pair, vector: Array, found_by: str, size: float) -> InstantCenter:
    x, y, weight = vector
    if abs(weight) <= ROUND_OFF:
        return InstantCenter(pair, None, complex(x, y) / abs(complex(x, y)), found_by)
    return InstantCenter(pair, complex(x, y) / weight * size, None, found_by)
