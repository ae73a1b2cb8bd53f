"""A client of Foxglove's server over a real WebSocket, and a reader of protobuf's wire format."""

from __future__ import annotations

import contextlib
import json
import struct
import time
from collections import defaultdict
from typing import Any

from websockets.sync.client import connect
from websockets.typing import Subprotocol

TIMEOUT = 30.0  # s
MESSAGE, TIME, PLAYBACK = 1, 2, 5  # first bytes of binary messages


class Client:
    """Subscribes to all topics; keeps the messages of each with their times in ns."""

    def __init__(self, address: str) -> None:
        self._socket = connect(address, subprotocols=[Subprotocol("foxglove.sdk.v1")])
        self.info = json.loads(self._socket.recv(timeout=10.0))
        self.channels: dict[int, dict[str, Any]] = {}
        self.messages: dict[str, list[tuple[int, bytes]]] = defaultdict(list)
        self.playback: list[bytes] = []
        self.times: list[int] = []
        self._take(self._socket.recv(timeout=10.0))

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def receive(self, until: Any, meanwhile: Any = lambda: None) -> None:
        """Take messages until a condition holds."""
        deadline = time.monotonic() + TIMEOUT
        while not until():
            meanwhile()
            with contextlib.suppress(TimeoutError):
                self._take(self._socket.recv(timeout=0.1))
            assert time.monotonic() < deadline, {topic: len(found) for topic, found in self.messages.items()}

    def control(self, play: bool, speed: float, seek_ns: int | None) -> None:
        """Ask for a playback, as Foxglove's time bar does."""
        seek = struct.pack("<BQ", seek_ns is not None, seek_ns or 0)
        name = b"request"
        self._socket.send(struct.pack("<BBf", 3, 0 if play else 1, speed) + seek + struct.pack("<I", len(name)) + name)

    def topics(self) -> dict[str, str]:
        """The schema of each topic."""
        return {channel["topic"]: channel["schemaName"] for channel in self.channels.values()}

    def json(self, topic: str) -> list[dict[str, Any]]:
        """The messages of a topic in JSON."""
        return [json.loads(payload) for _, payload in self.messages[topic]]

    def _take(self, received: str | bytes) -> None:
        if isinstance(received, str):
            message = json.loads(received)
            if message["op"] == "advertise":
                self.channels |= {channel["id"]: channel for channel in message["channels"]}
                subscriptions = [{"id": one["id"], "channelId": one["id"]} for one in message["channels"]]
                self._socket.send(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))
        elif received[0] == MESSAGE:
            channel, stamp = struct.unpack_from("<IQ", received, 1)
            self.messages[self.channels[channel]["topic"]].append((stamp, received[13:]))
        elif received[0] == TIME:
            self.times.append(struct.unpack_from("<Q", received, 1)[0])
        elif received[0] == PLAYBACK:
            self.playback.append(received)


def fields(payload: bytes) -> dict[int, list[Any]]:
    """The fields of a protobuf message by their numbers: integers, doubles, and bytes."""
    found: dict[int, list[Any]] = defaultdict(list)
    at = 0

    def varint() -> int:
        nonlocal at
        value = shift = 0
        while True:
            byte = payload[at]
            at += 1
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return value

    while at < len(payload):
        key = varint()
        match key & 7:
            case 0:
                found[key >> 3].append(varint())
            case 1:
                found[key >> 3].append(struct.unpack_from("<d", payload, at)[0])
                at += 8
            case 2:
                size = varint()
                found[key >> 3].append(payload[at : at + size])
                at += size
            case kind:
                raise AssertionError(kind)
    return found


def vector(payload: bytes, size: int = 3) -> list[float]:
    """The numbers of a vector, a point or a quaternion; those that are left out are 0."""
    read = fields(payload)
    return [read[number + 1][0] if read.get(number + 1) else 0.0 for number in range(size)]
