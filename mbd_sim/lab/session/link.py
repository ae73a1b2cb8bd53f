"""What a node and a process beside it exchange over a pair of sockets, such as that of its page.

The page sends requests as JSON; the node answers with pickles, of its state after the requests. Before, the page's
process gets a `PageOrder`, and says under which address the page is.
"""

from __future__ import annotations

import os
import socket
import struct
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.simulation.run.run_point import RunPoint

_LENGTH = struct.Struct("<Q")
_CHUNK = 1 << 16  # bytes


@dataclass(frozen=True)
class PageOrder:
    """The page to open, and the arguments of a simulation like that of the node."""

    mechanism: Mechanism
    simulation: Mapping[str, Any]
    host: str
    port: int


@dataclass(frozen=True)
class NodeState:
    """A node at one moment; `told` is what its users should know."""

    point: RunPoint
    running: bool
    speed: float
    recording: str
    told: str


class SocketEnd:
    """One end of the pair: messages of bytes with their lengths. An end that does not block keeps what has to wait."""

    def __init__(self, own: socket.socket, *, blocking: bool) -> None:
        self._socket, self._in, self._out = own, bytearray(), bytearray()
        own.setblocking(blocking)

    def send(self, message: bytes) -> None:
        """Send a message, or as much of it as the other end can take; `receive` sends the rest.

        :raises OSError: the other end is closed.
        """
        self._out += _LENGTH.pack(len(message)) + message
        self._flush()

    def receive(self) -> bytes | None:
        """The next message; None where there is none yet, at an end that does not block.

        :raises OSError: the other end is closed.
        """
        self._flush()
        while (size := self._size()) is None or len(self._in) < size:
            try:
                received = self._socket.recv(_CHUNK)
            except BlockingIOError:
                return None
            if not received:
                raise ConnectionResetError("the other end is closed")
            self._in += received
        message = bytes(self._in[_LENGTH.size : size])
        del self._in[:size]
        return message

    def close(self) -> None:
        """Close this end."""
        self._socket.close()

    def _size(self) -> int | None:
        """The bytes of the message that arrives, with its length; None until the length is there."""
        return None if len(self._in) < _LENGTH.size else _LENGTH.size + int(_LENGTH.unpack_from(self._in)[0])

    def _flush(self) -> None:
        try:
            while self._out:
                del self._out[: self._socket.send(self._out)]
        except BlockingIOError:
            pass


def start_linked(module: str) -> tuple[subprocess.Popen[bytes], SocketEnd]:
    """Start a process with the `main` of a module, which gets the number of its socket; and our end, never blocking.

    It is in a session of its own: Ctrl-C in the terminal reaches the node, whose end ends it.
    """
    ours, theirs = socket.socketpair()
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    program = f"import sys; from {module} import main; sys.exit(main())"
    process = subprocess.Popen(  # noqa: S603  (own arguments)
        [sys.executable, "-P", "-c", program, str(theirs.fileno())],
        env=environment,
        pass_fds=[theirs.fileno()],
        stdin=subprocess.DEVNULL,
        start_new_session=True,
    )
    theirs.close()
    return process, SocketEnd(ours, blocking=False)
