"""Watches the file of a mechanism: when it is saved, the mechanism is built again, beside the one that runs."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

from mbd_sim.base.errors import MbdSimError
from mbd_sim.files.load import load_mechanism
from mbd_sim.lab.bench import Bench
from mbd_sim.mechanism.mechanism import Mechanism

PERIOD = 0.1  # s between two looks at the file


class FileWatch:
    """Calls `adopt` with each mechanism that a file becomes, or `refuse` with what `mbd_sim check` says about it."""

    def __init__(
        self,
        path: Path,
        build: Callable[[Mechanism], Bench],
        adopt: Callable[[Bench], None],
        refuse: Callable[[str], None],
    ) -> None:
        self._path, self._build, self._adopt, self._refuse = path, build, adopt, refuse
        self._seen = self._state()
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="lab_files", daemon=True)

    def start(self) -> None:
        """Begin to watch."""
        self._thread.start()

    def stop(self) -> None:
        """End; a mechanism that is being built is not adopted any more."""
        self._stopped.set()

    def look(self) -> None:
        """Read the file if it was saved since the last look."""
        state = self._state()
        if state is None or state == self._seen:
            return
        self._seen = state
        try:
            bench = self._build(load_mechanism(self._path))
        except MbdSimError as error:
            self._refuse(str(error))
            return
        if not self._stopped.is_set():
            self._adopt(bench)

    def _run(self) -> None:
        while not self._stopped.wait(PERIOD):
            self.look()

    def _state(self) -> tuple[int, int] | None:
        """What changes when the file is saved; None while it does not exist, as editors replace files."""
        try:
            found = self._path.stat()
        except OSError:
            return None
        return found.st_mtime_ns, found.st_size
