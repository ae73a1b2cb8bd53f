"""What the system grants a thread that must not be late: real-time priority, and memory that stays in place."""

from __future__ import annotations

import ctypes
import gc
import os
import resource
import sys
import threading
from collections.abc import Sequence

# A thread that wakes up waits this long at most for another one to give up the interpreter (default: 5 ms).
SWITCH_INTERVAL = 5e-5
RANKS = ("stepper", "outputs", "executor")  # names of threads; all others come after them
LOOK = 0.2  # seconds between looks at signals
_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4  # of Linux, sys/mman.h
_ENDLESS = resource.RLIM_INFINITY


def settle_memory() -> None:
    """Keep the garbage collector away from what lives as long as the process, and from running by itself.

    From then on somebody calls `gc.collect()` now and then; it looks only at what was made since.
    """
    sys.setswitchinterval(SWITCH_INTERVAL)
    gc.collect()
    gc.freeze()
    gc.disable()


def lock_memory() -> str:
    """Keep pages in memory once they have been touched; returns why that is not permitted, or ""."""
    limit, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    # With a finite limit a later allocation would fail: locking is all or nothing.
    if os.geteuid() != 0 and limit != _ENDLESS:
        return f"memory is not locked: the limit is {limit // 1024} KiB (ulimit -l unlimited)"
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT) != 0:
        return f"memory is not locked: {os.strerror(ctypes.get_errno())} (CAP_IPC_LOCK, or ulimit -l unlimited)"
    return ""


def prioritize(priority: int, ranks: Sequence[str] = RANKS) -> str:
    """Give the threads of this process priorities of SCHED_FIFO from `priority` down, or ordinary scheduling for 0.

    All of them take turns in the interpreter: whoever would keep one from running would keep the stepping waiting, so
    that each gets one, in the order of `ranks`, which are names of threads. Returns why that is not permitted, or "".
    """
    for thread in threading.enumerate():
        if thread is threading.main_thread() or thread.native_id is None:
            continue
        rank = ranks.index(thread.name) if thread.name in ranks else len(ranks)
        own = max(priority - rank, 1) if priority else 0
        # Whatever the thread starts has ordinary scheduling.
        policy = (os.SCHED_FIFO if own else os.SCHED_OTHER) | os.SCHED_RESET_ON_FORK
        try:
            os.sched_setscheduler(thread.native_id, policy, os.sched_param(own))
        except OSError as error:
            wanted = f"rtprio {priority} in /etc/security/limits.conf, or CAP_SYS_NICE"
            return f"ordinary scheduling: real-time priority {priority}: {error.strerror} ({wanted})"
    return ""


def wait_for(ended: threading.Event) -> None:
    """Wait in the main thread until a signal's handler sets the event.

    A signal that another thread receives does not wake this one, in which alone Python runs its handlers.
    """
    while not ended.wait(LOOK):
        pass
