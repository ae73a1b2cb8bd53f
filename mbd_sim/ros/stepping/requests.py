"""A queue of requests from other threads to one serving thread. Independent of ROS."""

from __future__ import annotations

import threading
from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Generic, ParamSpec

P = ParamSpec("P")


class RequestQueue(Generic[P]):
    """Functions to call in the serving thread, in the order of their submission."""

    def __init__(self, wake: Callable[[], None]) -> None:
        """`wake` is called after each submission, to interrupt the serving thread's sleep."""
        self._wake = wake
        self._requests: SimpleQueue[tuple[Callable[P, None], threading.Event]] = SimpleQueue()

    def submit(self, action: Callable[P, None]) -> threading.Event:
        """Add a request and return at once; the event is set when it has been served."""
        done = threading.Event()
        self._requests.put((action, done))
        self._wake()
        return done

    def call(self, action: Callable[P, None], server: threading.Thread, *, await_start: bool = False) -> None:
        """Add a request and wait until the serving thread has served it, or has ended.

        :param await_start: wait also for a thread that has not started yet; otherwise it serves the request later.
        """
        done = self.submit(action)
        while not done.wait(0.1):
            if not server.is_alive() and not (await_start and server.ident is None):
                return

    def serve_next(self, *args: P.args, **kwargs: P.kwargs) -> bool:
        """Serve the oldest request; False if there is none."""
        try:
            action, done = self._requests.get_nowait()
        except Empty:
            return False
        try:
            action(*args, **kwargs)
        finally:
            done.set()
        return True

    def serve_all(self, *args: P.args, **kwargs: P.kwargs) -> None:
        """Serve all requests that wait."""
        while self.serve_next(*args, **kwargs):
            pass
