"""The recordings of a node: started, stopped and split between two steps, so that each file can be recomputed alone."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from mbd_sim.base.errors import counted
from mbd_sim.recordings.messages.states import Snapshot
from mbd_sim.recordings.run.paths import RecordingError
from mbd_sim.recordings.run.recorder import SHORTEST_FILE, Recorder
from mbd_sim.ros.stepping.thread import RequestQueue

DISK_TIMEOUT = 0.2  # s that a service call waits for the disk; commands wait as long
CLOSE_TIMEOUT = 1.8  # s that the end of the node waits for the disk
MAX_WAITING_FILES = 5  # files that may wait for the disk before the duration of the present one is exceeded
LONG_FILES = (
    "files of the recording exceed record_split_size or record_split_duration: a file is split by size "
    f"at most every {SHORTEST_FILE:g} s, and at most {MAX_WAITING_FILES} files wait for the disk"
)


@dataclass(frozen=True)
class SplitLimits:
    """The limits at which a recording continues in another file: bytes, and s of simulated time; 0: none."""

    size: float = 0.0
    duration: float = 0.0


class NodeRecordings:
    """At most one recording at a time, fed by the publishing thread; any other thread starts, stops and splits it.

    A request takes effect when the publishing thread takes the next state for it from its queue: after the messages
    before it, and before the messages after it.
    """

    def __init__(
        self,
        open_recorder: Callable[[], Recorder],
        metadata: Callable[[Snapshot], Mapping[str, str]],
        request_moment: Callable[[], None],
        on_failure: Callable[[str], None],
        limits: SplitLimits,
        on_long_files: Callable[[str], None] = lambda explanation: None,
    ) -> None:
        """Create the object, without a recording.

        :param open_recorder: opens a recorder for a new recording.
        :param metadata: the metadata of a file that begins at a moment.
        :param request_moment: requests a state for it from the stepping thread.
        :param on_failure: is called with the reason when a recording has ended by a failure.
        :param on_long_files: is called once in a recording, with an explanation, when a limit is exceeded because the
            recording cannot be split that often.
        """
        self.limits = limits
        self._open_recorder, self._metadata, self._on_failure = open_recorder, metadata, on_failure
        self._on_long_files = on_long_files
        self._requests: RequestQueue[[Snapshot]] = RequestQueue(request_moment)
        self._each_file: dict[str, bytes] = {}  # the last message of each topic that begins every file
        self._requested: Recorder | None = None  # the recorder as the services see it
        self._current: Recorder | None = None  # the recorder that the publishing thread feeds
        self._file_start_ns = 0
        self._splitting = self._closed = self._long_files = False
        self._lock = threading.Lock()
        self._stopped: Recorder | None = None  # the last one that `stop` has finished
        self.recorder: Recorder | None = None  # the last one, for its counters

    def start(self, moment: Snapshot | None = None) -> tuple[bool, str]:
        """Start a recording at a known moment, or at the next one; returns success, and its path or the reason."""
        with self._lock:
            if self._closed:
                return False, "the node is shutting down"
            active = self._active()
            if active is not None:
                return False, f"already recording to {active.location}"
            try:
                recorder = self._open_recorder()
            except RecordingError as error:
                return False, str(error)
            if self.recorder is not None:
                self.recorder.close(timeout=0.0)  # one that has failed may repair its file now
            self._requested = self.recorder = recorder
            self._long_files = False
            if moment is not None:
                self._begin_file(recorder, moment)
            else:
                self._requests.submit(lambda moment: self._begin_file(recorder, moment))
            return True, str(recorder.location)

    def stop(self) -> tuple[bool, str]:
        """Stop the recording; returns whether there was one, and its path."""
        with self._lock:
            recorder = self._active()
            if recorder is None:
                return False, "not recording"
            self._requested = None
            self._requests.submit(lambda _: self._end(recorder)).wait(DISK_TIMEOUT)
            finished = recorder.finished.wait(DISK_TIMEOUT)
            self._stopped = recorder if finished else None
            return (
                True,
                f"{recorder.location}" if finished else f"{recorder.location} is still being written: the disk is slow",
            )

    def split(self) -> tuple[bool, str]:
        """Continue in another file; returns whether there is a recording, and the path of the file that ends."""
        with self._lock:
            recorder = self._active()
            if recorder is None:
                return False, "not recording"
            path = recorder.path
            self._requests.submit(self._split).wait(DISK_TIMEOUT)
            return True, str(path)

    def close(self) -> None:
        """Finish the recording when nothing is put any more, as far as the disk permits in `CLOSE_TIMEOUT`."""
        self._closed = True  # without the lock: a service may hold it, and wait for a disk that does not answer
        if self.recorder is not None:
            self.recorder.close(CLOSE_TIMEOUT)

    @property
    def location(self) -> str:
        """Where the present recording is; "" without one."""
        recorder = self._active()
        return str(recorder.location) if recorder is not None else ""

    def summary(self) -> str:
        """Sentences on the last recording, or ""."""
        recorder = self.recorder
        if recorder is None:
            return ""
        dropped = f" ({recorder.dropped} dropped)" if recorder.dropped else ""
        text = f"recorded {counted(recorder.saved, 'message')}{dropped} to {recorder.paths.location}"
        return f"{text}; {recorder.state_on_disk}" if recorder.state_on_disk else text

    def closing_summary(self) -> str:
        """`summary` for the end of the node: "" if `stop` has finished the last recording long before."""
        return "" if self.recorder is self._stopped else self.summary()

    def request(self, action: Callable[[Snapshot], None]) -> None:
        """Have the publishing thread call a function with the next state for a recording; from any thread."""
        self._requests.submit(action)

    def at_moment(self, moment: Snapshot) -> None:
        """Serve the request that asked for this moment; for the publishing thread."""
        self._requests.serve_next(moment)

    def put(self, name: str, payload: bytes, time_ns: int, ticks: int, *, in_each_file: bool = False) -> None:
        """Record a message of a topic; with `in_each_file`, further files begin with the topic's last message."""
        if in_each_file:
            self._each_file[name] = payload
        recorder = self._current
        if recorder is None:
            return
        recorder.put(name, payload, time_ns, ticks)
        if recorder.failure:
            self._current = None
            self._on_failure(recorder.failure)

    def check_limits(self, time_ns: int) -> None:
        """Split the recording if its file has become too large or too long."""
        recorder = self._current
        if recorder is None or self._splitting:
            return
        size, duration = self.limits.size, self.limits.duration
        too_large = bool(size) and recorder.size >= size
        too_long = bool(duration) and time_ns - self._file_start_ns >= duration * 1e9
        if (too_large and recorder.has_known_size) or (too_long and recorder.waiting_files < MAX_WAITING_FILES):
            self._splitting = True
            self._requests.submit(self._split)
        elif (too_large or too_long) and not self._long_files and not recorder.failure:
            self._long_files = True
            self._on_long_files(LONG_FILES)

    def _active(self) -> Recorder | None:
        if self._requested is not None and self._requested.failure:
            self._requested = None
        return self._requested

    def _begin_file(self, recorder: Recorder, moment: Snapshot) -> None:
        self._current, self._file_start_ns = recorder, moment.clock_ns
        recorder.begin(self._metadata(moment))
        for name, payload in self._each_file.items():
            recorder.put(name, payload, moment.clock_ns, moment.ticks)

    def _split(self, moment: Snapshot) -> None:
        self._splitting = False
        if self._current is not None:
            self._begin_file(self._current, moment)

    def _end(self, recorder: Recorder) -> None:
        if self._current is recorder:
            self._current = None
        recorder.close(timeout=0.0)
