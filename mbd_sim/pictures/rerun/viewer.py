"""Shows a motion in Rerun from a separate process, so that the simulation never waits for it.

The samples pass through a bounded queue with one writer and one reader that never blocks the writer. The events worth a
line in the log are selected: of commands, which may come a thousand times a second, only the first.
"""

from __future__ import annotations

import atexit
import contextlib
import json
import logging
import math
import os
import pickle
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Sequence
from types import TracebackType
from typing import TYPE_CHECKING, Generic, TypeVar

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.packages import MissingPackageError, require_packages
from mbd_sim.base.short_repr import short_repr
from mbd_sim.pictures.rerun import worker
from mbd_sim.pictures.rerun.scene import TRACE_TIME, DisplayOptions, RowMaker, describe_scene
from mbd_sim.pictures.rerun.sinks import ViewerError, checked_sink, is_live
from mbd_sim.simulation.run.events import RESTARTS, Event, EventKind, parse_event

if TYPE_CHECKING:
    from mbd_sim.simulation.kernel.sensors import SensorReading
    from mbd_sim.simulation.model.model import Model
    from mbd_sim.simulation.model.state_records import Energies


Item = TypeVar("Item")


class Mailbox(Generic[Item]):
    """Keeps the newest `capacity` items; `dropped` counts those that were discarded before they were read.

    Items are numbered as they arrive, so that the reader finds lost ones by the gaps and no lock is needed: appending
    to a deque and removing from it are atomic.
    """

    def __init__(self, capacity: int) -> None:
        if capacity < 1:
            raise ValueError(f"the capacity must be at least 1, not {capacity}")
        self.dropped = 0
        self._items: deque[tuple[int, Item]] = deque(maxlen=capacity)
        self._written = 0
        self._expected = 0

    def __len__(self) -> int:
        return len(self._items)

    def put(self, item: Item) -> None:
        """Add an item; the oldest one is discarded when there is no room."""
        self._items.append((self._written, item))
        self._written += 1

    def take(self, limit: int) -> list[Item]:
        """Remove and return at most `limit` items, oldest first."""
        taken: list[Item] = []
        while len(taken) < limit:
            try:
                number, item = self._items.popleft()
            except IndexError:
                break
            self.dropped += number - self._expected
            self._expected = number + 1
            taken.append(item)
        return taken


class EventFilter:
    """Follows the events of a run in their order."""

    def __init__(self) -> None:
        self._commanded = False

    def accepts(self, kind: EventKind) -> bool:
        """Whether to show the next event: every one, except a command after another command."""
        repeated = kind is EventKind.COMMAND and self._commanded
        if kind is EventKind.COMMAND:
            self._commanded = True
        elif kind in (EventKind.EXPIRED, *RESTARTS):
            self._commanded = False
        return not repeated


PERIOD = 0.05  # s between two batches
BATCH = 500  # samples
FLUSH_PERIOD = 1.0  # s
QUATERNION = 4  # numbers
OPEN_TIMEOUT, CLOSE_TIMEOUT = 60.0, 20.0  # s

_log = logging.getLogger(__name__)


class Viewer:
    """A recording in Rerun that accepts samples of a motion.

    `rate` is the number of samples kept for each second of simulated time (None: all of them), `capacity` the number
    that may wait. When the viewer is slower than the simulation, the oldest waiting samples are discarded and counted
    in `dropped`. `address` is where to view the recording, `failure` the error that ended it early. Times are simulated
    time in s and should not decrease, because the timeline shows one sample for each time. Offer the start too: before
    the first sample all parts lie at the origin.

    >>> with Viewer(sim.model, "run.rrd") as viewer:
    ...     while sim.time < 10.0:
    ...         viewer.offer(sim.time, sim.state, sim.inputs.copy(), sim.energies)
    ...         sim.step(10)
    """

    __repr__ = short_repr
    keeps_time = False  # whether it shows only what comes in real time, because it keeps nothing
    program = "Rerun"
    _package = "rerun"
    _worker_module = "mbd_sim.pictures.rerun.worker"  # the module whose `main` is the viewer's process

    def __init__(
        self,
        model: Model,
        sink: str,
        *,
        rate: float | None = 60.0,
        capacity: int = 20_000,
        traces: Sequence[str] | None = None,
        trace_time: float = TRACE_TIME,
        reactions: bool = False,
    ) -> None:
        """Open the sink: 'spawn', 'serve', 'connect', 'connect:<url>', or a path ending in '.rrd'.

        :param traces: points that leave a trace for `trace_time` s, as `part` or `part.point`; None: ends of chains.
        :param reactions: show the forces through the joints; computing them takes 0.1 ms or more for each sample.
        :raises ViewerError: there is no such sink, it cannot be opened, or Rerun is not installed.
        :raises ValueError: the rate or capacity is not positive, or there is no such part or point to trace.
        """
        self._check(sink)
        for name, value in (("rate", rate), ("trace_time", trace_time)):
            if value is not None and not 0.0 < value < float("inf"):
                raise ValueError(f"the {name} must be a positive number, not {value!r}")
        try:
            require_packages(self._package, purpose="The viewer")
        except MissingPackageError as error:
            raise ViewerError(str(error)) from error
        self._rate, self._frame, self._motion_time, self._event_filter = rate, -1, -math.inf, EventFilter()
        self._samples: Mailbox[Array] = Mailbox(capacity)
        self._events: Mailbox[tuple[float, EventKind, str]] = Mailbox(capacity)
        self._measurements: Mailbox[tuple[float, str, str, list[float]]] = Mailbox(capacity)
        self._writer, measures = RowMaker(model, reactions), bool(model.mechanism.sensors)
        options = DisplayOptions(None if traces is None else tuple(traces), trace_time, reactions, measures)
        self.failure: ViewerError | None = None
        self._reported_by_worker = False
        self._waiting: dict[int, threading.Event] = {}
        self._flushes, self._wake, self._closing = 0, threading.Event(), False
        self._live = is_live(sink)
        self.watched = threading.Event()  # somebody looks at a server
        self._worker = _start_worker(self._worker_module)
        try:
            scene = describe_scene(model, self._writer.layout, options)
            self.address = self._open_worker(pickle.dumps((scene, sink)), sink)
        except BaseException:
            self._worker.kill()
            self._worker.communicate()
            raise
        self._threads = [
            threading.Thread(target=self._feed, name="viewer", daemon=True),
            threading.Thread(target=self._listen, name="viewer answers", daemon=True),
        ]
        for thread in self._threads:
            thread.start()
        atexit.register(self.close)

    def _check(self, sink: str) -> None:
        """Refuse an impossible sink."""
        checked_sink(sink)

    def _open_worker(self, scene: bytes, sink: str) -> str:
        """Send the scene description to the worker; returns the address."""
        assert self._worker.stdin is not None and self._worker.stdout is not None
        timer = threading.Timer(OPEN_TIMEOUT, self._worker.kill)
        timer.start()
        line = b""
        with contextlib.suppress(OSError):
            self._worker.stdin.write(worker.pack(worker.SCENE, scene))
            self._worker.stdin.flush()
            line = self._worker.stdout.readline()
        timer.cancel()
        answer = json.loads(line) if line else {"failed": f"the viewer sink '{sink}' cannot be opened: no answer"}
        if "address" not in answer:
            raise ViewerError(str(answer["failed"]))
        return str(answer["address"])

    @property
    def dropped(self) -> int:
        """The number of samples and measurements that were discarded before they were sent."""
        return self._samples.dropped + self._measurements.dropped

    def offer(self, time: float, y: Array, inputs: Array, energies: Energies, motion_time: float | None = None) -> None:
        """Show a state y with its inputs (see `Simulation.inputs`; the efforts are enough) and energies.

        :param motion_time: the mechanism's own time in s, where it differs from that of the timeline.

        Returns at once. Samples closer together than the rate allows are skipped, except the first after a reset.
        """
        frame = self._frame + 1 if self._rate is None else int(time * self._rate + 1e-6)
        motion_time = time if motion_time is None else motion_time
        if (frame != self._frame or motion_time < self._motion_time) and self.failure is None:
            self._frame, self._motion_time = frame, motion_time
            self._samples.put(self._writer.row(time, motion_time, y, inputs, energies))

    def measure(self, time: float, sensor: str, reading: SensorReading) -> None:
        """Show a measurement of a sensor at the time in s at which it arrives; returns at once."""
        if self.failure is None:
            for quantity, values in reading.values.items():
                numbers = values.tolist()
                ordered = [*numbers[1:], numbers[0]] if len(numbers) == QUATERNION else numbers  # as in messages
                self._measurements.put((time, sensor, quantity, ordered))

    def event(self, time: float, event: Event | str) -> None:
        """Add an event to the log at a time in s; of consecutive commands only the first is shown."""
        if isinstance(event, str):
            event = parse_event(event)
        if self._event_filter.accepts(event.kind):
            self._events.put((time, event.kind, event.text))

    def flush(self, timeout: float = 60.0) -> None:
        """Wait until everything offered so far is sent, for callers that offer faster than it can be sent.

        :raises ViewerError: it was not sent within `timeout` s, or the recording ended early.
        """
        sent = threading.Event()
        self._flushes += 1
        self._waiting[self._flushes] = sent
        self._wake.set()
        if self.failure is None and not sent.wait(timeout):
            raise ViewerError(f"the viewer at {self.address} did not accept the data within {timeout:g} s")
        if self.failure is not None:
            raise self.failure

    def close(self) -> None:
        """Send the waiting samples and end the recording; a window stays open, a server stops. May be called again."""
        if self._closing:
            return
        self._closing = True
        self._wake.set()
        atexit.unregister(self.close)
        deadline = time.monotonic() + CLOSE_TIMEOUT
        self._threads[0].join(CLOSE_TIMEOUT)
        try:
            self._worker.wait(max(deadline - time.monotonic(), 0.1))
        except subprocess.TimeoutExpired:
            self._fail(f"it did not answer within {CLOSE_TIMEOUT:g} s")
            self._worker.kill()
            self._worker.wait()
        self._threads[1].join(1.0)
        for stream in (self._worker.stdin, self._worker.stdout):
            with contextlib.suppress(OSError):
                if stream is not None:
                    stream.close()

    def __enter__(self) -> Viewer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _feed(self) -> None:
        """Write batches to the worker until the viewer is closed."""
        pipe = self._worker.stdin
        assert pipe is not None
        try:
            flushed = time.monotonic()
            closing = False
            while not closing:
                self._wake.wait(PERIOD)
                self._wake.clear()
                closing, requested = self._closing, self._flushes
                while rows := self._samples.take(BATCH):
                    pipe.write(worker.pack(worker.ROWS, b"".join(row.data for row in rows)))
                while measurements := self._measurements.take(BATCH):
                    pipe.write(worker.pack(worker.MEASUREMENTS, json.dumps(measurements).encode()))
                while events := self._events.take(BATCH):
                    pipe.write(worker.pack(worker.EVENTS, json.dumps(events).encode()))
                if self._waiting or (self._live and time.monotonic() - flushed > FLUSH_PERIOD):
                    pipe.write(worker.pack(worker.FLUSH, requested.to_bytes(8, "little")))
                    flushed = time.monotonic()
                pipe.flush()
            pipe.close()
        except OSError as error:  # a failure of the viewer must not stop the simulation
            self._fail(str(error))
        except ValueError:
            self._fail("it was closed")

    def _listen(self) -> None:
        """Read the worker's answers until it ends."""
        assert self._worker.stdout is not None
        with contextlib.suppress(OSError, ValueError):
            for line in self._worker.stdout:
                answer = json.loads(line)
                if "failed" in answer:
                    self._fail(answer["failed"], by_worker=True)
                if "watched" in answer:
                    self.watched.set()
                self._release(int(answer.get("flushed", 0)))
        if not self._closing:
            self._fail(f"its process ended ({self._worker.wait()})")
        self._release(self._flushes)

    def _release(self, number: int) -> None:
        for key in [key for key in self._waiting if key <= number]:
            self._waiting.pop(key).set()

    def _fail(self, reason: str, *, by_worker: bool = False) -> None:
        if self.failure is None or (by_worker and not self._reported_by_worker):
            self._reported_by_worker = by_worker
            self.failure = ViewerError(f"the viewer at {self.address} no longer accepts data: {reason}")
            _log.error("%s", self.failure)
        self._release(self._flushes)


def _start_worker(module: str) -> subprocess.Popen[bytes]:
    """Start the worker in its own session: Ctrl-C in the terminal reaches the node, which then ends the worker."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    command = [
        sys.executable,
        "-P",
        "-c",
        f"import sys; from {module} import main; sys.exit(main())",
    ]
    return subprocess.Popen(  # noqa: S603  (own arguments)
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment, start_new_session=True
    )
