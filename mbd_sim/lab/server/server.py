"""A server of viser that lets nobody in whom the gate refuses, opens no tunnel, and prints nothing."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

from mbd_sim.lab.server.safety import Gate, guarded


class PageServer:
    """A server for pages one after the other, behind a gate; `viser` is the server itself."""

    def __init__(self, host: str, port: int) -> None:
        """Start it; port 0 is a free one."""
        self._gate = Gate(host)
        self.viser = started(self._gate, host, port, "mbd_sim lab")

    @property
    def url(self) -> str:
        """The address, with the token if there is one."""
        host = self.viser.get_host()
        token = f"?token={self._gate.token}" if self._gate.token else ""
        return f"http://{f'[{host}]' if ':' in host else host}:{self.viser.get_port()}/{token}"

    def stop(self) -> None:
        """Stop it."""
        stop(self.viser)


def started(gate: Gate, host: str, port: int, label: str | None = None) -> Any:
    """Start a server behind a gate; port 0 is a free one.

    :raises MbdSimError: this version of viser cannot be guarded.
    """
    import viser
    from viser import _messages

    with guarded(gate), _quiet():
        server = viser.ViserServer(host=host, port=port, label=label, verbose=False)
    server._websock_server.unregister_handler(_messages.ShareUrlRequest)  # it would open a tunnel
    return server


def stop(server: Any) -> None:
    """Stop a server."""
    with _quiet():
        server.stop()


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Without what viser prints through rich, which notebooks would show even where the output is redirected."""
    import rich

    console = rich.get_console()
    before, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = before
