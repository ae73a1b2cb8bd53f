"""Reads messages before they are due. Independent of ROS."""

from __future__ import annotations

import queue
import threading
from collections.abc import Iterator
from itertools import islice

from mbd_sim.recording.recorded_file import Message

BATCH_SIZE = 200  # messages read at once
MAX_BATCHES = 20  # batches that may wait


class ReadAhead:
    """Iterates over messages that a thread of its own reads, so that unpacking a block delays none of them."""

    def __init__(self, messages: Iterator[Message]) -> None:
        self._messages = messages
        self._queue: queue.Queue[list[Message] | BaseException] = queue.Queue(MAX_BATCHES)
        self._closed = False
        self._thread = threading.Thread(target=self._read, name="reader", daemon=True)
        self._thread.start()

    def __iter__(self) -> Iterator[Message]:
        while batch := self._queue.get():
            if isinstance(batch, BaseException):
                raise batch
            yield from batch

    def close(self) -> None:
        """Stop reading."""
        self._closed = True

    def _read(self) -> None:
        try:
            while not self._closed and (batch := list(islice(self._messages, BATCH_SIZE))):
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
