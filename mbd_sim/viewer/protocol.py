"""The messages between the simulation's process and the viewer's: a kind, a length, and bytes.

To the viewer: first the scene description and the sink, pickled; then rows of samples as raw numbers, events and
measurements of sensors as JSON, and numbered requests to flush what was sent before. Back: lines of JSON.
"""

from __future__ import annotations

import struct
from typing import IO

HEADER = struct.Struct("<cQ")
SCENE, ROWS, EVENTS, MEASUREMENTS, FLUSH = b"S", b"R", b"E", b"M", b"F"


def pack(kind: bytes, payload: bytes) -> bytes:
    """A message as bytes."""
    return HEADER.pack(kind, len(payload)) + payload


def read(stream: IO[bytes]) -> tuple[bytes, bytes] | None:
    """The next message; None at the end of the stream, or when it ends within a message."""
    header = stream.read(HEADER.size)
    if len(header) < HEADER.size:
        return None
    kind, size = HEADER.unpack(header)
    payload = stream.read(size)
    return (kind, payload) if len(payload) == size else None
