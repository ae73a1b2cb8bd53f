"""Records a run to MCAP files that any ROS 2 tool opens, without delaying the thread that steps the simulation.

A thread of its own forces the files to the disk, so that the one that writes them does not wait for it.
"""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path

from mbd_sim.base.errors import counted
from mbd_sim.recordings.mcap.contents import FileStatistics
from mbd_sim.recordings.mcap.rosbag2 import bag_text, write_metadata
from mbd_sim.recordings.mcap.writer import DiskNearlyFullError, DurableFile, McapWriter
from mbd_sim.recordings.messages.definitions import Topic
from mbd_sim.recordings.run.paths import RecordingError, RecordingPaths

SYNC_PERIOD = 0.25  # s between requests to write data to the disk: the additional loss at a power failure


class FileSync:
    """Forces what the `current` file has to the disk periodically, and closes the files that are complete.

    The thread ends after `stop` or `finish`.
    """

    def __init__(self, current: Callable[[], McapWriter]) -> None:
        self._current = current
        self._complete: queue.SimpleQueue[McapWriter | None] = queue.SimpleQueue()  # to be closed; None is the end
        self._error: OSError | None = None
        self._thread = threading.Thread(target=self._run, name="recorder_sync", daemon=True)
        self._thread.start()

    def close(self, file: McapWriter) -> None:
        """Request that a complete file is closed."""
        self._complete.put(file)

    def require_success(self) -> None:
        """Check the files that have been closed.

        :raises OSError: the disk refused one.
        """
        if self._error is not None:
            raise self._error

    def stop(self) -> None:
        """Request the end, after the files that are to be closed."""
        self._complete.put(None)

    def finish(self) -> None:
        """Wait until all files are on the disk.

        :raises OSError: the disk refused one.
        """
        self.stop()
        self._thread.join()
        self.require_success()

    def _run(self) -> None:
        while True:
            try:
                file = self._complete.get(timeout=SYNC_PERIOD)
            except queue.Empty:
                self._current().sync()
                continue
            if file is None:
                return
            try:
                file.close()
            except OSError as error:
                self._error = self._error or OSError(error.errno, error.strerror, str(file.path))


QUEUE_LIMIT = 16e6  # bytes that may wait for a slow disk before messages of display topics are dropped, and
VITAL_QUEUE_LIMIT = 128e6  # bytes after which the recording ends, if the disk is too slow even for vital messages
MESSAGE_OVERHEAD = 300  # bytes of memory that a queued message takes besides its payload
CHUNK_PERIOD = 0.2  # s of real time after which a chunk is written however small it is: the most that a kill can cost
SHORTEST_FILE = 0.1  # s of real time for which a file is written before it is split because of its size
METADATA_SHARE = 0.05  # of the time, at most, for updates of rosbag2's metadata at splits

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
        open_file: Callable[[Path], DurableFile] = DurableFile,
    ) -> None:
        """Open the first file; messages put before `begin` are lost.

        :raises RecordingError: the file cannot be opened.
        """
        self.paths = paths
        self.written = 0
        self.failure = ""
        self.finished = threading.Event()  # set when the last file is complete for a reader,
        self.ended = threading.Event()  # and when it is on the disk
        self._topics = list(topics.values())
        self._numbers = {key: number for number, key in enumerate(topics)}
        self._mechanism_text, self._open_file = mechanism_text, open_file
        self._begun = self._closing = self._stopped = False
        self._accepted = self._dropped = self._unwritten = (
            0  # messages accepted and dropped by `put`, and by the thread
        )
        self._queued_bytes = self._dequeued_bytes = 0  # since the start
        self._queue: queue.SimpleQueue[_QueuedMessage | dict[str, str] | None] = queue.SimpleQueue()
        self._give_up = threading.Event()  # set when messages that still wait are not to be written any more
        self._close_requested = threading.Event()
        self._begins_requested = 0
        self._file_opened = self._metadata_due = 0.0  # on the monotonic clock
        try:
            self._writer = McapWriter(paths.file(0), self._topics, open_file)
        except OSError as error:
            raise RecordingError(f"cannot record to '{paths.location}': {error.strerror}.") from error
        self._files: list[FileStatistics] = []
        self._sync = FileSync(lambda: self._writer)
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

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
    def saved(self) -> int:
        """The number of messages in complete chunks of the files."""
        return sum(file.messages for file in self._files)

    @property
    def dropped(self) -> int:
        """The number of messages that were put and are in no file."""
        return self._dropped + self._unwritten

    @property
    def waiting_files(self) -> int:
        """The number of files that have been requested by `begin` and are not on the disk yet."""
        return self._begins_requested - len(self._files)

    @property
    def has_known_size(self) -> bool:
        """Whether the newest file has been on the disk for some time, so that `size` says how large it becomes."""
        return not self.waiting_files and time.monotonic() >= self._file_opened + SHORTEST_FILE

    @property
    def state_on_disk(self) -> str:
        """What is in the last file if it could not be completed, and what to do, or "".

        A complete file may not be on the disk yet; that is a problem only when `close` has waited for it in vain.
        """
        writer = self._writer
        if not (self.ended if self._give_up.is_set() else self.finished).is_set():
            missing = counted(self._accepted - self.saved, "message")
            return (
                f"the disk does not respond: '{writer.path}' is not complete and lacks the last {missing}. "
                f"When the disk works again, run: mbd_sim recover '{self.location}'"
            )
        if not writer.size:
            return f"nothing could be written to '{writer.path}'"
        if not writer.path.exists():
            return f"but '{writer.path}' has been removed"
        if writer.complete:
            return ""
        return f"'{writer.path}' has no index. When the disk works again, run: mbd_sim recover '{self.location}'"

    def begin(self, metadata: Mapping[str, str]) -> None:
        """Begin the first or the next file with all messages put from now on; `metadata` describes its start."""
        if not self._closing:
            self._begun = True
            self._begins_requested += 1
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
        self._accepted += 1
        self._queue.put((number, payload, time_ns, sequence & 0xFFFFFFFF))
        if self._stopped:  # since the check above: the thread may have emptied the queue before
            self._dropped += self._discarded()

    def close(self, timeout: float | None = None) -> bool:
        """Write queued messages, summary and index; return whether that was done within `timeout` seconds.

        A timeout of 0 only requests it. After half of another timeout, messages that still wait are given up, so that
        the file can be completed. A file that an earlier error left without its index is repaired if the disk accepts
        that now.
        """
        self._end()
        self._close_requested.set()
        if timeout and not self.ended.wait(timeout / 2.0):
            self._give_up.set()
            return self.ended.wait(timeout / 2.0)
        return self.ended.wait(timeout)

    def _end(self, failure: str = "") -> None:
        self.failure = self.failure or failure
        if not self._closing:
            self._closing = True
            self._queue.put(None)

    def _run(self) -> None:
        try:
            self._write_all()
            self._sync.finish()
        except DiskNearlyFullError as error:
            self._fail(f"ends: {error}", error, finish=True)
        except OSError as error:
            self._fail(f"stopped: {error.strerror}", error)
        except Exception as error:  # a defect must not end the recording silently
            self._fail(f"stopped: {error!r}", error)
        finally:
            self._closing = self._stopped = True
            self._unwritten += self._discarded()
            self.finished.set()
            self.ended.set()

    def _discarded(self) -> int:
        """Empty the queue, which nobody writes any more; returns how many messages were in it."""
        count = 0
        with contextlib.suppress(queue.Empty):
            while True:
                count += isinstance(self._queue.get_nowait(), tuple)
        return count

    def _fail(self, reason: str, error: Exception, *, finish: bool = False) -> None:
        path = error.filename if isinstance(error, OSError) and error.filename else self.path
        self.failure = self.failure or f"recording to '{path}' {reason}"
        self._closing = True
        with contextlib.suppress(OSError):
            if finish:
                self._finish()
                self._sync.finish()
                return
        lost = self._writer.abandon()
        self.written -= lost
        self._unwritten += lost
        self._sync.stop()
        if not self._writer.size:
            self._forget_empty_file()
        elif not self._writer.complete:
            self._close_requested.wait()
            self._repair()
        with contextlib.suppress(OSError):
            self._write_bag_metadata()

    def _forget_empty_file(self) -> None:
        """Forget a file into which not even its description could be written: it does not exist."""
        self._files = [file for file in self._files if file.path != self.path]
        with contextlib.suppress(OSError):
            if self.paths.rosbag2 and not self._files:
                self.paths.location.rmdir()

    def _repair(self) -> None:
        """Repair the last file at the end, when the disk may work again."""
        with contextlib.suppress(OSError, ValueError, ImportError):  # this disk may be that of the program
            from mbd_sim.recordings.run.recovery import recover

            kept = recover(self.path)
            counts = [0 if kept is None else kept.get(topic.name, 0) for topic in self._topics]
            self._writer.repaired(counts)

    def _write_all(self) -> None:
        deadline: float | None = None  # on the monotonic clock, at which the chunk is to be written
        while True:
            try:
                item = self._queue.get(timeout=None if deadline is None else max(deadline - time.monotonic(), 0.0))
            except queue.Empty:
                self._flush()
                deadline = None
                continue
            if item is None or self._give_up.is_set():
                self._unwritten += isinstance(item, tuple)
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
                self._flush()
                deadline = None

    def _flush(self) -> None:
        self._writer.flush()
        self._sync.require_success()

    def _begin_file(self, metadata: dict[str, str]) -> None:
        if self._files:
            self._writer.finish()
            following = McapWriter(self.paths.file(len(self._files)), self._topics, self._open_file)
            self._sync.close(self._writer)
            self._writer = following
        statistics = self._writer.statistics
        self._writer.begin(self._mechanism_text, metadata)
        self._file_opened = time.monotonic()
        self._files.append(statistics)
        if self._file_opened >= self._metadata_due:
            self._write_bag_metadata()
            self._metadata_due = time.monotonic() + (time.monotonic() - self._file_opened) / METADATA_SHARE

    def _finish(self) -> None:
        if not self._files:  # `begin` was never called
            self._files.append(self._writer.statistics)
            self._writer.begin(self._mechanism_text, {})
        self._writer.finish()
        self._write_bag_metadata()
        self.finished.set()
        self._sync.close(self._writer)

    def _write_bag_metadata(self) -> None:
        """Update rosbag2's description of the files, if there is one."""
        if self.paths.metadata is not None and self._files:
            write_metadata(self.paths.metadata, bag_text(self._topics, self._files, {"recorded_by": "mbd_sim"}))
