"""The shared memory of nodes that were killed, which nobody else removes and of which thousands of files make nodes wait.

Each participant of Fast DDS keeps files in shared memory: segments `fastrtps_ID`, and ports `fastrtps_portN` with a semaphore
`sem.fastrtps_portN_mutex`. Beside each is a file, with `_el` or `_sl` after its name, that its process locks as long as
it lives. Files whose lock is free can go; so does `fastdds shm clean`, which the wheels of ROS do not contain.
"""

import contextlib
import fcntl
import re
import time
from pathlib import Path

FOLDER = Path("/dev/shm")
LOCK = re.compile(r"(fastrtps_(?:[0-9a-z]{16}|port\d{1,5}))_[es]l")
YOUNG = 10.0  # s; a node that has just created a file may not have locked it yet


def remove_unused_shared_memory(folder=FOLDER, young=YOUNG):
    """Remove the files of all processes that have ended; returns the names of the locks that went."""
    removed = []
    for path in sorted(folder.glob("fastrtps_*_[es]l")):
        with contextlib.suppress(OSError):  # locked, of another user, or gone
            if (name := LOCK.fullmatch(path.name)) is None or time.time() - path.stat().st_mtime < young:
                continue
            with path.open("rb") as file:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                for other in (name[1], f"sem.{name[1]}_mutex", path.name):
                    (folder / other).unlink(missing_ok=True)
            removed.append(path.name)
    return removed
