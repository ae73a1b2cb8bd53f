"""From where a mechanism is seen at first."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbd_sim.pictures.shapes.extent import Extent

DISTANCE = 1.25  # relative to the longest side of the box of the motion


def aim(camera: Any, extent: Extent) -> None:
    """Aim the first camera of a page at the box of the motion: a plane mechanism from the front of its plane."""
    normal = extent.normal
    distance = DISTANCE * max(float(max(extent.upper - extent.lower)), extent.size)
    toward = np.array([0.55, -1.0, 0.5] if normal is None else [0.12, -1.0, 0.16])
    if normal is not None and abs(normal[0]) > 0.5:
        toward = np.array([1.0, -0.12, 0.16])
    if normal is not None and abs(normal[2]) > 0.5:
        toward = np.array([0.05, -0.3, 1.0])
    camera.position = tuple(extent.center + distance * toward / np.linalg.norm(toward))
    camera.look_at = tuple(extent.center)
