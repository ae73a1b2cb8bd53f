"""An assembly in the scene of viser: its parts, and the numbers of the joints that their faces offer."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import Any

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.geometry.rotation import aligning_z, to_quaternion
from mbd_sim.imports.build import Import
from mbd_sim.imports.joints import Candidate
from mbd_sim.imports.picture import COLORS
from mbd_sim.pictures.shapes.extent import Extent
from mbd_sim.pictures.shapes.meshes import coarsened
from mbd_sim.pictures.shapes.palette import Color, from_hex

MOST_TRIANGLES = 400_000  # of all parts together
GLASS = 0.2  # opacity of ground; the other parts have that of the slider
MARK, AXIS, LINE = 0.009, 0.07, 0.004  # radius of a mark, half the length and the width of an axis; of the size
TAKEN, LEFT = (179, 38, 30), (130, 136, 145)
NEAR = 0.02  # between joints that have one label, relative to the size
ROOT = "/assembly"


class AssemblyScene:
    """The parts of an import, upright; joints that are taken are red."""

    def __init__(self, scene: Any, found: Import, clicked: Callable[[str], None]) -> None:
        """Draw it; `clicked` is called in a thread of viser with the name of a part."""
        turned = aligning_z(found.upward).T  # from the axes of the assembly to those in which z points upward
        corners = np.concatenate([part.triangles().reshape(-1, 3) for part in found.assembly.parts]) @ turned.T
        low, high = corners.min(axis=0), corners.max(axis=0)
        self.extent = Extent(low, high, float(np.linalg.norm(high - low)), None)
        scene.set_up_direction(self.extent.up)  # not that of the mechanism that was shown before
        scene.add_frame(ROOT, show_axes=False, wxyz=to_quaternion(turned))
        most = max(MOST_TRIANGLES // len(found.assembly.parts), 200)
        self._parts: dict[str, Any] = {}
        for number, part in enumerate(found.assembly.parts):
            own = next((placed.color for placed in part.bodies if placed.color), None) or COLORS[number % len(COLORS)]
            triangles = coarsened(part.triangles(), most)
            handle = self._add_mesh(scene, f"{ROOT}/part_{number}", triangles, from_hex(own))
            handle.on_click(lambda _, name=part.name: clicked(name))
            self._parts[part.name] = handle
        self._marks = {one.number: self._add_mark(scene, one) for one in found.candidates}
        for number, (place, text) in enumerate(labels(found.candidates, NEAR * self.extent.size)):
            scene.add_label(f"{ROOT}/label_{number}", text, anchor="bottom-center", position=place)

    def show(self, taken: Collection[int], ground: str | None, opacity: float) -> None:
        """Color the joints by whether they are taken, and make ground transparent."""
        for name, handle in self._parts.items():
            handle.opacity = min(GLASS, opacity) if name == ground else opacity
        for number, (mark, line) in self._marks.items():
            color = TAKEN if number in taken else LEFT
            mark.color = color
            if line is not None:
                line.colors = np.array(color, dtype=np.uint8)

    def _add_mesh(self, scene: Any, name: str, triangles: Array, color: Color) -> Any:
        faces = np.arange(3 * len(triangles)).reshape(-1, 3)
        return scene.add_mesh_simple(
            name, triangles.reshape(-1, 3), faces, color=color, flat_shading=True, side="double", opacity=1.0
        )

    def _add_mark(self, scene: Any, one: Candidate) -> tuple[Any, Any]:
        """The point of a joint, and its axis."""
        size, name = self.extent.size, f"{ROOT}/joint_{one.number}"
        mark = scene.add_icosphere(name, radius=MARK * size, color=LEFT, position=one.point)
        if one.axis is None:
            return mark, None
        ends = np.array([[one.point - AXIS * size * one.axis, one.point + AXIS * size * one.axis]], dtype=np.float32)
        return mark, scene.add_line_segments(f"{name}_axis", ends, LEFT, thickness=LINE * size)


def labels(candidates: Sequence[Candidate], near: float) -> list[tuple[Array, str]]:
    """The places (3,) and the numbers of joints: one label for those that are `near` each other, in m."""
    found: list[tuple[Array, list[str]]] = []
    for one in candidates:
        for place, numbers in found:
            if np.linalg.norm(place - one.point) <= near:
                numbers.append(str(one.number))
                break
        else:
            found.append((one.point, [str(one.number)]))
    return [(place, ", ".join(numbers)) for place, numbers in found]
