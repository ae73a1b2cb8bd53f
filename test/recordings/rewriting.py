"""Copies of recordings with changes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from mcap.writer import Writer

from mbd_sim.recordings.messages.cdr import Message
from mbd_sim.recordings.run.reader import open_recording


def rewrite(
    path: Path,
    out: Path,
    change: Callable[[int, Message], Message | None] = lambda number, message: message,
    about: dict[str, str] | None = None,
    chunk_size: int = 3000,
) -> Path:
    """Write a copy of a recording with some messages changed or left out, and entries added to its metadata."""
    recording = open_recording(path)
    with out.open("wb") as stream:
        writer = Writer(stream, chunk_size=chunk_size)
        writer.start(profile="ros2", library="test")
        writer.add_attachment(0, 0, "mechanism.yaml", "application/yaml", recording.mechanism_text.encode())
        writer.add_metadata("mbd_sim", dict(recording.about) | (about or {}))
        channels = {}
        for name, topic in recording.topics.items():
            schema = writer.register_schema(topic.type, "ros2msg", topic.definition.encode())
            channels[name] = writer.register_channel(name, "cdr", schema, {"offered_qos_profiles": topic.qos})
        for number, message in enumerate(recording.messages()):
            if (kept := change(number, message)) is not None:
                writer.add_message(channels[kept.topic], kept.time_ns, kept.payload, kept.time_ns, kept.sequence)
        writer.finish()
    return out


def with_bit_flipped(message: Message, offset: int, bit: int) -> Message:
    """Return a message with one bit of its payload flipped; a negative `offset` counts from the end."""
    payload = bytearray(message.payload)
    payload[offset] ^= 1 << bit
    return replace(message, payload=bytes(payload))
