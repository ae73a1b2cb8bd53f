"""The viewer's process: turns rows of numbers into columns of Rerun, outside the simulation's interpreter.

It ends when its input does, so that the recording is complete even when the simulation was killed.
"""

from __future__ import annotations

import contextlib
import json
import os
import pickle
import sys
from typing import IO

import numpy as np

from mbd_sim.viewer import protocol

NICENESS = 10  # so that the simulation comes first where there is not enough processor time for both


def main() -> int:
    """Read the scene description and the rows from standard input until it ends; returns the exit code."""
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w", buffering=1)
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # output of libraries must not mix with the answers
    with contextlib.suppress(OSError):
        os.nice(NICENESS)
    return _run(sys.stdin.buffer, answers)


def _run(source: IO[bytes], answers: IO[str]) -> int:
    def answer(**fields: object) -> None:
        with contextlib.suppress(OSError):  # the simulation's process has ended
            answers.write(f"{json.dumps(fields)}\n")

    try:
        # Rerun is imported while the other process prepares the scene description.
        from mbd_sim.simulation.events import EventKind
        from mbd_sim.viewer.event_log import LoggedEvent
        from mbd_sim.viewer.rerun_stream import RerunStream

        first = protocol.read(source)
        if first is None:
            return 1
        scene, sink = pickle.loads(first[1])  # noqa: S301  (from the process that started this one)
        stream = RerunStream(scene, sink)
    except Exception as error:  # reported by the simulation's process
        answer(failed=str(error) or repr(error))
        return 1
    answer(address=stream.address)
    try:
        while (message := protocol.read(source)) is not None:
            kind, payload = message
            if kind == protocol.ROWS:
                stream.send_samples(np.frombuffer(payload).reshape(-1, scene.rows.width))
            elif kind == protocol.EVENTS:
                events = json.loads(payload)
                stream.send_events([LoggedEvent(time, EventKind(kind), text) for time, kind, text in events])
            elif kind == protocol.FLUSH:
                stream.flush()
                answer(flushed=int.from_bytes(payload, "little"))
        stream.flush()
    except Exception as error:
        answer(failed=str(error) or repr(error))
        stream.close()
        return 1
    stream.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
