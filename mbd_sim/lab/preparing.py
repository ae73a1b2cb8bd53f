"""Validates changes of live values beside the session: a length that closes no loop takes seconds to refuse."""

from __future__ import annotations

import threading
from functools import partial

from mbd_sim.base.errors import MbdSimError
from mbd_sim.lab.session import Session


class Preparer:
    """A thread that prepares the newest wanted values, and asks the session to apply them."""

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
            prepared = simulation.prepare_live(known)
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
