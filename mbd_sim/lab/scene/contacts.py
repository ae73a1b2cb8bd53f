"""The closed contacts in the scene of viser: points, lines along the normals, and arrows of the forces."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbd_sim.lab.scene.arrows import NOWHERE, Arrows
from mbd_sim.lab.scene.vectors import Vectors
from mbd_sim.pictures.shapes import palette
from mbd_sim.pictures.shapes.extent import Extent
from mbd_sim.pictures.shapes.solids import LINE_WIDTH
from mbd_sim.pictures.shapes.touching import NONE_TOUCHING, ForceScale, Touching

ON_LIGHT = (196, 138, 0)
POINT, NORMAL_WIDTH = 0.013, 0.5 * LINE_WIDTH  # relative to the mechanism's size


class ContactNodes:
    """The nodes of contacts, with the scale of their arrows for a mechanism of a `weight` in N."""

    def __init__(self, scene: Any, extent: Extent, weight: float, *, dark: bool) -> None:
        color = palette.CONTACT if dark else ON_LIGHT
        size = extent.size
        self._extent, self._scale = extent, ForceScale(weight)
        self._arrows = Arrows(scene, "contacts", color, size, (weight, 1.0))
        self._points = scene.add_point_cloud(
            "/contact_points",
            NOWHERE[:, 0],
            color,
            point_size=POINT * size,
            point_shape="circle",
            point_shading="flat",
            precision="float32",
        )
        self._normals = scene.add_line_segments("/contact_normals", NOWHERE, color, thickness=NORMAL_WIDTH * size)

    def show(self, contacts: Touching) -> None:
        """Show these contacts, and no others."""
        contacts = contacts.in_front(self._extent)
        self._scale.add(contacts.forces)
        self._arrows.full = self._scale.full, 1.0
        self._arrows.show(
            Vectors(list(zip(contacts.points, contacts.forces, strict=True))), contacts.pushes.astype(bool).tolist()
        )
        if len(contacts.points) or len(self._points.points):
            self._points.points = contacts.points.astype(np.float32)
            self._normals.points = contacts.normal_lines(self._extent.size).astype(np.float32)

    def hide(self) -> None:
        """Show no contacts."""
        self.show(NONE_TOUCHING)
