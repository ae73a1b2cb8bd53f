"""A mechanism's motion as a recording of Rerun: the stage is set once, then rows of samples come in."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun as rr

from mbd_sim.geometry.pose import Array
from mbd_sim.viewer import entity_paths, event_log
from mbd_sim.viewer.arrow_entities import arrows
from mbd_sim.viewer.blueprint import make_blueprint
from mbd_sim.viewer.constraint_entities import guides
from mbd_sim.viewer.entity import Prop
from mbd_sim.viewer.event_log import LoggedEvent
from mbd_sim.viewer.joint_entities import pins
from mbd_sim.viewer.part_entities import about, parts
from mbd_sim.viewer.placement import Placement
from mbd_sim.viewer.plot_entities import plots
from mbd_sim.viewer.sample_rows import Rows
from mbd_sim.viewer.scene_description import Stage
from mbd_sim.viewer.sinks import Outlet, is_live
from mbd_sim.viewer.spring_entities import ties
from mbd_sim.viewer.trace_entities import traces

APPLICATION = "mbd_sim"
FLUSH_TIMEOUT = 5.0  # s


class Presentation:
    """One recording. `address` says where to look."""

    def __init__(self, stage: Stage, sink: str, *, live: bool | None = None) -> None:
        """Open the sink and log what does not change.

        :param live: follow what comes in, rather than play it again and again; None: where somebody watches.
        :raises ViewerError: the sink cannot be opened.
        """
        self._stage = stage
        self._recording = rr.RecordingStream(APPLICATION, batcher_config=rr.ChunkBatcherConfig.LOW_LATENCY())
        self._outlet = Outlet(
            self._recording, sink, make_blueprint(stage, live=is_live(sink) if live is None else live)
        )
        self.address = self._outlet.address
        try:
            self._recording.send_recording_name(stage.mechanism.name)
            self._recording.log(entity_paths.WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
            self._recording.log(entity_paths.ABOUT, about(stage), static=True)
            sources = (parts, pins, ties, guides, traces, arrows, plots)
            self._props: list[Prop] = [prop for source in sources for prop in source(stage)]
            for prop in self._props:
                for entity, what in prop.static():
                    self._recording.log(entity, what, static=True)
            for entity, what in event_log.static():
                self._recording.log(entity, what, static=True)
        except BaseException:
            self._outlet.close()
            raise
        self._begun = False

    def send(self, values: Array) -> None:
        """Show samples, the rows (n, width) of `RowLayout`, in the order of their times."""
        rows = Rows(self._stage.rows, values)
        placement = Placement(self._stage, rows)
        if not self._begun:
            self._begun = True
            for entity, state in ((event_log.RUN, "running"), (event_log.COMMANDS, "none")):
                self._columns(entity, rows.times[:1], rr.StateChange.columns(state=[state]))
        for prop in self._props:
            for entity, columns in prop.columns(rows, placement):
                self._columns(entity, rows.times, columns)

    def tell(self, told: Sequence[LoggedEvent]) -> None:
        """Show events."""
        for entity, times, columns in event_log.columns(told):
            self._columns(entity, times, columns)

    def flush(self) -> None:
        """Pass on what is in the buffers.

        :raises ValueError: the viewer takes nothing any more.
        """
        self._recording.flush(timeout_sec=FLUSH_TIMEOUT)

    def close(self) -> None:
        """End the recording; a window stays open, a server stops."""
        self._recording.disconnect()
        self._outlet.close()

    def _columns(self, entity: str, times: np.ndarray, columns: Any) -> None:
        index = rr.TimeColumn(entity_paths.TIMELINE, duration=times)
        rr.send_columns(entity, indexes=[index], columns=columns, recording=self._recording, strict=True)
