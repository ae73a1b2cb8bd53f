"""Arrows and arcs with arrow heads in the scene of viser."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.lab.scene.vectors import Vectors
from mbd_sim.pictures.shapes.joints import LONG, LONGEST
from mbd_sim.pictures.shapes.palette import Color
from mbd_sim.pictures.shapes.solids import LINE_WIDTH, arc_arrow

SHORT = 1e-3  # relative to the mechanism's size; shorter arrows are not drawn
SWEEP, MAX_SWEEP = np.radians(240.0), np.radians(330.0)  # of the arc of a couple
RADIUS = 0.07  # of an arc, relative to the mechanism's size
SLIGHTEST = 0.02  # of a full couple; smaller ones are not drawn
NOWHERE = np.zeros((0, 2, 3), dtype=np.float32)


class Arrows:
    """Arrows and arcs of one color; `full` are the magnitudes drawn at full length."""

    def __init__(self, scene: Any, name: str, color: Color, size: float, full: tuple[float, float]) -> None:
        self._size, self.full = size, full
        self._arrows = scene.add_arrows(
            f"/{name}", NOWHERE, color, shaft_radius=0.006 * size, head_radius=0.016 * size, head_length=0.045 * size
        )
        self._arcs = scene.add_line_segments(f"/{name}_arcs", NOWHERE, color, thickness=LINE_WIDTH * size)

    def show(self, vectors: Vectors, pushes: list[bool] | None = None) -> None:
        """Draw vectors; of the straight ones, those that are `pushes` end at their points."""
        flags = [False] * len(vectors.straight) if pushes is None else pushes
        arrows = [self._arrow(*one, push) for one, push in zip(vectors.straight, flags, strict=True)]
        _set(self._arrows, [arrow for arrow in arrows if arrow is not None])
        _set(self._arcs, [segment for one in vectors.turning for segment in self._arc(*one)])

    def _arrow(self, point: Array, vector: Array, push: bool) -> Array | None:
        """The ends (2, 3) of an arrow; None if it is too short to be seen."""
        magnitude = float(np.linalg.norm(vector))
        length = min(LONG * magnitude / self.full[0], LONGEST)
        if not length > SHORT:
            return None
        along = length * self._size * vector / magnitude
        return np.array([point - along, point] if push else [point, point + along])

    def _arc(self, center: Array, couple: Array) -> Array:
        """The segments (n, 2, 3) of an arc about a couple; none if it is too small."""
        magnitude = float(np.linalg.norm(couple))
        if not magnitude > SLIGHTEST * self.full[1]:
            return np.empty((0, 2, 3))
        sweep = min(SWEEP * magnitude / self.full[1], MAX_SWEEP)
        points = arc_arrow(center, couple / magnitude, float(sweep), RADIUS * self._size)
        return np.stack([points[:-1], points[1:]], axis=1)


def _set(handle: Any, drawn: list[Array]) -> None:
    if drawn or len(handle.points):
        handle.points = np.array(drawn, dtype=np.float32).reshape(-1, 2, 3)
