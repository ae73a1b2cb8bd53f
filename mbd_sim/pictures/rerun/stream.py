"""The motion of a mechanism as a recording of Rerun: the scene is logged once, then rows of samples follow.

Events are on the timeline too: a log line for each, and state lanes that show whether the run is going and commanded.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr

from mbd_sim.base.geometry.pose import Array
from mbd_sim.pictures.rerun import paths
from mbd_sim.pictures.rerun.constraints import constraint_entities, contact_entities, trace_entities
from mbd_sim.pictures.rerun.forces import arrow_entities, connector_entities
from mbd_sim.pictures.rerun.parts import about, part_entities
from mbd_sim.pictures.rerun.plots import make_blueprint, plot_entities, sensor_series
from mbd_sim.pictures.rerun.scene import Entity, LoggedItems, PartPoses, Rows, SceneDescription
from mbd_sim.pictures.rerun.sinks import SinkConnection, is_live
from mbd_sim.simulation.run.events import ERRORS, EventKind

RUN, COMMANDS = f"{paths.STATES}/run", f"{paths.STATES}/commands"
STYLES = {
    RUN: {"running": (70, 130, 180), "paused": (150, 150, 160), "stopped": (229, 101, 98)},
    COMMANDS: {"none": (60, 66, 76), "taken": (96, 200, 120), "expired": (245, 166, 66)},
}
# The state that each lane enters with an event; other events leave a lane as it is.
_LANES: Mapping[str, Mapping[EventKind, str]] = {
    RUN: {
        EventKind.PAUSED: "paused",
        EventKind.RUNNING: "running",
        **dict.fromkeys(ERRORS, "stopped"),
    },
    COMMANDS: {
        EventKind.COMMAND: "taken",
        EventKind.EXPIRED: "expired",
        EventKind.RESET: "none",
        EventKind.NEW_STATE: "none",
    },
}
_WARNINGS = (EventKind.WARNING, EventKind.EXPIRED)


@dataclass(frozen=True, slots=True)
class LoggedEvent:
    """An event at a time (s) on the timeline, with its text."""

    time: float
    kind: EventKind
    text: str


def level(kind: EventKind) -> str:
    """The severity of an event as Rerun shows it."""
    if kind in ERRORS:
        return str(rr.TextLogLevel.ERROR)
    return str(rr.TextLogLevel.WARN if kind in _WARNINGS else rr.TextLogLevel.INFO)


def static() -> LoggedItems:
    """The colors of the lanes."""
    for entity, styles in STYLES.items():
        yield entity, rr.StateConfiguration(values=list(styles), colors=list(styles.values()))


def event_columns(events: Sequence[LoggedEvent]) -> list[tuple[str, np.ndarray, object]]:
    """The entities that the events change, each with its times (s) and columns."""
    times = np.array([event.time for event in events])
    texts = ["commands are accepted" if event.kind is EventKind.COMMAND else event.text for event in events]
    lines = rr.TextLog.columns(text=texts, level=[level(event.kind) for event in events])
    found: list[tuple[str, np.ndarray, object]] = [(paths.EVENTS, times, lines)]
    for entity, states in _LANES.items():
        changes = [(event.time, states[event.kind]) for event in events if event.kind in states]
        if changes:
            lane = rr.StateChange.columns(state=[state for _, state in changes])
            found.append((entity, np.array([time for time, _ in changes]), lane))
    return found


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
            self._recording.log(paths.WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
            self._recording.log(paths.ABOUT, about(scene), static=True)
            sources = (
                part_entities,
                connector_entities,
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
            for path, archetype in static():
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
            for path, state in ((RUN, "running"), (COMMANDS, "none")):
                self._columns(path, rows.times[:1], rr.StateChange.columns(state=[state]))
        for item in self._entities:
            for path, columns in item.columns(rows, poses):
                self._columns(path, rows.times, columns)

    def send_events(self, events: Sequence[LoggedEvent]) -> None:
        """Show events."""
        for path, times, columns in event_columns(events):
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
        index = rr.TimeColumn(paths.TIMELINE, duration=times)
        rr.send_columns(path, indexes=[index], columns=columns, recording=self._recording, strict=True)
