"""A run to MCAP files that any ROS 2 tool opens, written off the simulation's thread."""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path

from mbd_sim.recording.durable_file import Stream
from mbd_sim.recording.file_names import (
    RecordingError,
    Series,
    new_file,
    new_series,
)
from mbd_sim.recording.mcap_writer import McapFile, NoRoomError, Writable
from mbd_sim.recording.recorded_topic import Topic
from mbd_sim.recording.rosbag2_metadata import Contents, bag_metadata, write_metadata

__all__ = ["Recorder", "RecordingError", "Series", "Topic", "new_file", "new_series"]

WAITING = 16e6  # bytes that may wait for a slow disk before messages of display topics are dropped, and
WAITING_VITAL = 128e6  # bytes after which the recording ends, where the disk is too slow even for vital ones
OVERHEAD = 300  # bytes of memory that a waiting message takes besides its payload
CHUNK_PERIOD = 0.2  # s of real time after which a chunk is written, however little it holds: what a kill costs at most
SYNC_PERIOD = 0.25  # s between requests that the disk take what has been written: what a power failure costs besides

_Message = tuple[int, bytes, int, int]


class Recorder:
    """Writes messages in a thread of its own; `put` never waits for the disk.

    Each file begins with the mechanism's file and metadata, given by `begin`, so that each can be computed again
    alone. Messages carry the simulation's clock as log time and the tick (steps since the node started) as sequence.

    Memory is bounded: on a slow disk messages of topics that are not vital are dropped and counted. Where even the
    vital ones come faster than they can be written, the recording ends: no file lacks one in its middle.
    """

    def __init__(
        self,
        series: Series,
        topics: Mapping[str, Topic],
        mechanism_text: str,
        *,
        open_stream: Callable[[Path], Writable] = Stream,
    ) -> None:
        """Open the first file; what is put before `begin` is lost.

        :raises RecordingError: the file cannot be opened.
        """
        self.series = series
        self.written = self.split_count = 0
        self.failure = ""
        self.finished = threading.Event()  # whoever opens the last file finds it whole,
        self.ended = threading.Event()  # and it is on the disk
        self._topics = list(topics.values())
        self._number = {key: number for number, key in enumerate(topics)}
        self._text, self._open = mechanism_text, open_stream
        self._begun = self._closing = False
        self._dropped = self._unwritten = 0  # by `put`, and by the thread
        self._put_bytes = self._taken_bytes = 0
        self._queue: queue.SimpleQueue[_Message | dict[str, str] | None] = queue.SimpleQueue()
        try:
            self._file = McapFile(series.file(0), self._topics, open_stream)
        except OSError as error:
            raise RecordingError(f"cannot record to '{series.place}': {error.strerror}.") from error
        self._files: list[Contents] = []
        for target, name in ((self._run, "recorder"), (self._sync, "recorder_sync")):
            threading.Thread(target=target, name=name, daemon=True).start()

    @property
    def path(self) -> Path:
        """The file that is being written."""
        return self._file.path

    @property
    def place(self) -> Path:
        """What a user opens: this file, or rosbag2's folder."""
        return self.series.place if self.series.rosbag2 else self.path

    @property
    def size(self) -> int:
        """Bytes of it so far."""
        return self._file.size

    @property
    def waiting(self) -> int:
        """Bytes of memory that messages take which wait for the disk."""
        return self._put_bytes - self._taken_bytes

    @property
    def dropped(self) -> int:
        """Messages that were put and are in no file."""
        return self._dropped + self._unwritten

    def begin(self, metadata: Mapping[str, str]) -> None:
        """What is put from now on belongs to the next file, or to the first; `metadata` says what it starts from."""
        if not self._closing:
            self._begun = True
            self._queue.put(dict(metadata))

    def put(self, key: str, payload: bytes, time_ns: int, sequence: int) -> None:
        """Queue one serialized message of the topic that was given under `key`. For one thread at a time."""
        number = self._number[key]
        waiting = self._put_bytes - self._taken_bytes
        if self._closing or not self._begun or (waiting > WAITING and not self._topics[number].vital):
            self._dropped += 1
            return
        if waiting > WAITING_VITAL:
            self._dropped += 1
            self._end(f"recording to '{self.path}' ends at tick {sequence}: the disk is too slow even for commands")
            return
        self._put_bytes += len(payload) + OVERHEAD
        self._queue.put((number, payload, time_ns, sequence & 0xFFFFFFFF))

    def close(self, timeout: float | None = None) -> bool:
        """Write what waits, the summary and the index; returns whether that is done after `timeout` seconds at most."""
        self._end()
        return self.ended.wait(timeout)

    def _end(self, failure: str = "") -> None:
        self.failure = self.failure or failure
        if not self._closing:
            self._closing = True
            self._queue.put(None)

    def _sync(self) -> None:
        while not self.ended.wait(SYNC_PERIOD):
            self._file.sync()

    def _run(self) -> None:
        try:
            self._write_all()
        except NoRoomError as error:
            self._fail(f"ends: {error}", error, finish=True)
        except OSError as error:
            self._fail(f"stopped: {error.strerror}", error)
        except Exception as error:  # else a defect would end the recording in silence
            self._fail(f"stopped: {error!r}", error)
        finally:
            self._closing = True
            with contextlib.suppress(queue.Empty):
                while True:
                    self._unwritten += isinstance(self._queue.get_nowait(), tuple)
            self.finished.set()
            self.ended.set()

    def _fail(self, what: str, error: Exception, *, finish: bool = False) -> None:
        path = error.filename if isinstance(error, OSError) and error.filename else self.path
        self.failure = self.failure or f"recording to '{path}' {what}"
        self._closing = True
        with contextlib.suppress(OSError):
            if finish:
                self._finish()
                return
        lost = self._file.give_up()
        self.written -= lost
        self._unwritten += lost
        with contextlib.suppress(OSError):
            self._describe()

    def _write_all(self) -> None:
        due: float | None = None  # when the chunk is to be written, by the steady clock
        while True:
            try:
                item = self._queue.get(timeout=None if due is None else max(due - time.monotonic(), 0.0))
            except queue.Empty:
                self._file.flush()
                due = None
                continue
            if item is None:
                self._finish()
                return
            if isinstance(item, dict):
                self._next(item)
                due = None
                continue
            number, payload, time_ns, sequence = item
            self.written += 1
            self._file.add(number, payload, time_ns, sequence)
            self._taken_bytes += len(payload) + OVERHEAD
            if due is None:
                due = time.monotonic() + CHUNK_PERIOD
            elif time.monotonic() > due:
                self._file.flush()
                due = None

    def _next(self, metadata: dict[str, str]) -> None:
        if self._files:
            self._file.finish()
            self._file.close()
            self._file = McapFile(self.series.file(len(self._files)), self._topics, self._open)
            self.split_count += 1
        self._files.append(self._file.contents)
        self._file.begin(self._text, metadata)
        self._describe()

    def _finish(self) -> None:
        if not self._files:  # never begun
            self._files.append(self._file.contents)
            self._file.begin(self._text, {})
        self._file.finish()
        self._describe()
        self.finished.set()
        self._file.close()

    def _describe(self) -> None:
        """Bring rosbag2's description of the files up to date, where there is one."""
        if self.series.metadata is not None:
            write_metadata(self.series.metadata, bag_metadata(self._topics, self._files, {"recorded_by": "mbd_sim"}))
