"""Keeps the last seconds of a node's run in memory, and writes them as a recording on request or after an event."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from mbd_sim.base.errors import counted
from mbd_sim.recordings.messages.states import Snapshot
from mbd_sim.recordings.run.paths import RecordingError
from mbd_sim.recordings.run.recorder import Recorder
from mbd_sim.recordings.run.run_watch import RunWatch
from mbd_sim.simulation.run.events import ERRORS, EventKind, Payload

PIECES = 4  # that the kept time is divided into: a recording is at most that much longer than the time
MOST_BYTES = 500e6  # of messages that are kept; beyond, fewer seconds are
OVERHEAD = 200  # bytes of memory that a message takes besides its payload
BATCH, PAUSE = 200, 1e-3  # messages after which the writing thread lets others run, and s for which it does
QUEUED = 4e6  # bytes that may wait in the recorder, which leaves out messages if too many do
ANSWER_TIMEOUT = 0.2  # s that a service call waits for the disk; commands wait as long
CLOSE_TIMEOUT = 1.8  # s that the end of the node waits for the disk
NOTHING = "nothing has been recorded yet"
Message = tuple[str, bytes, int, int]  # topic, payload, time in ns, tick


@dataclass
class _KeptPiece:
    """A part of the run: what determines it, the messages with which a file begins, and those that follow."""

    moment: Snapshot
    metadata: Mapping[str, str]
    each_file: Mapping[str, bytes]
    messages: list[Message] = field(default_factory=list)
    size: int = 0


@dataclass(eq=False)
class _Writing:
    """A recording to be written: its pieces, why, and, once `done` is set, how that went."""

    pieces: list[_KeptPiece]
    cause: str
    done: threading.Event = field(default_factory=threading.Event)
    path: str = ""
    problem: str = ""


class NodeRing:
    """At least the last `seconds` of the messages that the publishing thread puts, and at most a quarter more.

    The run is divided into pieces that begin with everything that determines the motion from there on, so the
    recording from the oldest piece on can be recomputed. A thread writes it while the run continues.
    """

    def __init__(
        self,
        seconds: float,
        step_size: float,
        open_recorder: Callable[[], Recorder],
        metadata: Callable[[Snapshot], Mapping[str, str]],
        request: Callable[[Callable[[Snapshot], None]], object],
        on_written: Callable[[str], None],
        on_failure: Callable[[str], None],
    ) -> None:
        """Create it; it keeps what is put after `begin`.

        :param request: has the publishing thread call a function with the next state for a recording.
        :param on_written: is called with a sentence on each recording that has been written,
        :param on_failure: and on each that has not, or on memory that does not suffice.
        """
        self._steps, self._step_size = max(round(seconds / step_size), 1), step_size
        self.piece_steps = max(self._steps // PIECES, 1)
        self._open_recorder, self._metadata, self._request = open_recorder, metadata, request
        self._on_written, self._on_failure = on_written, on_failure
        self._pieces: list[_KeptPiece] = []
        self._each_file: dict[str, bytes] = {}  # the last message of each topic that begins every file
        self._size, self._asked, self._short = 0, False, False
        self._jobs: queue.SimpleQueue[_Writing | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._write_all, name="ring", daemon=True)
        self._thread.start()

    def begin(self, moment: Snapshot) -> None:
        """Begin the next piece with what is put from now on; for the publishing thread, or before it starts."""
        self._asked = False
        self._pieces.append(_KeptPiece(moment, self._metadata(moment), dict(self._each_file)))
        self._forget(moment.ticks)

    def put(self, name: str, payload: bytes, time_ns: int, ticks: int, *, in_each_file: bool = False) -> None:
        """Keep a message of a topic; with `in_each_file`, recordings that begin later begin with the last one."""
        if in_each_file:
            self._each_file[name] = payload
        if not self._pieces:
            return
        piece, size = self._pieces[-1], len(payload) + OVERHEAD
        piece.messages.append((name, payload, time_ns, ticks))
        piece.size += size
        self._size += size
        if piece.size * PIECES >= MOST_BYTES and not self._asked:
            self._asked = True
            self.divide()

    def divide(self) -> None:
        """Have the next piece begin between two steps; returns at once."""
        self._request(self.begin)

    def _forget(self, ticks: int) -> None:
        """Forget the pieces that are not needed, or for which there is no memory."""
        pieces = self._pieces
        while len(pieces) > 1 and (ticks - pieces[1].moment.ticks >= self._steps or self._size > MOST_BYTES):
            if ticks - pieces[1].moment.ticks < self._steps and not self._short:
                self._short = True
                kept = (ticks - pieces[1].moment.ticks) * self._step_size
                self._on_failure(
                    f"record_last: {MOST_BYTES / 1e6:g} MB of messages are only {kept:.3g} s of this run. "
                    "Lower publish_rate, or record fewer topics"
                )
            self._size -= pieces.pop(0).size

    def write(self) -> tuple[bool, str]:
        """Write what there is now, on request; returns success, and the path or the reason. For any other thread."""
        writings: list[_Writing] = []
        begun = threading.Event()

        def begin(moment: Snapshot) -> None:
            writings.append(self._begin_writing("request"))
            begun.set()

        self._request(begin)
        end = time.monotonic() + ANSWER_TIMEOUT
        if not begun.wait(ANSWER_TIMEOUT) or not writings[0].done.wait(max(end - time.monotonic(), 0.0)):
            return True, "the recording is being written; ~/events says when it is complete"
        (writing,) = writings
        return not writing.problem, writing.problem or writing.path

    def write_after(self, cause: str) -> None:
        """Write what there is after an event, between two steps; returns at once."""

        def begin(moment: Snapshot) -> None:
            self._begin_writing(cause)

        self._request(begin)

    def close(self, cause: str = "") -> None:
        """Finish what is being written, as far as the disk permits; with a cause, write what there is before."""
        if cause:
            self._begin_writing(cause)
        self._jobs.put(None)
        self._thread.join(CLOSE_TIMEOUT)
        if self._thread.is_alive():
            self._on_failure("the disk does not respond: the last seconds are not completely written")

    def _begin_writing(self, cause: str) -> _Writing:
        pieces = [*self._pieces[:-1], *(replace(one, messages=list(one.messages)) for one in self._pieces[-1:])]
        writing = _Writing(pieces, cause)  # with a copy of the newest piece, which grows while it is written
        self._jobs.put(writing)
        return writing

    def _write_all(self) -> None:
        while (writing := self._jobs.get()) is not None:
            try:
                self._write(writing)
            except RecordingError as error:
                writing.problem = str(error)
            except Exception as error:  # a defect must not end the thread
                writing.problem = f"the last seconds are not written: {error!r}"
            if writing.problem:
                self._on_failure(writing.problem)
            writing.pieces.clear()
            writing.done.set()

    def _write(self, writing: _Writing) -> None:
        if not (messages := [message for piece in writing.pieces for message in piece.messages]):
            writing.problem = NOTHING
            return
        first, recorder = writing.pieces[0], self._open_recorder()
        recorder.begin(first.metadata)
        latched = [(name, data, first.moment.clock_ns, first.moment.ticks) for name, data in first.each_file.items()]
        for number, message in enumerate(latched + messages):
            if number % BATCH == 0:
                time.sleep(PAUSE)
            while recorder.queued > QUEUED and not recorder.failure:
                time.sleep(PAUSE)
            recorder.put(*message)
        recorder.close()
        writing.path, writing.problem = str(recorder.location), recorder.failure
        if not writing.problem:
            kept = (messages[-1][-1] - first.moment.ticks) * self._step_size
            saved = counted(recorder.saved, "message")
            self._on_written(f"recorded the last {kept:.6g} s, {saved}, to {writing.path}: {writing.cause}")


class RingTrigger:
    """Divides a ring into its pieces, and has it written after an event that is watched for and whenever the run fails.

    For the stepping thread.
    """

    def __init__(self, ring: NodeRing, watch: RunWatch) -> None:
        self._ring, self._watch = ring, watch
        self._count = 0  # steps in the present piece

    def most_steps(self, steps: int) -> int:
        """These steps, or fewer, to take until it must be told."""
        return self._watch.most_steps(min(steps, self._ring.piece_steps - self._count))

    def passed(self, steps: int) -> None:
        """Take that some more steps have been taken."""
        self._count += steps
        if self._watch.passed(steps):
            self._ring.write_after(self._watch.cause)
        if self._count >= self._ring.piece_steps:
            self._count = 0
            self._ring.divide()

    def notice(self, kind: EventKind, payload: Payload) -> None:
        """Take an event of the run."""
        self._watch.notice(kind, payload)
        if kind in ERRORS:
            self._ring.write_after(f"{kind}: {payload}")
