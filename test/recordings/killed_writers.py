"""Processes that record and are killed at random moments: `python -m test.recordings.killed_writers FOLDER COUNT SEED`.

Prints, for each, its folder, the number of messages put and the times of the first and the last.
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

from test.recordings.recordings import recorder_in

BATCH_SIZE = 20  # processes that run at once
LONGEST_LIFE = 800  # messages put, a thousand a second where nothing else runs
MOST_SECONDS = 4.0  # of a life where other programs leave little of the processor
STATE = struct.Struct("<QQQQ")  # messages put, times of the first and the last, longest time between two, in ns


def record(folder, shared, *, rosbag2):
    """Record a thousand messages a second until killed."""
    recorder = recorder_in(folder, rosbag2=rosbag2)
    first = last = time.monotonic_ns()
    stall = 0
    for number in itertools.count():
        now = time.monotonic_ns()
        stall, last = max(stall, now - last), now
        recorder.put("text" if number % 3 else "vital", number.to_bytes(8, "little") * 12, now, number)
        shared[:] = STATE.pack(number + 1, first, now, stall)
        if number % 2:
            time.sleep(2e-3)


def main():
    """Start and kill the processes, and print what they put."""
    folder, count, seed = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    chance = random.Random(seed)
    results = []
    for batch in batches(count):
        living = []
        for number in batch:
            shared, own = mmap.mmap(-1, STATE.size), folder / str(number)
            pid = os.fork()
            if not pid:
                record(own, shared, rosbag2=number % 4 == 0)
            living.append((chance.uniform(0.0, LONGEST_LIFE), pid, own, shared))
        latest = time.monotonic() + MOST_SECONDS
        while living:
            ended = [one for one in living if STATE.unpack(one[3][:])[0] >= one[0] or time.monotonic() > latest]
            living = [one for one in living if one not in ended]
            for _, pid, own, shared in ended:
                os.kill(pid, signal.SIGKILL)
                os.waitpid(pid, 0)
                results.append([str(own), *STATE.unpack(shared[:])])
            time.sleep(2e-3)
    print(json.dumps(results))


def batches(count):
    """Return the numbers from 0 on in batches."""
    return [range(first, min(first + BATCH_SIZE, count)) for first in range(0, count, BATCH_SIZE)]


if __name__ == "__main__":
    main()
