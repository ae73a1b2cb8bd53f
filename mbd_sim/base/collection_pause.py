"""Python's search for unreachable cycles, paused while many objects are made that stay."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def paused_collection() -> Iterator[None]:
    """Run without the search, which takes a twelfth of the time in which a mechanism is read and traced.

    Hundreds of thousands of objects are made there, and hardly any cycle that becomes unreachable. If the search is off
    already, it stays off.
    """
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()
