"""The target of a point, in the scene: arrows and arcs by which the user drags it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.geometry.rotation import from_quaternion, to_quaternion

SCALE = 0.22  # of the size of the mechanism

Moved = Callable[[Pose], None]


class Target:
    """A target that is hidden at first; `moved` is called in a thread of viser while a page drags it."""

    def __init__(self, scene: Any, size: float, moved: Moved) -> None:
        self._scene, self._size, self._moved = scene, size, moved
        self._turns: bool | None = None
        self._handle: Any = None

    def show(self, pose: Pose, *, turns: bool) -> None:
        """Show it in a place; with arcs for its orientation if it `turns`, else along the axes of ground."""
        if self._handle is None or turns != self._turns:
            self.hide()
            self._turns = turns
            self._handle = self._scene.add_transform_controls(
                "/target", scale=SCALE * self._size, disable_rotations=not turns, depth_test=False
            )
            self._handle.on_update(self._updated)
        self._handle.position = pose.position
        self._handle.wxyz = to_quaternion(pose.rotation if turns else np.eye(3))

    def hide(self) -> None:
        """Remove it."""
        if self._handle is not None:
            self._handle.remove()
            self._handle = None

    def _updated(self, event: Any) -> None:
        if event.client is not None:
            place: Array = np.array(event.target.position, dtype=float)
            self._moved(Pose(place, from_quaternion(np.array(event.target.wxyz, dtype=float))))
