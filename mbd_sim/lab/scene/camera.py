"""From where a mechanism is seen at first: near enough to fill the part of the window that the panel leaves free."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.geometry.rotation import aligning_z
from mbd_sim.pictures.shapes.extent import Extent

FOV = math.radians(30.0)  # of the height of the window
FILLED = 0.8  # of the free part of the window
PHONE = 576  # px of width of the window from which viser puts the panel beside the picture, not in a sheet below it
FREE_ON_A_PHONE = 0.55  # of the height, above the sheet
FIRST_VIEWS = 5  # that are corrected
ASPECT = 1.5  # where the window is not known


def aim(camera: Any, extent: Extent, aspect: float = ASPECT, width: float = math.inf) -> None:
    """Aim a camera of viser at the box of the motion: a plane mechanism is seen nearly from the front of its plane.

    :param aspect: the width of the window relative to its height; `width` in pixels.
    """
    turned = aligning_z(extent.up)
    toward = turned @ _direction(None if extent.normal is None else turned.T @ extent.normal)
    if extent.toward is not None and toward @ extent.toward < 0.0:  # from the back: half a turn about the vertical
        toward = 2.0 * (toward @ extent.up) * extent.up - toward
    right = np.cross(extent.up, toward)
    right /= np.linalg.norm(right)
    up = np.cross(toward, right)
    half = 0.5 * np.maximum(extent.upper - extent.lower, 0.2 * extent.size)
    corners = half * np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    free = FREE_ON_A_PHONE if width < PHONE and aspect < 1.0 else 1.0  # a wide picture has the panel beside it
    slope = math.tan(0.5 * FOV)
    reach = np.maximum(abs(corners @ right) / aspect, abs(corners @ up) / free) / (FILLED * slope)
    distance = float(np.max(reach + corners @ toward))
    look_at = extent.center - (1.0 - free) * distance * slope * up
    camera.fov = FOV
    camera.position = tuple(look_at + distance * toward)
    camera.look_at = tuple(look_at)


def keep_aimed(camera: Any, initial: Any, extent: Callable[[], Extent | None]) -> None:
    """Aim the camera of a page, and again when the window has another size, as after turning a phone.

    A slow browser applies the first view, which is the `initial` one of a usual window, after it was aimed.

    :param extent: what to aim at; None when this page is not shown any more.
    """
    sizes = [(0, 0)]

    def follow(_: Any) -> None:
        size, box = (camera.image_width, camera.image_height), extent()
        is_first = len(sizes) < FIRST_VIEWS and np.allclose(camera.position, initial.position)
        if box is not None and (sizes[-1] != size or is_first):
            sizes.append(size)
            aim(camera, box, camera.aspect, camera.image_width)

    camera.on_update(follow)
    if (box := extent()) is not None:
        aim(camera, box, camera.aspect, camera.image_width)


def _direction(normal: Array | None) -> Array:
    """The unit vector (3,) from the mechanism to the camera, in axes of which z points upward."""
    toward = np.array([0.55, -1.0, 0.5] if normal is None else [0.12, -1.0, 0.16])
    if normal is not None and abs(normal[0]) > 0.5:
        toward = np.array([1.0, -0.12, 0.16])
    if normal is not None and abs(normal[2]) > 0.5:
        toward = np.array([0.0, -0.3, 1.0])
    return np.asarray(toward / np.linalg.norm(toward))
