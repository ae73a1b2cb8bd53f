"""The paths of points: by default of the tips of the mechanism, else of a chosen point, as a coupler curve."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.lab.scene.arrows import NOWHERE
from mbd_sim.mechanism.elements.parts import Attachment
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.pictures.shapes import palette
from mbd_sim.pictures.shapes.joints import default_traces
from mbd_sim.pictures.shapes.solids import LINE_WIDTH

POINTS = 600
NEAR = 2e-3  # relative to the mechanism's size, between two points of a path
SELDOM = 4  # pictures between two updates of the lines, which are long
TIPS = "tips"


class Traces:
    """The paths in the scene of viser."""

    def __init__(self, scene: Any, mechanism: Mechanism, size: float) -> None:
        self._scene, self._size, self._pictures = scene, size, 0
        self._mechanism, self.chosen = mechanism, TIPS
        self._paths: dict[str, list[Array]] = {}
        self._handles: dict[str, Any] = {}
        self.follow(mechanism)

    def choose(self, name: str) -> None:
        """Show the path of a `part.point` from here on, or of the tips."""
        self.forget()
        self.chosen = name
        self.follow(self._mechanism)

    def follow(self, mechanism: Mechanism) -> None:
        """Find the points in a mechanism with other values."""
        self._mechanism = mechanism
        part, _, point = self.chosen.rpartition(".")
        tips = default_traces(mechanism)
        at = tips if self.chosen == TIPS else {part: Attachment(part, mechanism.parts[part].points[point].position)}
        self._at = at
        colors = palette.part_colors(mechanism)
        for name in at.keys() - self._handles.keys():
            self._handles[name] = self._scene.add_line_segments(
                f"/traces/{name}", NOWHERE, colors[name], thickness=0.6 * LINE_WIDTH * self._size
            )

    def extend(self, place: Callable[[Attachment], Array]) -> None:
        """Go on to the present places of the points."""
        self._pictures += 1
        for name, at in self._at.items():
            path, here = self._paths.setdefault(name, []), place(at)
            if not path or np.linalg.norm(here - path[-1]) > NEAR * self._size:
                path.append(here)
                del path[:-POINTS]
            drawn = self._handles[name]
            if self._pictures % SELDOM == 0 and len(path) > 1 and not _ends_with(drawn.points, path):
                drawn.points = np.stack([path[:-1], path[1:]], axis=1).astype(np.float32)

    def forget(self) -> None:
        """Forget all paths, as after a change of a length."""
        for name, path in self._paths.items():
            path.clear()
            if len(self._handles[name].points):
                self._handles[name].points = NOWHERE


def _ends_with(drawn: Array, path: list[Array]) -> bool:
    return len(drawn) == len(path) - 1 and np.array_equal(drawn[-1, 1], path[-1].astype(np.float32))


def traceable(mechanism: Mechanism) -> tuple[str, ...]:
    """What can be traced, by name."""
    return (TIPS, *(f"{part.name}.{point}" for part in mechanism.parts.values() for point in part.points))
