"""The viewer's process: turns rows of numbers into what a viewer shows, outside the simulation's interpreter.

It ends when its input does, so that the recording is complete even when the simulation was killed. A message to it has
a kind, a length, and bytes: first the scene description and the sink, pickled; then rows of samples as raw numbers,
events and measurements of sensors as JSON, and numbered requests to flush what was sent before. Lines of JSON come
back.

A file of Rerun ends with a list of all chunks, by which other programs find data without reading it all. Rerun itself
keeps this list in memory while it writes a file. The process writes files without it, so that its memory hardly grows,
and has it added at the end.
"""

from __future__ import annotations

import contextlib
import json
import os
import pickle
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, Protocol

import numpy as np

from mbd_sim.base.operating_system import lower_priority
from mbd_sim.pictures.rerun import sinks
from mbd_sim.pictures.rerun.sinks import is_live

if TYPE_CHECKING:
    from mbd_sim.base.geometry.pose import Array
    from mbd_sim.pictures.rerun.scene import LoggedEvent, SceneDescription


class Stream(Protocol):
    """What shows the samples of a motion; `address` is where to view it."""

    address: str

    def send_samples(self, values: Array) -> None:
        """Show samples, rows (n, width) of `RowLayout` in the order of their times."""

    def send_events(self, events: Sequence[LoggedEvent]) -> None:
        """Show events."""

    def send_measurements(self, sensor: str, quantity: str, times: Array, values: Array) -> None:
        """Show measurements (n, components) of a sensor over the times (n,) in s at which they arrived."""

    def flush(self) -> None:
        """Send the buffered data."""

    def close(self) -> None:
        """End the recording."""


HEADER = struct.Struct("<cQ")
SCENE, ROWS, EVENTS, MEASUREMENTS, FLUSH = b"S", b"R", b"E", b"M", b"F"


def pack(kind: bytes, payload: bytes) -> bytes:
    """A message as bytes."""
    return HEADER.pack(kind, len(payload)) + payload


def read(stream: IO[bytes]) -> tuple[bytes, bytes] | None:
    """The next message; None at the end of the stream, or when it ends within a message."""
    header = stream.read(HEADER.size)
    if len(header) < HEADER.size:
        return None
    kind, size = HEADER.unpack(header)
    payload = stream.read(size)
    return (kind, payload) if len(payload) == size else None


LARGEST = 50_000_000  # bytes of a file: the list is added in 0.5 s, with 2.6 bytes of memory for each of them
TIMEOUT = 10.0  # s


def add_footer(path: Path) -> None:
    """Rewrite a file with its list of chunks; files beyond `LARGEST`, or that cannot be rewritten, stay as they are."""
    rewritten = path.with_name(f".{path.name}.partial")
    with contextlib.suppress(OSError, subprocess.SubprocessError):
        if path.stat().st_size <= LARGEST:
            command = [sinks.executable(), "rrd", "merge", str(path), "-o", str(rewritten)]
            subprocess.run(command, capture_output=True, check=True, timeout=TIMEOUT)  # noqa: S603  (own arguments)
            rewritten.replace(path)
    with contextlib.suppress(OSError):
        rewritten.unlink(missing_ok=True)


FILE_PERIOD, FILE_BATCH = 1.0, 500_000  # s, bytes: rows for a file are sent when either is reached
NUMBER = 8  # bytes
FILE_GROWTH = 0.01  # of the time since the start, by which the period grows
RERUN_LOG = "warn,re_log_encoding::rrd::file_sink=error"  # Rerun warns of files without a footer
NICENESS = 10  # so that the simulation comes first where there is not enough processor time for both


Answer = Callable[..., None]  # with the fields of a line of JSON to the simulation's process
OpenStream = Callable[["SceneDescription", str, Answer], Stream]


def main() -> int:
    """Show in Rerun what comes from standard input, until it ends; returns the exit code."""
    os.environ.setdefault("RUST_LOG", RERUN_LOG)
    return serve(_load_rerun)


def _load_rerun() -> OpenStream:
    from mbd_sim.pictures.rerun.stream import RerunStream

    return lambda scene, sink, answer: RerunStream(scene, sink, footer=False)  # a run may last for days


def serve(load: Callable[[], OpenStream]) -> int:
    """Read the scene description and the rows from standard input until it ends; returns the exit code.

    :param load: imports what shows them, and returns what opens it.
    """
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w", buffering=1)
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # output of libraries must not mix with the answers
    lower_priority(NICENESS)
    return _run(sys.stdin.buffer, answers, load)


class RowBatches:
    """Rows and measurements of sensors on their way into a stream.

    Each batch becomes a chunk for every entity, and larger chunks take less space. Therefore rows for a file, which
    nobody watches, are collected: for a second, and for 1 % of the time since the start if that is longer, but not
    beyond `FILE_BATCH`, which they occupy in memory. Rows for a viewer are sent as they come.
    """

    def __init__(self, stream: Stream, width: int, *, live: bool) -> None:
        self._stream, self._width, self._live = stream, width, live
        self._waiting: list[bytes] = []
        self._measured: dict[tuple[str, str], list[tuple[float, list[float]]]] = {}  # by sensor and quantity
        self._size, self._start = 0, time.monotonic()
        self._sent = self._start

    def add(self, rows: bytes) -> None:
        """Take rows, and send them if it is time."""
        self._waiting.append(rows)
        self._send_if_due(len(rows))

    def measure(self, measurements: Iterable[tuple[float, str, str, list[float]]]) -> None:
        """Take measurements of sensors, and send all that waits if it is time."""
        size = 0
        for time_s, sensor, quantity, values in measurements:
            self._measured.setdefault((sensor, quantity), []).append((time_s, values))
            size += NUMBER * (1 + len(values))
        self._send_if_due(size)

    def _send_if_due(self, size: int) -> None:
        self._size += size
        now = time.monotonic()
        period = max(FILE_PERIOD, FILE_GROWTH * (now - self._start))
        if self._live or self._size >= FILE_BATCH or now - self._sent >= period:
            self.send()

    def send(self) -> None:
        """Send all rows and measurements that wait."""
        if self._waiting:
            self._stream.send_samples(np.frombuffer(b"".join(self._waiting)).reshape(-1, self._width))
        for (sensor, quantity), measurements in self._measured.items():
            times, values = zip(*measurements, strict=True)
            self._stream.send_measurements(sensor, quantity, np.array(times), np.array(values))
        self._measured.clear()
        self._waiting, self._size, self._sent = [], 0, time.monotonic()


def _run(source: IO[bytes], answers: IO[str], load: Callable[[], OpenStream]) -> int:
    def answer(**fields: object) -> None:
        with contextlib.suppress(OSError):  # the simulation's process has ended
            answers.write(f"{json.dumps(fields)}\n")

    try:
        # What it needs is imported while the other process prepares the scene description.
        open_stream = load()
        from mbd_sim.pictures.rerun.scene import LoggedEvent
        from mbd_sim.simulation.run.events import EventKind

        first = read(source)
        if first is None:
            return 1
        scene, sink = pickle.loads(first[1])  # noqa: S301  (from the process that started this one)
        stream = open_stream(scene, sink, answer)
    except Exception as error:  # reported by the simulation's process
        answer(failed=str(error) or repr(error))
        return 1
    answer(address=stream.address)
    batches = RowBatches(stream, scene.rows.width, live=is_live(sink))
    try:
        while (message := read(source)) is not None:
            kind, payload = message
            if kind == ROWS:
                batches.add(payload)
            elif kind == MEASUREMENTS:
                batches.measure(json.loads(payload))
            elif kind == EVENTS:
                events = json.loads(payload)
                stream.send_events([LoggedEvent(time, EventKind(kind), text) for time, kind, text in events])
            elif kind == FLUSH:
                batches.send()
                stream.flush()
                answer(flushed=int.from_bytes(payload, "little"))
        batches.send()
        stream.flush()
    except Exception as error:
        answer(failed=str(error) or repr(error))
        stream.close()
        return 1
    stream.close()
    if not is_live(sink):
        add_footer(Path(sink))
    return 0


if __name__ == "__main__":
    sys.exit(main())
