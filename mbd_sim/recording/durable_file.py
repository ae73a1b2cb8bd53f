"""A file that is written without a buffer, and put on the disk from another thread."""

from __future__ import annotations

import errno
import os
import stat
import threading
from pathlib import Path


class Stream:
    """What has been written is the system's at once, so that it survives a kill of the process.

    `sync` puts it on the disk, which may take long: another thread than the writing one calls it now and then. What the
    disk says to that is raised at the next `check`.
    """

    def __init__(self, path: Path) -> None:
        """Open an empty or a new file.

        :raises OSError: it cannot be opened.
        """
        self._path = path
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o666)
        self._regular = stat.S_ISREG(os.fstat(self._descriptor).st_mode)
        self._position = self._synced = 0
        self._problem: OSError | None = None
        self._closed = False
        self._lock = threading.Lock()

    def write(self, data: bytes) -> int:
        """Write all of it.

        :raises OSError: not all could be written; a part may have been.
        """
        left = memoryview(data)
        while left:
            written = os.write(self._descriptor, left)
            self._position += written
            left = left[written:]
        return len(data)

    def tell(self) -> int:
        """Bytes written."""
        return self._position

    def flush(self) -> None:
        """Nothing is held back."""

    def check(self) -> None:
        """Raise what went wrong in the background.

        :raises OSError: the disk refused what had been written.
        """
        if self._problem is not None:
            raise self._problem

    def free(self) -> int | None:
        """Bytes that are left on the disk, or None where that means nothing."""
        if not self._regular:
            return None
        system = os.fstatvfs(self._descriptor)
        return system.f_bavail * system.f_frsize

    def sync(self) -> None:
        """Put what has been written on the disk; from any thread."""
        with self._lock:
            if self._closed or self._position == self._synced or not self._regular:
                return
            position = self._position
            try:
                if not self._synced:
                    self._sync_folder()
                os.fdatasync(self._descriptor)
            except OSError as error:
                if error.errno not in (errno.EINVAL, errno.ENOSYS):  # some file systems know no such request
                    self._problem = error
            self._synced = position

    def _sync_folder(self) -> None:
        """The file's name reaches the disk as well."""
        folder = os.open(self._path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)

    def close(self) -> None:
        """Put the rest on the disk; once more is harmless.

        :raises OSError: the disk refused it.
        """
        self.sync()
        with self._lock:
            if self._closed:
                return
            self._closed = True
            os.close(self._descriptor)
        self.check()
