"""Messages read ahead of their time. Knows no ROS."""

from __future__ import annotations

import queue
import threading
from collections.abc import Iterator
from itertools import islice

from mbd_sim.recording.recorded_file import Message

BATCH = 200  # messages that are read at once
AHEAD = 20  # batches that wait, read, for their time


class Ahead:
    """Reads in a thread of its own, so that unpacking a block delays no message."""

    def __init__(self, messages: Iterator[Message]) -> None:
        self._messages = messages
        self._queue: queue.Queue[list[Message] | BaseException] = queue.Queue(AHEAD)
        self._closed = False
        self._thread = threading.Thread(target=self._read, name="reader", daemon=True)
        self._thread.start()

    def __iter__(self) -> Iterator[Message]:
        while batch := self._queue.get():
            if isinstance(batch, BaseException):
                raise batch
            yield from batch

    def close(self) -> None:
        """Read no further."""
        self._closed = True

    def _read(self) -> None:
        try:
            while not self._closed and (batch := list(islice(self._messages, BATCH))):
                self._put(batch)
            self._put([])
        except Exception as error:
            self._put(error)

    def _put(self, batch: list[Message] | BaseException) -> None:
        while not self._closed:
            try:
                self._queue.put(batch, timeout=0.1)
                return
            except queue.Full:
                continue
