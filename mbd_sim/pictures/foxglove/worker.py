"""The process of Foxglove's server, which takes the messages of `mbd_sim.pictures.rerun.worker`."""

from __future__ import annotations

from mbd_sim.pictures.rerun.worker import OpenStream, serve


def main() -> int:
    """Show to Foxglove what comes from standard input, until it ends; returns the exit code."""
    return serve(_load)


def _load() -> OpenStream:
    from mbd_sim.pictures.foxglove.stream import FoxgloveStream

    return lambda scene, sink, answer: FoxgloveStream(scene, int(sink), on_watched=lambda: answer(watched=True))
