"""Real-time priority, locked memory, and a garbage collector that does not interrupt."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import queue
import resource
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path

# The time (s) after which a waking thread may claim the interpreter from another one (default: 5 ms).
SWITCH_INTERVAL = 5e-5
NEW_OBJECTS = 10_000  # more than there were at the last search that set off one, among these only
OLDER_GENERATIONS = 1000  # such searches until one goes through what they left
THREADS_BY_PRIORITY = ("stepper", "outputs", "executor")  # names of threads; all others rank below them
SIGNAL_CHECK_PERIOD = 0.2  # s
_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4  # of Linux, sys/mman.h


def freeze_memory() -> None:
    """Exclude all present objects from garbage collection, and let nothing that a running node does set it off.

    A running node keeps as many objects as it had, so that the number that sets off a search is never reached, unless
    requests leave cycles behind: then one of a millisecond removes them.
    """
    sys.setswitchinterval(SWITCH_INTERVAL)
    gc.collect()
    gc.freeze()
    gc.set_threshold(NEW_OBJECTS, OLDER_GENERATIONS, OLDER_GENERATIONS)


class CollectionTime:
    """The time in s that searches of Python's garbage collector have taken in this process since this was made."""

    def __init__(self) -> None:
        self.seconds, self._began = 0.0, 0.0
        gc.callbacks.append(self._note)

    def close(self) -> None:
        """Count no longer."""
        gc.callbacks.remove(self._note)

    def _note(self, phase: str, info: dict[str, int]) -> None:
        if phase == "start":
            self._began = time.perf_counter()
        else:
            self.seconds += time.perf_counter() - self._began


def waiting_time(thread_id: int) -> float:
    """The time in s for which a thread of this process was ready to run, but had no processor; 0 if unknown."""
    try:
        content = Path(f"/proc/self/task/{thread_id}/schedstat").read_text(encoding="utf-8")
        return 1e-9 * int(content.split()[1])
    except (OSError, IndexError, ValueError):
        return 0.0


def lock_memory() -> str:
    """Keep pages in memory once they have been used; returns why that is not permitted, or ""."""
    limit, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    # With a finite limit a later allocation would fail: memory is locked entirely or not at all.
    if os.geteuid() != 0 and limit != resource.RLIM_INFINITY:
        return f"memory is not locked: the limit is {limit // 1024} KiB (to raise it: ulimit -l unlimited)"
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT) != 0:
        cause = os.strerror(ctypes.get_errno())
        return f"memory is not locked: {cause} (to allow it: CAP_IPC_LOCK, or ulimit -l unlimited)"
    return ""


def prioritize(priority: int, thread_names: Sequence[str] = THREADS_BY_PRIORITY) -> str:
    """Give this process's threads SCHED_FIFO priorities from `priority` downward, or ordinary scheduling for 0.

    All threads share the interpreter: one that is preempted while holding it would delay the stepping. Therefore each
    gets a priority, in the order of `thread_names`. Returns why that is not permitted, or "".
    """
    for thread in threading.enumerate():
        if thread is threading.main_thread() or thread.native_id is None:
            continue
        rank = thread_names.index(thread.name) if thread.name in thread_names else len(thread_names)
        thread_priority = max(priority - rank, 1) if priority else 0
        # Threads and processes started by this thread get ordinary scheduling.
        policy = (os.SCHED_FIFO if thread_priority else os.SCHED_OTHER) | os.SCHED_RESET_ON_FORK
        try:
            os.sched_setscheduler(thread.native_id, policy, os.sched_param(thread_priority))
        except OSError as error:
            remedy = f"rtprio {priority} in /etc/security/limits.conf, or CAP_SYS_NICE"
            refusal = f"real-time priority {priority} was refused: {error.strerror}"
            return f"ordinary scheduling, because {refusal} (to allow it: {remedy})"
    return ""


def wait_for(ended: threading.Event, end_requests: queue.SimpleQueue[int]) -> None:
    """Wait in the main thread until something is put into the queue, and set the event.

    A signal delivered to another thread does not wake the main thread, the only one that runs Python's handlers:
    hence the periodic check. A handler puts the signal's number into the queue rather than set the event: if the main
    thread held the lock of the event at that moment, it would wait for itself.
    """
    while not ended.is_set():
        with contextlib.suppress(queue.Empty):
            end_requests.get(timeout=SIGNAL_CHECK_PERIOD)
            ended.set()
