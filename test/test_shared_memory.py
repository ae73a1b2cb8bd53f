"""Which files of shared memory are removed: those of participants that have ended, as their locks say."""

import fcntl
import os

from test.shared_memory import remove_unused_shared_memory

SEGMENT, ALIVE, PORT = "fastrtps_0102f3fb470c9d79", "fastrtps_ffffffffffffffff", "fastrtps_port7411"
FILES = [
    *(SEGMENT, f"{SEGMENT}_el"),
    *(ALIVE, f"{ALIVE}_el"),
    *(PORT, f"{PORT}_sl", f"sem.{PORT}_mutex"),
    *("fastrtps_port7413", "sem.fastrtps_port7413_mutex", "fastrtps_mine_el", "other_el"),
]


def test_files_go_with_the_process_that_had_locked_them(tmp_path):
    for name in FILES:
        (tmp_path / name).write_bytes(b"")
    with (tmp_path / f"{ALIVE}_el").open("rb") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert remove_unused_shared_memory(tmp_path) == []  # they are young
        for name in FILES:
            os.utime(tmp_path / name, (0, 0))
        assert remove_unused_shared_memory(tmp_path) == [f"{SEGMENT}_el", f"{PORT}_sl"]
        assert sorted(path.name for path in tmp_path.iterdir()) == sorted([*FILES[2:4], *FILES[7:]])
    assert remove_unused_shared_memory(tmp_path) == [f"{ALIVE}_el"]
