"""Python's search for unreachable cycles, paused while many objects are made that stay."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

LEAST = 10_000  # objects aged by pauses that are worth a search among all objects
SHARE = 4  # as in Python's own rule, that search waits until a quarter as many are new as there are old ones


class _AgedObjects:
    """How many objects pauses have aged, among which no search of Python's own looks for cycles."""

    def __init__(self) -> None:
        self._count, self._limit = 0, LEAST

    def add_new_ones(self, *, counted: bool) -> None:
        """Age all objects, without a search."""
        if counted:
            self._count += gc.get_count()[0]
        gc.freeze()
        gc.unfreeze()

    def search_if_many(self) -> None:
        """Remove unreachable cycles among all objects, if many have been aged since that was done last."""
        if self._count > self._limit:
            gc.collect()
            self._count, self._limit = 0, max(LEAST, len(gc.get_objects()) // SHARE)


_aged = _AgedObjects()


@contextmanager
def paused_collection(*, lasting: bool = False) -> Iterator[None]:
    """Run without the search, which takes a twelfth of the time in which a mechanism is read and traced.

    Hundreds of thousands of objects are made there, and hardly any cycle that becomes unreachable. After the pause all
    objects count as old, so that the next search for cycles among new ones does not go through them. Python does not
    count them for its next search among all objects, so one takes place before a later pause when they are many: a
    program that builds many mechanisms keeps no more than that. If the search is off already, it stays off.

    :param lasting: whether nearly all objects that are made stay for good, as those of modules do, of whose import the
        search takes a twentieth: they are not counted.
    """
    was_on = gc.isenabled()
    if was_on and not gc.get_freeze_count():  # a node that runs must not wait for a search
        _aged.search_if_many()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            if not gc.get_freeze_count():  # objects that the program has frozen itself stay so
                _aged.add_new_ones(counted=not lasting)
            gc.enable()
