"""A file that is written without a buffer, and forced to the disk from another thread."""

from __future__ import annotations

import errno
import os
import stat
import threading
from pathlib import Path


class DurableFile:
    """A file whose data reach the operating system with each `write`, so that they survive a kill of the process.

    `sync` forces them to the disk, which may take long: a thread other than the writing one calls it periodically. An
    error that the disk reports there is raised by the next `check`.
    """

    def __init__(self, path: Path) -> None:
        """Create the file, or truncate an existing one.

        :raises OSError: it cannot be opened.
        """
        self._path = path
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o666)
        self._regular = stat.S_ISREG(os.fstat(self._descriptor).st_mode)
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
        return len(data)

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
                if not self._synced:
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
        self.check()
