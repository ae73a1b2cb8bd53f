"""The recordings of a node: begun, ended and split between two steps, so that each file can be computed again alone."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from queue import Empty, SimpleQueue

from mbd_sim.recording.recorder import Recorder
from mbd_sim.recording.recording_paths import RecordingError
from mbd_sim.recording.run_metadata import Moment

ANSWER = 0.2  # s that a service call waits for the disk; commands wait that long as well


@dataclass(frozen=True)
class Limits:
    """Where a file ends and the next one begins: bytes, and s of simulated time; 0: never."""

    size: float = 0.0
    duration: float = 0.0


class Recordings:
    """At most one recording at a time, fed by the thread of the outputs; `start`, `stop` and `split` by any other.

    What is to be done is done when the next `Moment` comes along between the messages, after those before it and
    before those after it.
    """

    def __init__(
        self,
        open_recorder: Callable[[], Recorder],
        metadata: Callable[[Moment], Mapping[str, str]],
        mark: Callable[[], None],
        complain: Callable[[str], None],
        limits: Limits,
    ) -> None:
        """How to open a recorder and describe a moment, how to ask for one, and who hears of a recording that ends."""
        self.limits = limits
        self._open_recorder, self._metadata, self._mark, self._complain = open_recorder, metadata, mark, complain
        self._pending: SimpleQueue[tuple[Callable[[Moment], None], threading.Event]] = SimpleQueue()
        self._latched: dict[str, bytes] = {}
        self._asked: Recorder | None = None  # by the services
        self._fed: Recorder | None = None  # by the outputs
        self._began = 0
        self._splitting = self._closed = False
        self._lock = threading.Lock()
        self.recorder: Recorder | None = None  # the last one, for its counters

    def start(self, moment: Moment | None = None) -> tuple[bool, str]:
        """Begin a recording at a known moment, or at the next one; whether that works, and its path or why not."""
        with self._lock:
            if self._closed:
                return False, "the node is ending"
            if self._active() is not None:
                return False, f"already recording to {self._asked_path()}"
            try:
                recorder = self._open_recorder()
            except RecordingError as error:
                return False, str(error)
            self._asked = self.recorder = recorder
            if moment is not None:
                self._begin(recorder, moment)
            else:
                self._ask(lambda moment: self._begin(recorder, moment))
            return True, str(recorder.location)

    def stop(self) -> tuple[bool, str]:
        """End the recording; whether there was one, and its path."""
        with self._lock:
            recorder = self._active()
            if recorder is None:
                return False, "not recording"
            self._asked = None
            self._ask(lambda _: self._end(recorder)).wait(ANSWER)
            finished = recorder.finished.wait(ANSWER)
            return (
                True,
                f"{recorder.location}" if finished else f"{recorder.location} is being finished: the disk is slow",
            )

    def split(self) -> tuple[bool, str]:
        """Go on in another file; whether that works, and the path of the one that ends."""
        with self._lock:
            recorder = self._active()
            if recorder is None:
                return False, "not recording"
            path = recorder.path
            self._ask(self._split).wait(ANSWER)
            return True, str(path)

    def close(self) -> None:
        """Finish the recording, however long the disk takes. Once nothing is fed any more."""
        with self._lock:
            self._closed = True
        for recorder in (self._asked, self.recorder):
            if recorder is not None:
                recorder.close()

    def summary(self) -> str:
        """What became of the last recording, or ""."""
        recorder = self.recorder
        if recorder is None:
            return ""
        lost = f", {recorder.dropped} dropped" if recorder.dropped else ""
        return f"recorded {recorder.written} messages{lost} to {recorder.paths.location}"

    def at(self, moment: Moment) -> None:
        """Do what waits for this moment."""
        try:
            action, done = self._pending.get_nowait()
        except Empty:
            return
        try:
            action(moment)
        finally:
            done.set()

    def put(self, key: str, payload: bytes, time_ns: int, ticks: int, *, latched: bool = False) -> None:
        """Record a message of a topic; each file begins with the last one of a topic that is `latched`."""
        if latched:
            self._latched[key] = payload
        recorder = self._fed
        if recorder is None:
            return
        recorder.put(key, payload, time_ns, ticks)
        if recorder.failure:
            self._fed = None
            self._complain(recorder.failure)

    def look(self, time_ns: int) -> None:
        """Split where the file has become too large or too long."""
        recorder = self._fed
        if recorder is None or self._splitting:
            return
        size, duration = self.limits.size, self.limits.duration
        if (size and recorder.size >= size) or (duration and time_ns - self._began >= duration * 1e9):
            self._splitting = True
            self._ask(self._split)

    def _active(self) -> Recorder | None:
        if self._asked is not None and self._asked.failure:
            self._asked = None
        return self._asked

    def _asked_path(self) -> str:
        return str(self._asked.location) if self._asked is not None else ""

    def _ask(self, action: Callable[[Moment], None]) -> threading.Event:
        done = threading.Event()
        self._pending.put((action, done))
        self._mark()
        return done

    def _begin(self, recorder: Recorder, moment: Moment) -> None:
        self._fed, self._began = recorder, moment.clock_ns
        recorder.begin(self._metadata(moment))
        for key, payload in self._latched.items():
            recorder.put(key, payload, moment.clock_ns, moment.ticks)

    def _split(self, moment: Moment) -> None:
        self._splitting = False
        if self._fed is not None:
            self._begin(self._fed, moment)

    def _end(self, recorder: Recorder) -> None:
        if self._fed is recorder:
            self._fed = None
        recorder.close(timeout=0.0)
