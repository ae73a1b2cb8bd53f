"""A file that is written without a buffer, and forced to the disk from another thread."""

from __future__ import annotations

import contextlib
import errno
import os
import stat
import threading
from pathlib import Path

OPEN_FILES = Path("/proc/self/fd")  # of this process, such as one in memory


def draft_path(path: Path) -> Path:
    """Return the hidden name under which a file is written until it has its first bytes."""
    return path.with_name(f".{path.name}.new")


class DurableFile:
    """A file whose data reach the operating system with each `write`, so that they survive a kill of the process.

    The file gets its name with the first `write`, so that no empty file is ever found. `sync` forces the data to the
    disk, which may take long: a thread other than the writing one calls it periodically. An error that the disk reports
    there is raised by the next `check`.
    """

    def __init__(self, path: Path) -> None:
        """Create the file; one that exists is replaced with the first `write`.

        :raises OSError: it cannot be opened.
        """
        self._path = path
        is_named = path.parent != OPEN_FILES and (path.is_file() or not path.exists())  # else a device, pipe or memory
        self._draft = draft_path(path) if is_named else None
        flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC
        try:
            self._descriptor = os.open(self._draft or path, flags, 0o666)
        except OSError as error:
            error.filename = str(path)  # the name that the user knows
            raise
        self._regular = is_named and stat.S_ISREG(os.fstat(self._descriptor).st_mode)
        self._position = self._synced = 0
        self._error: OSError | None = None
        self._closed = False
        self._lock = threading.Lock()

    def write(self, data: bytes) -> int:
        """Write all of the data.

        :raises OSError: not all could be written; a part may have been.
        """
        left = memoryview(data)
        while left:
            written = os.write(self._descriptor, left)
            self._position += written
            left = left[written:]
        if self._draft is not None:
            self._draft.replace(self._path)
            self._draft = None
        return len(data)

    def truncate(self, size: int) -> None:
        """Remove everything after the first `size` bytes; the next `write` continues there.

        :raises OSError: that is not possible.
        """
        os.ftruncate(self._descriptor, size)
        os.lseek(self._descriptor, size, os.SEEK_SET)
        self._position = size

    def tell(self) -> int:
        """Return the number of bytes written."""
        return self._position

    def check(self) -> None:
        """Raise an error that occurred in the background.

        :raises OSError: the disk refused data written earlier.
        """
        if self._error is not None:
            raise self._error

    def free(self) -> int | None:
        """Return the number of bytes left on the disk, or None if this is not a regular file."""
        if not self._regular:
            return None
        system = os.fstatvfs(self._descriptor)
        return system.f_bavail * system.f_frsize

    def sync(self) -> None:
        """Force the written data to the disk; from any thread."""
        with self._lock:
            if self._closed or self._position == self._synced or not self._regular:
                return
            position = self._position
            try:
                if not self._synced and self._draft is None:
                    self._sync_folder()
                os.fdatasync(self._descriptor)
            except OSError as error:
                if error.errno not in (errno.EINVAL, errno.ENOSYS):  # some file systems do not support it
                    self._error = error
            self._synced = position

    def _sync_folder(self) -> None:
        """Force the file's name to the disk as well."""
        folder = os.open(self._path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)

    def close(self) -> None:
        """Force the rest to the disk and close; calling it again has no effect.

        :raises OSError: the disk refused it.
        """
        self.sync()
        with self._lock:
            if self._closed:
                return
            self._closed = True
            os.close(self._descriptor)
            if self._draft is not None:
                with contextlib.suppress(OSError):
                    self._draft.unlink()
        self.check()
