"""Processes that record and are killed at random moments: `python -m test.recording.killed_writers FOLDER COUNT SEED`.

Prints, for each, the file or folder, how many messages had been put and the times of the first and the last.
"""

import itertools
import json
import mmap
import os
import random
import signal
import struct
import sys
import time
from pathlib import Path

from test.recording.recordings import recorder_in

AT_ONCE = 10  # processes
LONGEST = 0.8  # s that one lives
STATE = struct.Struct("<QQQ")


def record(folder, shared, *, rosbag2):
    """Record some messages a millisecond until killed."""
    recorder = recorder_in(folder, rosbag2=rosbag2)
    first = time.monotonic_ns()
    for number in itertools.count():
        now = time.monotonic_ns()
        recorder.put("text" if number % 3 else "vital", number.to_bytes(8, "little") * 12, now, number)
        shared[:] = STATE.pack(number + 1, first, now)
        if number % 2:
            time.sleep(1e-3)


def main():
    """Start, kill, and tell."""
    folder, count, seed = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    chance = random.Random(seed)
    told = []
    for batch in batches(count):
        living = []
        for number in batch:
            shared, own = mmap.mmap(-1, STATE.size), folder / str(number)
            pid = os.fork()
            if not pid:
                record(own, shared, rosbag2=number % 4 == 0)
            living.append((time.monotonic() + chance.uniform(0.0, LONGEST), pid, own, shared))
        for due, pid, own, shared in sorted(living, key=lambda one: one[0]):
            time.sleep(max(0.0, due - time.monotonic()))
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
            told.append([str(own), *STATE.unpack(shared[:])])
    print(json.dumps(told))


def batches(count):
    """Numbers from 0 on, some at once."""
    return [range(first, min(first + AT_ONCE, count)) for first in range(0, count, AT_ONCE)]


if __name__ == "__main__":
    main()
