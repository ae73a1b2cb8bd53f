"""Forces recorded files to the disk in a thread of its own, so that the one that writes them does not wait for it."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable

from mbd_sim.recording.mcap_writer import McapWriter

SYNC_PERIOD = 0.25  # s between requests to write data to the disk: the additional loss at a power failure


class FileSync:
    """Forces what the `current` file has to the disk periodically, and closes the files that are complete.

    The thread ends after `stop` or `finish`.
    """

    def __init__(self, current: Callable[[], McapWriter]) -> None:
        self._current = current
        self._complete: queue.SimpleQueue[McapWriter | None] = queue.SimpleQueue()  # to be closed; None is the end
        self._error: OSError | None = None
        self._thread = threading.Thread(target=self._run, name="recorder_sync", daemon=True)
        self._thread.start()

    def close(self, file: McapWriter) -> None:
        """Request that a complete file is closed."""
        self._complete.put(file)

    def require_success(self) -> None:
        """Check the files that have been closed.

        :raises OSError: the disk refused one.
        """
        if self._error is not None:
            raise self._error

    def stop(self) -> None:
        """Request the end, after the files that are to be closed."""
        self._complete.put(None)

    def finish(self) -> None:
        """Wait until all files are on the disk.

        :raises OSError: the disk refused one.
        """
        self.stop()
        self._thread.join()
        self.require_success()

    def _run(self) -> None:
        while True:
            try:
                file = self._complete.get(timeout=SYNC_PERIOD)
            except queue.Empty:
                self._current().sync()
                continue
            if file is None:
                return
            try:
                file.close()
            except OSError as error:
                self._error = self._error or OSError(error.errno, error.strerror, str(file.path))
