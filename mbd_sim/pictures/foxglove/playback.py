"""A recorded run in Foxglove: its time bar plays, stops and searches the run, as often as is liked."""

from __future__ import annotations

import bisect
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from foxglove.websocket import (
    ChannelView,
    Client,
    PlaybackCommand,
    PlaybackControlRequest,
    PlaybackState,
    PlaybackStatus,
    ServerListener,
)

from mbd_sim.base.geometry.pose import Array
from mbd_sim.pictures.foxglove.entities import nanoseconds
from mbd_sim.pictures.foxglove.stream import FoxgloveStream
from mbd_sim.pictures.rerun.scene import LoggedEvent, SceneDescription
from mbd_sim.pictures.rerun.sinks import ViewerError

PERIOD = 1.0 / 30.0  # s between two batches


@dataclass
class _Measurements:
    """Those of a quantity of a sensor."""

    times: list[float] = field(default_factory=list)
    values: list[Array] = field(default_factory=list)


class Playback:
    """Collects a run like a stream, and then plays it; `address` is what Foxglove connects to."""

    def __init__(self, scene: SceneDescription, port: int) -> None:
        """Nothing listens on the port before `play`."""
        self._scene, self._port = scene, port
        self._rows: list[Array] = []
        self._events: list[LoggedEvent] = []
        self._measured: dict[tuple[str, str], _Measurements] = {}
        self._samples, self._times, self._control = np.zeros((0, scene.rows.width)), list[float](), _Control(0.0, 0.0)
        self._stream: FoxgloveStream | None = None
        self.address = ""

    def send_samples(self, values: Array) -> None:
        """Keep samples."""
        self._rows.append(values)

    def send_events(self, events: Sequence[LoggedEvent]) -> None:
        """Keep events."""
        self._events += events

    def send_measurements(self, sensor: str, quantity: str, times: Array, values: Array) -> None:
        """Keep measurements."""
        kept = self._measured.setdefault((sensor, quantity), _Measurements())
        kept.times += times.tolist()
        kept.values += list(values)

    def flush(self) -> None:
        """Start the server: everything has been collected.

        :raises ViewerError: there are no states, or nothing can listen on the port.
        """
        if not self._rows:
            raise ViewerError("Foxglove's time bar has nothing to play: there are no states.")
        self._samples = np.concatenate(self._rows)
        self._times = self._samples[:, 0].tolist()
        self._control = _Control(self._times[0], self._times[-1])
        span = nanoseconds(self._control.first), nanoseconds(self._control.last)
        self._stream = FoxgloveStream(self._scene, self._port, server_listener=self._control, playback_time_range=span)
        self._control.stream, self.address = self._stream, self._stream.address

    def play(self, stop: threading.Event) -> None:
        """Play as Foxglove's time bar says, until `stop` is set; it stands at the start until somebody looks."""
        stream, control = self._stream, self._control
        assert stream is not None
        shown, began, status = -np.inf, time.monotonic(), None
        while not stop.wait(PERIOD):
            now = time.monotonic()
            position, sought = control.advance(now - began)
            began = now
            if sought:
                shown = -np.inf
            self._send(stream, shown, position)
            shown = position
            state = control.state()
            if state.status != status:
                stream.server.broadcast_playback_state(state)
            status = state.status

    def close(self) -> None:
        """Stop the server."""
        if self._stream is not None:
            self._stream.close()

    def _send(self, stream: FoxgloveStream, after: float, until: float) -> None:
        """Send what lies after one time in s and up to another; after a search, the last sample before it only."""
        last = bisect.bisect_right(self._times, until)
        first = bisect.bisect_right(self._times, after) if np.isfinite(after) else max(last - 1, 0)
        if first < last:
            stream.send_samples(self._samples[first:last])
        else:
            stream.flush()
        if not np.isfinite(after):
            return
        stream.send_events([event for event in self._events if after < event.time <= until])
        for (sensor, quantity), kept in self._measured.items():
            first, last = (bisect.bisect_right(kept.times, each) for each in (after, until))
            if first < last:
                stream.send_measurements(
                    sensor, quantity, np.array(kept.times[first:last]), np.array(kept.values[first:last])
                )


class _Control(ServerListener):
    """Where the playback stands, and what Foxglove's time bar asks for; times in s."""

    def __init__(self, first: float, last: float) -> None:
        self.first, self.last = first, last
        self.stream: FoxgloveStream | None = None
        self._lock = threading.Lock()
        self._position, self._speed, self._playing, self._sought = first, 1.0, False, True
        self._watched = False

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        """Somebody begins to look: the first one starts the playback."""
        if self.stream is not None:
            self.stream.look()
        with self._lock:
            if not self._watched:
                self._watched = self._playing = True

    def on_playback_control_request(self, playback_control_request: PlaybackControlRequest) -> PlaybackState:
        """Play, stop or search."""
        request = playback_control_request
        with self._lock:
            self._playing = request.playback_command == PlaybackCommand.Play
            if np.isfinite(request.playback_speed) and request.playback_speed > 0.0:
                self._speed = request.playback_speed
            if request.seek_time is not None:
                self._position, self._sought = min(max(request.seek_time * 1e-9, self.first), self.last), True
            elif self._playing and self._position >= self.last:
                self._position, self._sought = self.first, True  # once more
        return self.state(did_seek=request.seek_time is not None, request=request.request_id)

    def advance(self, seconds: float) -> tuple[float, bool]:
        """Let time pass; the position, and whether it was sought since the last call."""
        with self._lock:
            sought, self._sought = self._sought, False
            if self._playing and not sought:
                self._position = min(self._position + seconds * self._speed, self.last)
                self._playing = self._position < self.last
            return self._position, sought

    def state(self, *, did_seek: bool = False, request: str | None = None) -> PlaybackState:
        """What Foxglove's time bar shows."""
        with self._lock:
            at_end = self._position >= self.last
            still = PlaybackStatus.Ended if at_end else PlaybackStatus.Paused
            status = PlaybackStatus.Playing if self._playing else still
            return PlaybackState(status, nanoseconds(self._position), self._speed, did_seek, request)
