"""The area within a closed outline and its moments, by Green's theorem."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.linear_algebra import added
from mbd_sim.base.rounded import gauss_legendre
from mbd_sim.mechanism.outlines.pieces import Outline, Piece, Point

POINTS = 16  # of Gauss–Legendre quadrature
QUARTER = 0.5 * math.pi  # rad, turn up to which the nodes integrate an arc to round-off


@dataclass(frozen=True)
class Area:
    """An `area` in m², its `center` in m, and ∫x² dA, ∫y² dA and ∫x y dA in m⁴ about the center."""

    area: float
    center: Point
    xx: float
    yy: float
    xy: float


def runs_clockwise(outline: Outline) -> bool:
    """Whether a closed outline has its material on its right."""
    origin = np.array(outline.pieces[0].start)
    return added(float(_integrals(piece, origin)[0]) for piece in outline.pieces) < 0.0


def area_of(outline: Outline) -> Area:
    """The area within a closed outline that does not cross itself; negative if the outline runs clockwise."""
    origin = np.array(outline.pieces[0].start)
    area, x, y, xx, yy, xy = sum((_integrals(piece, origin) for piece in outline.pieces), np.zeros(6))
    x, y = x / area, y / area
    center = float(origin[0] + x), float(origin[1] + y)
    return Area(float(area), center, float(xx - area * x * x), float(yy - area * y * y), float(xy - area * x * y))


def _integrals(piece: Piece, origin: Array) -> Array:
    """The integrals (6,) along a piece that are those of 1, x, y, x², y² and x y over the area, about the origin."""
    parts, total = math.ceil(abs(piece.last - piece.first) / QUARTER) or 1, np.zeros(6)
    nodes, weights = (np.array(values) for values in gauss_legendre(POINTS))
    for part in range(parts):
        shares = (part + 0.5 * (nodes + 1.0)) / parts
        x, y = (piece.points(shares) - origin).T
        dx, dy = piece.slopes(shares).T * 0.5 * weights / parts
        total += (
            0.5 * np.sum(x * dy - y * dx),
            0.5 * np.sum(x * x * dy),
            -0.5 * np.sum(y * y * dx),
            np.sum(x * x * x * dy) / 3.0,
            -np.sum(y * y * y * dx) / 3.0,
            0.5 * np.sum(x * x * y * dy),
        )
    return total
