"""The motion of a mechanism as a recording of Rerun: the scene is logged once, then rows of samples follow."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun as rr

from mbd_sim.geometry.pose import Array
from mbd_sim.viewer import entity_paths, event_log
from mbd_sim.viewer.arrow_entities import arrow_entities
from mbd_sim.viewer.blueprint import make_blueprint
from mbd_sim.viewer.constraint_entities import constraint_entities
from mbd_sim.viewer.contact_entities import contact_entities
from mbd_sim.viewer.drive_entities import drive_entities
from mbd_sim.viewer.entity import Entity
from mbd_sim.viewer.event_log import LoggedEvent
from mbd_sim.viewer.joint_entities import joint_entities
from mbd_sim.viewer.part_entities import about, part_entities
from mbd_sim.viewer.part_poses import PartPoses
from mbd_sim.viewer.plot_entities import plot_entities, sensor_series
from mbd_sim.viewer.sample_rows import Rows
from mbd_sim.viewer.scene_description import SceneDescription
from mbd_sim.viewer.sinks import SinkConnection, is_live
from mbd_sim.viewer.spring_entities import spring_entities
from mbd_sim.viewer.trace_entities import trace_entities

APPLICATION = "mbd_sim"
FLUSH_TIMEOUT = 5.0  # s


class RerunStream:
    """One recording. `address` is where to view it: a URL, or the path of the file."""

    def __init__(self, scene: SceneDescription, sink: str, *, live: bool | None = None, footer: bool = True) -> None:
        """Open the sink and log the scene.

        :param live: follow the incoming data rather than play them in a loop; by default, loop only in files.
        :param footer: write a list of all chunks at the end of a file; it is kept in memory until then.
        :raises ViewerError: the sink cannot be opened.
        """
        self._scene = scene
        self._recording = rr.RecordingStream(APPLICATION, batcher_config=rr.ChunkBatcherConfig.LOW_LATENCY())
        self._connection = SinkConnection(
            self._recording, sink, make_blueprint(scene, live=is_live(sink) if live is None else live), footer=footer
        )
        self.address = self._connection.address
        try:
            self._recording.send_recording_name(scene.mechanism.name)
            self._recording.log(entity_paths.WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
            self._recording.log(entity_paths.ABOUT, about(scene), static=True)
            sources = (
                part_entities,
                joint_entities,
                spring_entities,
                drive_entities,
                constraint_entities,
                trace_entities,
                arrow_entities,
                contact_entities,
                plot_entities,
            )
            self._entities: list[Entity] = [item for source in sources for item in source(scene)]
            for item in self._entities:
                for path, archetype in item.static():
                    self._recording.log(path, archetype, static=True)
            for path, archetype in event_log.static():
                self._recording.log(path, archetype, static=True)
        except BaseException:
            self._connection.close()
            raise
        self._begun = False
        self._measured: set[str] = set()

    def send_samples(self, values: Array) -> None:
        """Show samples, rows (n, width) of `RowLayout` in the order of their times."""
        rows = Rows(self._scene.rows, values)
        poses = PartPoses(self._scene, rows)
        if not self._begun:
            self._begun = True
            for path, state in ((event_log.RUN, "running"), (event_log.COMMANDS, "none")):
                self._columns(path, rows.times[:1], rr.StateChange.columns(state=[state]))
        for item in self._entities:
            for path, columns in item.columns(rows, poses):
                self._columns(path, rows.times, columns)

    def send_events(self, events: Sequence[LoggedEvent]) -> None:
        """Show events."""
        for path, times, columns in event_log.columns(events):
            self._columns(path, times, columns)

    def send_measurements(self, sensor: str, quantity: str, times: Array, values: Array) -> None:
        """Show measurements (n, components) of a sensor over the times (n,) in s at which they arrived."""
        series = sensor_series(sensor, quantity, values.shape[1])
        if series.path not in self._measured:
            self._measured.add(series.path)
            for path, style in series.style():
                self._recording.log(path, style, static=True)
        for path, columns in series.values(values):
            self._columns(path, times, columns)

    def flush(self) -> None:
        """Send the buffered data.

        :raises ValueError: the viewer does not accept data any more.
        """
        self._recording.flush(timeout_sec=FLUSH_TIMEOUT)

    def close(self) -> None:
        """End the recording; a window stays open, a server stops."""
        self._recording.disconnect()
        self._connection.close()

    def _columns(self, path: str, times: np.ndarray, columns: Any) -> None:
        index = rr.TimeColumn(entity_paths.TIMELINE, duration=times)
        rr.send_columns(path, indexes=[index], columns=columns, recording=self._recording, strict=True)
