"""Work beside the session, which goes on meanwhile: a saved file is read again, and new values are validated."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path

from mbd_sim.base.errors import MbdSimError
from mbd_sim.files.load import load_mechanism
from mbd_sim.lab.session.bench import Bench
from mbd_sim.lab.session.session import Session
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


class Preparer:
    """A thread that prepares the newest wanted values, and asks the session to apply them.

    To refuse a length that closes no loop takes seconds, in which the motion must not stop.
    """

    def __init__(self, session: Session) -> None:
        self._session, self._wanted = session, dict[str, float]()
        self._lock, self._wake, self._stopped = threading.Lock(), threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="lab_values", daemon=True)
        self._thread.start()

    def ask(self, key: str, value: float) -> None:
        """Want a live value, in SI units, from any thread; it replaces one of the same key that still waits."""
        with self._lock:
            self._wanted[key] = value
        self._wake.set()

    def stop(self) -> None:
        """End the thread."""
        self._stopped.set()
        self._wake.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._stopped.is_set():
            self._wake.wait()
            self._wake.clear()
            with self._lock:
                wanted, self._wanted = self._wanted, {}
            if wanted:
                self._prepare(wanted)

    def _prepare(self, wanted: dict[str, float]) -> None:
        """Apply values; again, if the session has changed others meanwhile, as by winding back."""
        session, served = self._session, threading.Event()
        edition, simulation = session.edition, session.bench.simulation
        known = {key: value for key, value in wanted.items() if key in simulation.live}
        try:
            prepared = simulation.prepare_live(known, reassemble=True)
        except MbdSimError as error:
            session.ask("refused value", partial(Session.tell, message=str(error)))
            return

        def apply(session: Session) -> None:
            try:
                if session.edition == edition:
                    session.apply(prepared)
                else:
                    for key, value in known.items():
                        self.ask(key, value)
            finally:
                served.set()

        session.ask("values", apply)
        while not served.wait(0.1) and not self._stopped.is_set():
            pass
