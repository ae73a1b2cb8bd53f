"""Shows a motion in Rerun from a thread of its own, so that it never makes the simulation wait."""

from __future__ import annotations

import atexit
import logging
import threading
import time
from types import TracebackType
from typing import TYPE_CHECKING

from mbd_sim.mechanism.model import Array
from mbd_sim.model import Energies, Model
from mbd_sim.viewer.mailbox import Mailbox
from mbd_sim.viewer.sinks import Outlet, ViewerError, checked_sink, is_live

if TYPE_CHECKING:
    from mbd_sim.viewer.columns import Event, Sample

APPLICATION = "mbd_sim"
PERIOD = 0.05  # s between two batches
BATCH = 500  # samples
FLUSH_PERIOD, FLUSH_TIMEOUT = 1.0, 5.0  # s
CLOSE_TIMEOUT = 20.0  # s

_log = logging.getLogger(__name__)


class Viewer:
    """A recording in Rerun that takes samples of a motion.

    `rate` is the number of samples kept for each second of simulated time; `capacity` the number that may wait.
    When the viewer is slower than the simulation, the oldest waiting samples go, and `dropped` counts them.
    `address` says where to look, `failure` what ended the recording early. Times are simulated time in s and
    should not go back: the timeline has one place for each time. Offer the start too: before the first sample
    all parts lie at the origin.

    >>> with Viewer(sim.model, "run.rrd") as viewer:
    ...     while sim.time < 10.0:
    ...         viewer.offer(sim.time, sim.state, sim.efforts.copy(), sim.energies)
    ...         sim.step(10)
    """

    def __init__(self, model: Model, sink: str, *, rate: float = 60.0, capacity: int = 20_000) -> None:
        """Open the sink: 'spawn', 'serve', 'connect', 'connect:<url>', or a path ending in '.rrd'.

        :raises ViewerError: there is no such sink, it cannot be opened, or Rerun is not installed.
        :raises ValueError: the rate or capacity is not positive.
        """
        checked_sink(sink)
        if not 0.0 < rate < float("inf"):
            raise ValueError(f"the rate must be a positive number of samples a second, not {rate!r}")
        self._rate, self._frame = rate, -1
        self._samples: Mailbox[Sample] = Mailbox(capacity)
        self._events: Mailbox[Event] = Mailbox(capacity)
        self._open(model, sink)
        self.failure: ViewerError | None = None
        self._wake, self._closing, self._ended = threading.Event(), False, False
        self._waiting: list[threading.Event] = []
        self._thread = threading.Thread(target=self._run, name="rerun viewer", daemon=True)
        self._thread.start()
        atexit.register(self.close)

    def _open(self, model: Model, sink: str) -> None:
        try:
            import rerun as rr
        except ImportError as error:
            raise ViewerError("Rerun is not installed. Install it with: pip install rerun-sdk") from error
        from mbd_sim.viewer.blueprint import make_blueprint
        from mbd_sim.viewer.columns import Columns
        from mbd_sim.viewer.extent import extent_of
        from mbd_sim.viewer.scene import log_scene

        extent = extent_of(model)
        self._recording = rr.RecordingStream(APPLICATION, batcher_config=rr.ChunkBatcherConfig.LOW_LATENCY())
        blueprint = make_blueprint(model.mechanism, extent, live=is_live(sink))
        self._outlet = Outlet(self._recording, sink, blueprint)
        self.address = self._outlet.address
        try:
            self._recording.send_recording_name(model.mechanism.name)
            log_scene(self._recording, model.mechanism, extent)
            self._columns = Columns(self._recording, model)
        except BaseException:
            self._outlet.close()
            raise

    @property
    def dropped(self) -> int:
        """The number of samples that were pushed out before they were sent."""
        return self._samples.dropped

    def offer(
        self, time: float, y: Array, efforts: Array, energies: Energies, motion_time: float | None = None
    ) -> None:
        """Show a state y and its efforts and energies; both arrays are kept, so hand over copies.

        `motion_time` is the mechanism's own time in s, where it is not that of the timeline.
        Returns at once. Samples closer together than the rate asks for are passed over.
        """
        frame = int(time * self._rate + 1e-6)
        if frame != self._frame:
            self._frame = frame
            self._samples.put((time, y, efforts, energies, time if motion_time is None else motion_time))

    def event(self, time: float, text: str) -> None:
        """Write a line to the log."""
        self._events.put((time, text))

    def flush(self, timeout: float = 60.0) -> None:
        """Wait until what was offered so far is sent: for whoever offers faster than it can be sent.

        :raises ViewerError: it was not sent in `timeout` s, or the recording ended early.
        """
        sent = threading.Event()
        self._waiting.append(sent)
        self._wake.set()
        if not self._ended and not sent.wait(timeout):
            raise ViewerError(f"the viewer at {self.address} did not take the data within {timeout:g} s")
        if self.failure is not None:
            raise self.failure

    def close(self) -> None:
        """Send what waits and end the recording; a window stays open, a server stops. May be called again."""
        if self._closing:
            return
        self._closing = True
        self._wake.set()
        atexit.unregister(self.close)
        self._thread.join(CLOSE_TIMEOUT)
        if self._thread.is_alive():
            import rerun as rr

            rr.unregister_shutdown()  # Rerun would wait for the viewer without end when the interpreter exits
            self._fail(TimeoutError(f"it did not answer within {CLOSE_TIMEOUT:g} s"))
        self._outlet.close()

    def __enter__(self) -> Viewer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _run(self) -> None:
        try:
            flushed = time.monotonic()
            closing = False
            while not closing:
                self._wake.wait(PERIOD)
                self._wake.clear()
                closing, waiting = self._closing, self._waiting[:]
                while samples := self._samples.take(BATCH):
                    self._columns.send(samples)
                while events := self._events.take(BATCH):
                    self._columns.send_events(events)
                if closing or time.monotonic() - flushed > FLUSH_PERIOD:
                    self._recording.flush(timeout_sec=FLUSH_TIMEOUT)  # tells when the viewer is gone
                    flushed = time.monotonic()
                self._release(waiting)
        except Exception as error:  # whatever becomes of the viewer, the simulation goes on
            self._fail(error)
        self._ended = True
        self._release(self._waiting[:])
        self._recording.disconnect()

    def _release(self, waiting: list[threading.Event]) -> None:
        for sent in waiting:
            self._waiting.remove(sent)
            sent.set()

    def _fail(self, error: Exception) -> None:
        self.failure = ViewerError(f"the viewer at {self.address} takes no more data: {error}")
        _log.error("%s", self.failure)
