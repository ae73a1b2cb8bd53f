"""Processes that compute for this one."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager


@contextmanager
def ending_at_once(pool: ProcessPoolExecutor) -> Iterator[ProcessPoolExecutor]:
    """Use a pool; an interrupt or an error ends its processes at once, and not after what they compute at present."""
    try:
        yield pool
    except BaseException:
        # Python 3.14 is the first with `terminate_workers`. Other threads may have started processes of their own.
        for worker in list((pool._processes or {}).values()):
            worker.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def leave_interrupts_to_parent() -> None:
    """Ignore Ctrl-C in a process of the pool: its parent ends it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
