"""The traces that points leave."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import rerun as rr

from mbd_sim.appearance import palette
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import Attachment
from mbd_sim.viewer import entity_paths
from mbd_sim.viewer.entity import Entity, LoggedItems
from mbd_sim.viewer.part_poses import PartPoses
from mbd_sim.viewer.sample_rows import Rows
from mbd_sim.viewer.scene_description import SceneDescription


def trace_entities(scene: SceneDescription) -> Iterator[Entity]:
    """The chosen traces."""
    colors = palette.part_colors(scene.mechanism)
    for name, at in scene.traces.items():
        yield _PointTrace(name, at, colors.get(at.part, palette.JOINT), 0.005 * scene.extent.size)


class Trace:
    """A trace in pieces: each row is the line from the sample before, and the view shows those of the last second.

    A trace starts again where the motion does, as after a reset.
    """

    def __init__(self, path: str, color: palette.Color, radius: float) -> None:
        self.path, self._color, self._radius = path, color, radius
        self._end, self._time = np.zeros(3), np.inf

    def static(self) -> LoggedItems:
        """Its style."""
        yield self.path, rr.LineStrips3D.from_fields(colors=[self._color], radii=[self._radius])

    def columns_through(self, rows: Rows, points: Array) -> LoggedItems:
        """The pieces through points (n, 3)."""
        times = np.concatenate([[self._time], rows.motion_times])
        before = np.vstack([self._end, points[:-1]])
        restarted = np.diff(times) <= 0.0
        before[restarted] = points[restarted]
        self._end, self._time = points[-1], float(times[-1])
        yield self.path, rr.LineStrips3D.columns(strips=list(np.stack([before, points], axis=1)))


class _PointTrace(Trace):
    """The trace of a point of a part."""

    def __init__(self, name: str, at: Attachment, color: palette.Color, radius: float) -> None:
        super().__init__(entity_paths.trace(name), color, radius)
        self._at = at

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        yield from self.columns_through(rows, poses.point(self._at))
