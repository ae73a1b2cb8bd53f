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
        self._touching = True

    def static(self) -> LoggedItems:
        """Its style."""
        yield self.path, rr.LineStrips3D.from_fields(colors=[self._color], radii=[self._radius])

    def columns_through(self, rows: Rows, points: Array, touching: Array) -> LoggedItems:
        """The pieces through points (n, 3); those that end where `touching` (n,) is False are not drawn."""
        times = np.concatenate([[self._time], rows.motion_times])
        before = np.vstack([self._end, points[:-1]])
        restarted = (np.diff(times) <= 0.0) | ~np.concatenate([[self._touching], touching[:-1]])
        before[restarted] = points[restarted]
        self._end, self._time, self._touching = points[-1], float(times[-1]), bool(touching[-1])
        columns = rr.LineStrips3D.columns(strips=list(np.stack([before, points], axis=1)[touching]))
        yield self.path, columns if touching.all() else columns.partition(touching.astype(int))


class _PointTrace(Trace):
    """The trace of a point of a part."""

    def __init__(self, name: str, at: Attachment, color: palette.Color, radius: float) -> None:
        super().__init__(entity_paths.trace(name), color, radius)
        self._at = at

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        yield from self.columns_through(rows, poses.point(self._at), np.ones(len(rows), dtype=bool))
