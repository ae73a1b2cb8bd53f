"""The lines of which symbols are made, in the plane and in space: circles, spirals, coils, dashpots, curved arrows."""

from __future__ import annotations

import numpy as np

from mbd_sim.geometry.pose import Array
from mbd_sim.geometry.rotation import aligning_z

COIL_TURNS = 9
COIL_END = 0.08  # straight part at each end of a coil, relative to its length
ARC_POINTS = 25

# The segments of a dashpot, point pairs (along, across): along from 0 to 1, across in half widths.
_DASHPOT = np.array([
    [0.0, 0.0], [0.35, 0.0], [0.35, -1.0], [0.35, 1.0], [0.35, 1.0], [0.7, 1.0], [0.35, -1.0], [0.7, -1.0],
    [0.55, -0.8], [0.55, 0.8], [0.55, 0.0], [1.0, 0.0],
])  # fmt: skip


def circle(angles: Array) -> Array:
    """Points (n, 2) of the unit circle at angles (n,) in rad."""
    return np.column_stack([np.cos(angles), np.sin(angles)])


def spiral(inner: float, outer: float, turns: float, count: int = 120) -> Array:
    """Points (count, 2) of a spiral about the origin whose radius grows from `inner` to `outer`."""
    radius = np.linspace(inner, outer, count)
    return np.asarray(radius[:, None] * circle(np.linspace(0.0, 2.0 * np.pi * turns, count)))


def coil(radius: float) -> Array:
    """Points (n, 3) of a coil spring of a `radius` along z from 0 to 1, with straight ends."""
    angles = np.linspace(0.0, 2.0 * np.pi * COIL_TURNS, 24 * COIL_TURNS + 1)
    radii = radius * np.minimum(1.0, np.minimum(angles, angles[-1] - angles) / np.pi)  # from the axis and back to it
    height = COIL_END + (1.0 - 2.0 * COIL_END) * angles / angles[-1]
    return np.vstack([[0.0, 0.0, 0.0], np.column_stack([radii[:, None] * circle(angles), height]), [0.0, 0.0, 1.0]])


def flat_coil(length: float, end: float, turns: int, amplitude: float) -> Array:
    """Points (n, 2), forward and sideways, of a coil spring seen at a slant, between straight parts of length `end`.

    The windings run backward on the far side, as those of a helix do in an oblique view.
    """
    angles = np.linspace(0.0, 2.0 * np.pi * (turns + 0.5), 24 * turns + 13)
    loop = 0.26 * (length - 2.0 * end) / (turns + 0.5)
    forward = end + loop + (length - 2.0 * end - 2.0 * loop) * angles / angles[-1] - loop * np.cos(angles)
    return np.column_stack([forward, amplitude * np.sin(angles)])


def dashpot(half_width: float) -> Array:
    """The segments of a dashpot along z from 0 to 1, as pairs of consecutive points (n, 3) in the xz plane."""
    along, across = _DASHPOT.T
    return np.column_stack([half_width * across, np.zeros(len(across)), along])


def between(points: Array, start: Array, stop: Array) -> Array:
    """Points (n, 3) given along z from 0 to 1, moved so that they lead from `start` (3,) to `stop` (3,).

    z is stretched to the distance of the two; x and y keep their scale. Where the two coincide, x and y are ground's.
    """
    line = stop - start
    length = float(np.linalg.norm(line))
    rotation = aligning_z(line / length) if length > 1e-12 else np.eye(3)
    return np.asarray(start + np.outer(points[:, 2], line) + points[:, :2] @ rotation[:, :2].T)


def arc_arrow(center: Array, axis: Array, sweep: float, radius: float) -> Array:
    """Points (n, 3) of an arc of `sweep` rad about a unit `axis` (3,), right-handed, ending in an arrow head."""
    x = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    x /= np.linalg.norm(x)
    y = np.cross(axis, x)
    angles = np.linspace(0.0, sweep, ARC_POINTS)
    points = radius * (np.outer(np.cos(angles), x) + np.outer(np.sin(angles), y))
    base = sweep - min(0.35, 0.6 * sweep)
    outward = np.cos(base) * x + np.sin(base) * y
    barbs = [scale * radius * outward for scale in (1.18, 0.82)]
    return np.asarray(center + np.vstack([points, barbs[0], points[-1], barbs[1]]))
