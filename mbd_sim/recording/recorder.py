"""Records a run to MCAP files that any ROS 2 tool opens, without delaying the thread that steps the simulation."""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path

from mbd_sim.messages.recorded_topic import Topic
from mbd_sim.recording.durable_file import DurableFile
from mbd_sim.recording.mcap_writer import DiskNearlyFullError, McapWriter, OutputFile
from mbd_sim.recording.recording_paths import RecordingError, RecordingPaths
from mbd_sim.recording.rosbag2_metadata import FileStatistics, bag_metadata, write_metadata

QUEUE_LIMIT = 16e6  # bytes that may wait for a slow disk before messages of display topics are dropped, and
VITAL_QUEUE_LIMIT = 128e6  # bytes after which the recording ends, if the disk is too slow even for vital messages
MESSAGE_OVERHEAD = 300  # bytes of memory that a queued message takes besides its payload
CHUNK_PERIOD = 0.2  # s of real time after which a chunk is written however small it is: the most that a kill can cost
SYNC_PERIOD = 0.25  # s between requests to write data to the disk: the additional loss at a power failure

_QueuedMessage = tuple[int, bytes, int, int]  # number of the topic, payload, log time in ns, sequence number


class Recorder:
    """Writes messages in its own thread; `put` never waits for the disk.

    Each file begins with the mechanism's file and the metadata given to `begin`, so that each can be recomputed on its
    own. The log time of a message is the simulated clock, its sequence number the tick (steps since the node started).

    Memory is bounded: on a slow disk messages of topics that are not vital are dropped and counted. If even the vital
    ones arrive faster than they can be written, the recording ends: no file has a gap among its commands.
    """

    def __init__(
        self,
        paths: RecordingPaths,
        topics: Mapping[str, Topic],
        mechanism_text: str,
        *,
        open_file: Callable[[Path], OutputFile] = DurableFile,
    ) -> None:
        """Open the first file; messages put before `begin` are lost.

        :raises RecordingError: the file cannot be opened.
        """
        self.paths = paths
        self.written = self.split_count = 0
        self.failure = ""
        self.finished = threading.Event()  # set when the last file is complete for a reader,
        self.ended = threading.Event()  # and when it is on the disk
        self._topics = list(topics.values())
        self._numbers = {key: number for number, key in enumerate(topics)}
        self._mechanism_text, self._open_file = mechanism_text, open_file
        self._begun = self._closing = False
        self._dropped = self._unwritten = 0  # by `put`, and by the thread
        self._queued_bytes = self._dequeued_bytes = 0  # since the start
        self._queue: queue.SimpleQueue[_QueuedMessage | dict[str, str] | None] = queue.SimpleQueue()
        try:
            self._writer = McapWriter(paths.file(0), self._topics, open_file)
        except OSError as error:
            raise RecordingError(f"cannot record to '{paths.location}': {error.strerror}.") from error
        self._files: list[FileStatistics] = []
        for target, name in ((self._run, "recorder"), (self._sync, "recorder_sync")):
            threading.Thread(target=target, name=name, daemon=True).start()

    @property
    def path(self) -> Path:
        """The file that is being written."""
        return self._writer.path

    @property
    def location(self) -> Path:
        """The path for a user to open: the file that is being written, or rosbag2's folder."""
        return self.paths.location if self.paths.rosbag2 else self.path

    @property
    def size(self) -> int:
        """The size so far of the file that is being written, in bytes."""
        return self._writer.size

    @property
    def queued(self) -> int:
        """The memory in bytes of messages that wait for the disk."""
        return self._queued_bytes - self._dequeued_bytes

    @property
    def dropped(self) -> int:
        """The number of messages that were put and are in no file."""
        return self._dropped + self._unwritten

    def begin(self, metadata: Mapping[str, str]) -> None:
        """Begin the first or the next file with all messages put from now on; `metadata` describes its start."""
        if not self._closing:
            self._begun = True
            self._queue.put(dict(metadata))

    def put(self, key: str, payload: bytes, time_ns: int, sequence: int) -> None:
        """Queue a serialized message of the topic that was given under `key`. For one thread at a time."""
        number = self._numbers[key]
        queued = self._queued_bytes - self._dequeued_bytes
        if self._closing or not self._begun or (queued > QUEUE_LIMIT and not self._topics[number].vital):
            self._dropped += 1
            return
        if queued > VITAL_QUEUE_LIMIT:
            self._dropped += 1
            self._end(f"recording to '{self.path}' ends at tick {sequence}: the disk is too slow even for commands")
            return
        self._queued_bytes += len(payload) + MESSAGE_OVERHEAD
        self._queue.put((number, payload, time_ns, sequence & 0xFFFFFFFF))

    def close(self, timeout: float | None = None) -> bool:
        """Write queued messages, summary and index; return whether that was done within `timeout` seconds."""
        self._end()
        return self.ended.wait(timeout)

    def _end(self, failure: str = "") -> None:
        self.failure = self.failure or failure
        if not self._closing:
            self._closing = True
            self._queue.put(None)

    def _sync(self) -> None:
        while not self.ended.wait(SYNC_PERIOD):
            self._writer.sync()

    def _run(self) -> None:
        try:
            self._write_all()
        except DiskNearlyFullError as error:
            self._fail(f"ends: {error}", error, finish=True)
        except OSError as error:
            self._fail(f"stopped: {error.strerror}", error)
        except Exception as error:  # a defect must not end the recording silently
            self._fail(f"stopped: {error!r}", error)
        finally:
            self._closing = True
            with contextlib.suppress(queue.Empty):
                while True:
                    self._unwritten += isinstance(self._queue.get_nowait(), tuple)
            self.finished.set()
            self.ended.set()

    def _fail(self, reason: str, error: Exception, *, finish: bool = False) -> None:
        path = error.filename if isinstance(error, OSError) and error.filename else self.path
        self.failure = self.failure or f"recording to '{path}' {reason}"
        self._closing = True
        with contextlib.suppress(OSError):
            if finish:
                self._finish()
                return
        lost = self._writer.abandon()
        self.written -= lost
        self._unwritten += lost
        with contextlib.suppress(OSError):
            self._write_bag_metadata()

    def _write_all(self) -> None:
        deadline: float | None = None  # on the monotonic clock, at which the chunk is to be written
        while True:
            try:
                item = self._queue.get(timeout=None if deadline is None else max(deadline - time.monotonic(), 0.0))
            except queue.Empty:
                self._writer.flush()
                deadline = None
                continue
            if item is None:
                self._finish()
                return
            if isinstance(item, dict):
                self._begin_file(item)
                deadline = None
                continue
            number, payload, time_ns, sequence = item
            self.written += 1
            self._writer.add(number, payload, time_ns, sequence)
            self._dequeued_bytes += len(payload) + MESSAGE_OVERHEAD
            if deadline is None:
                deadline = time.monotonic() + CHUNK_PERIOD
            elif time.monotonic() > deadline:
                self._writer.flush()
                deadline = None

    def _begin_file(self, metadata: dict[str, str]) -> None:
        if self._files:
            self._writer.finish()
            self._writer.close()
            self._writer = McapWriter(self.paths.file(len(self._files)), self._topics, self._open_file)
            self.split_count += 1
        self._files.append(self._writer.statistics)
        self._writer.begin(self._mechanism_text, metadata)
        self._write_bag_metadata()

    def _finish(self) -> None:
        if not self._files:  # `begin` was never called
            self._files.append(self._writer.statistics)
            self._writer.begin(self._mechanism_text, {})
        self._writer.finish()
        self._write_bag_metadata()
        self.finished.set()
        self._writer.close()

    def _write_bag_metadata(self) -> None:
        """Update rosbag2's description of the files, if there is one."""
        if self.paths.metadata is not None:
            document = bag_metadata(self._topics, self._files, {"recorded_by": "mbd_sim"})
            write_metadata(self.paths.metadata, document)
