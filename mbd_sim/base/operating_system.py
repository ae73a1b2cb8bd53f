"""What one operating system has and another lacks: owners of files, durable writes, priorities, processors.

Differences are found by the feature, never by the name of a system. All other modules but those of the node are free of
calls that only some systems have.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import os
import shutil
import stat
from pathlib import Path

BINARY: int = getattr(os, "O_BINARY", 0)  # Windows translates the ends of lines in other files
NOT_THROUGH_LINKS: int = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)  # nor waiting for a pipe
HAS_FOLDER_DESCRIPTORS = hasattr(os, "O_DIRECTORY") and os.open in os.supports_dir_fd
HAS_OWNERS = hasattr(os, "geteuid")
RENAMES_OPEN_FILES = HAS_FOLDER_DESCRIPTORS  # Windows refuses it
OPEN_FILES = Path("/proc/self/fd")  # those of this process, such as one in memory


def processors() -> int:
    """The number of processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def lower_priority(niceness: int) -> None:
    """Let other processes come first, where the system knows priorities of this kind."""
    if hasattr(os, "nice"):
        with contextlib.suppress(OSError):
            os.nice(niceness)


LARGEST_KEPT = 1 << 25  # bytes; the most that glibc takes from its own memory
TRIM_THRESHOLD, MMAP_THRESHOLD = -1, -3  # see mallopt(3)


def keep_freed_memory(size: int) -> None:
    """Let this process keep so many bytes that are freed, where it can be told: pages that it gets anew cost time."""
    with contextlib.suppress(AttributeError, OSError, TypeError):
        tell = ctypes.CDLL(None).mallopt
        tell(TRIM_THRESHOLD, size)
        tell(MMAP_THRESHOLD, LARGEST_KEPT)


def read_at(descriptor: int, size: int, offset: int) -> bytes:
    """Up to so many bytes of a file from an offset (bytes); only one thread at a time may read a descriptor.

    :raises OSError: they cannot be read.
    """
    if hasattr(os, "pread"):
        return os.pread(descriptor, size, offset)
    os.lseek(descriptor, offset, os.SEEK_SET)
    return os.read(descriptor, size)


def force_to_disk(descriptor: int) -> None:
    """Force the data of a file to the disk.

    :raises OSError: the disk refuses them, or its file system does not support it.
    """
    getattr(os, "fdatasync", os.fsync)(descriptor)


def force_names_to_disk(folder: Path) -> None:
    """Force the names of files in a folder to the disk; Windows does so by itself.

    :raises OSError: the disk refuses them.
    """
    if not HAS_FOLDER_DESCRIPTORS:
        return
    opened = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(opened)
    finally:
        os.close(opened)


def free_bytes(descriptor: int, path: Path) -> int:
    """The number of bytes left for this user on the disk of an open file, which has this path.

    :raises OSError: the disk is gone.
    """
    if hasattr(os, "fstatvfs"):
        system = os.fstatvfs(descriptor)
        return system.f_bavail * system.f_frsize
    return shutil.disk_usage(path.absolute().parent).free


def memory_file(name: str) -> int | None:
    """The descriptor of a new file in memory, which is found in `OPEN_FILES`; None if the system has none."""
    return os.memfd_create(name) if hasattr(os, "memfd_create") else None


def is_safe(state: os.stat_result, *, sticky: bool = False) -> bool:
    """Whether only this user and the administrator can change a file or folder, as far as the system has owners.

    :param sticky: a folder in which everybody may write, but may remove only what is his own, is safe as well.
    """
    if not HAS_OWNERS:
        return True
    if state.st_uid not in (0, os.geteuid()):
        return False
    in_group = bool(state.st_mode & stat.S_IWGRP) and not _is_private(state.st_gid)
    others_write = in_group or bool(state.st_mode & stat.S_IWOTH)
    return not others_write or (sticky and bool(state.st_mode & stat.S_ISVTX))


@functools.cache
def _is_private(group: int) -> bool:
    """Whether a group is the one that many distributions create for a single user, who is us."""
    import grp
    import pwd

    try:
        user, record = pwd.getpwuid(os.geteuid()), grp.getgrgid(group)
    except KeyError:
        return False
    return record.gr_gid == user.pw_gid and record.gr_name == user.pw_name and set(record.gr_mem) <= {user.pw_name}
