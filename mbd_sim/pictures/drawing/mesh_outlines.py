"""Meshes in drawings: the outline of what they cover on the sheet, holes included, as a few short paths."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.mechanism.elements.parts import Part
from mbd_sim.pictures.drawing.sheet import ScaledView, SheetPath, fill_color, outline_color
from mbd_sim.pictures.shapes.meshes import part_triangles
from mbd_sim.pictures.shapes.palette import Color, from_hex

PIXEL = 0.2  # pt; finer details are lost
MOST_PIXELS = 1500  # along a side; the pixels of larger outlines are larger
MARGIN = 2  # pixels around a mesh
DEVIATION = 1.2  # pixels, of a path from the outline
MOST_POINTS = 600  # of all paths of a mesh; beyond, the permitted deviation is larger
MOST_PIECES = 20  # separate outlines and holes of a mesh, the largest ones
SMALLEST = 25.0  # pixels, area of a piece

Piece = list[Array]  # an outline (n, 2), then its holes


def mesh_paths(page: ScaledView, part: Part, source: str, pose: Pose, color: Color) -> list[SheetPath]:
    """The meshes of a part whose frame is at `pose` in ground's; empty if none can be drawn.

    :param source: the file of the mechanism, from whose folder the paths of meshes count.
    """
    paths: list[SheetPath] = []
    for mesh, corners in part_triangles(part, source):
        placed = pose.position + corners @ pose.rotation.T
        own = from_hex(mesh.color) if mesh.color else color
        depth = page.depth(0.5 * (placed.min(axis=(0, 1)) + placed.max(axis=(0, 1))))
        for piece in outlines(page.project(placed)):
            paths.append(SheetPath(_joined(piece), edge=None, fill=fill_color(own), closed=True, depth=depth))
            paths += [SheetPath(ring, edge=outline_color(own), closed=True, depth=depth) for ring in piece]
    return paths


def outlines(projected: Array) -> list[Piece]:
    """The outlines of triangles (n, 3, 2) on the sheet, in points."""
    from contourpy import contour_generator

    low, high = projected.min(axis=(0, 1)), projected.max(axis=(0, 1))
    pixel = max(PIXEL, float(np.max(high - low)) / MOST_PIXELS)
    size = np.ceil((high - low) / pixel).astype(int) + 2 * MARGIN + 1
    covered = _rasterized((projected - low) / pixel + MARGIN, size)
    filled: Any = contour_generator(z=covered, fill_type="OuterOffset").filled(0.5, 2.0)
    pieces = [
        [polygon[first:last] for first, last in pairwise(offsets)] for polygon, offsets in zip(*filled, strict=True)
    ]
    return [[low + (ring - MARGIN) * pixel for ring in piece] for piece in _simplified(_largest(pieces))]


def _rasterized(corners: Array, size: Array) -> Array:
    """The pixels (height, width) that triangles (n, 3, 2) in pixels cover, as 1 and 0."""
    from PIL import Image, ImageDraw

    image = Image.new("L", (int(size[0]), int(size[1])))
    pen = ImageDraw.Draw(image)
    for triangle in np.unique(np.round(corners.reshape(-1, 6)), axis=0).tolist():
        pen.polygon(triangle, fill=1)
    return np.asarray(image, dtype=float)


def _largest(pieces: list[Piece]) -> list[Piece]:
    """The pieces and holes large enough to be seen, the largest first; at least one piece."""
    ordered = sorted(pieces, key=lambda piece: -_area(piece[0]))[:MOST_PIECES]
    kept = [piece for piece in ordered if _area(piece[0]) >= SMALLEST] or ordered[:1]
    left, result = MOST_PIECES, []
    for outer, *holes in kept:
        visible = sorted((hole for hole in holes if _area(hole) >= SMALLEST), key=lambda hole: -_area(hole))[:left]
        left -= len(visible)
        result.append([outer, *visible])
    return result


def _simplified(pieces: list[Piece]) -> list[Piece]:
    """Pieces with fewer points."""
    deviation = DEVIATION
    while True:
        short = [[_thinned(ring, deviation) for ring in piece] for piece in pieces]
        if sum(len(ring) for piece in short for ring in piece) <= MOST_POINTS:
            return short
        deviation *= 1.5


def _thinned(ring: Array, deviation: float) -> Array:
    """A closed polygon (n, 2) without the points that deviate less from the lines between the others.

    Douglas and Peucker's algorithm, from the first point and the one farthest from it.
    """
    ring = ring[:-1] if len(ring) > 1 and np.array_equal(ring[0], ring[-1]) else ring
    closed = np.vstack([ring, ring[:1]])
    middle = int(np.argmax(np.hypot(*(ring - ring[0]).T)))
    keep, open_ranges = {0, middle}, [(0, middle), (middle, len(ring))]
    while open_ranges:
        first, last = open_ranges.pop()
        if last - first < 2:
            continue
        along = closed[last] - closed[first]
        inner = closed[first + 1 : last] - closed[first]
        length = float(np.hypot(*along))
        away = np.abs(inner @ [-along[1], along[0]]) / length if length > 0.0 else np.hypot(*inner.T)
        worst = int(np.argmax(away))
        if away[worst] > deviation:
            keep.add(first + 1 + worst)
            open_ranges += [(first, first + 1 + worst), (first + 1 + worst, last)]
    return ring[sorted(keep)]


def _joined(piece: Piece) -> Array:
    """A piece as one polygon, whose holes turn the other way and are reached over lines of no width."""
    outer, *holes = piece
    start = outer[:1]
    return np.vstack([outer, start, *(np.vstack([hole, hole[:1], start]) for hole in holes)])


def _area(ring: Array) -> float:
    """The area of a closed polygon (n, 2)."""
    x, y = ring.T
    return abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1))) / 2.0
