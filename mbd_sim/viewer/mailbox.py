"""A bounded queue with one writer and one reader that never blocks the writer."""

from __future__ import annotations

from collections import deque
from typing import Generic, TypeVar

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
