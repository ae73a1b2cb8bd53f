"""Work beside the session, which goes on meanwhile: a saved file is read again, and new values are validated."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from mbd_sim.base.errors import MbdSimError, MechanismError
from mbd_sim.files.checks.override import with_values
from mbd_sim.files.load import load_mechanism
from mbd_sim.files.text.mesh_files import files_of
from mbd_sim.lab.session.bench import Bench
from mbd_sim.lab.session.own_session import OwnSession
from mbd_sim.mechanism.mechanism import Mechanism

PERIOD = 0.1  # s between two looks at the file


class FileWatch:
    """Calls `adopt` with each mechanism that a file becomes, or `refuse` with what `mbd_sim check` says about it.

    It looks at all `files_of` the mechanism, and, after a mistake, at the files with mistakes and into the folders.
    Values that were replaced with `--set` stay replaced.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        build: Callable[[Mechanism], Bench],
        adopt: Callable[[Bench], None],
        refuse: Callable[[str], None],
    ) -> None:
        self._path, self._changes = Path(mechanism.source.file), dict(mechanism.source.changes)
        source = mechanism.source
        self._way: dict[str, Any] = {"base": source.base, "xacro": source.xacro, "control": source.control}
        self._build, self._adopt, self._refuse = build, adopt, refuse
        self._files, self._more = files_of(mechanism), tuple[str, ...]()
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
        """Read the files if one was saved since the last look."""
        state = self._state()
        if state == self._seen or not self._path.exists():  # editors replace files
            return
        self._seen = state
        try:
            mechanism = load_mechanism(self._path, hulls="contacts" in self._changes, **self._way)
            mechanism = with_values(mechanism, self._changes) if self._changes else mechanism
            bench = self._build(mechanism)
        except MbdSimError as error:
            problems = error.problems if isinstance(error, MechanismError) else ()
            self._watch(self._files, [problem.file for problem in problems if problem.file])
            self._refuse(str(error))
            return
        self._watch(files_of(mechanism))
        if not self._stopped.is_set():
            self._adopt(bench)

    def _watch(self, files: tuple[str, ...], wrong: Sequence[str] | None = None) -> None:
        """Look at these files from here on; what was saved since the last look still counts as saved."""
        folders = [] if wrong is None else [str(Path(file).parent) for file in (*files, *wrong)]
        more = tuple(dict.fromkeys([*(wrong or ()), *folders]))
        if (files, more) != (self._files, self._more):
            before = dict(zip((*self._files, *self._more), self._seen, strict=True))
            self._files, self._more = files, more
            now = zip((*files, *more), self._state(), strict=True)
            self._seen = tuple(before.get(file, state) for file, state in now)

    def _run(self) -> None:
        while not self._stopped.wait(PERIOD):
            self.look()

    def _state(self) -> tuple[tuple[int, int], ...]:
        """What changes when a file is saved."""
        return tuple(_saved(file) for file in (*self._files, *self._more))


def _saved(file: str) -> tuple[int, int]:
    """The time and the size of a file; zeros if there is none."""
    try:
        found = Path(file).stat()
    except OSError:
        return 0, 0
    return found.st_mtime_ns, found.st_size


class Preparer:
    """A thread that prepares the newest wanted values, and asks the session to apply them.

    To refuse a length that closes no loop takes seconds, in which the motion must not stop.
    """

    def __init__(self, session: OwnSession) -> None:
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
            session.ask("refused value", partial(OwnSession.tell, message=str(error)))
            return

        def apply(session: OwnSession) -> None:
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
