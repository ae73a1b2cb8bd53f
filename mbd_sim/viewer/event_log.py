"""Events on the timeline: a line in the log for each, and lanes that show in which state the run is.

A line begins as the node writes it: `paused`, `running`, `reset`, `command`, `commands expired: …`, `warning: …`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import rerun as rr

from mbd_sim.viewer import entity_paths
from mbd_sim.viewer.entity import Logged
from mbd_sim.viewer.event_filter import EXPIRED, RESET, is_command

RUN, COMMANDS = f"{entity_paths.STATES}/run", f"{entity_paths.STATES}/commands"
STYLES = {
    RUN: {"running": (70, 130, 180), "paused": (150, 150, 160), "stopped": (229, 101, 98)},
    COMMANDS: {"none": (60, 66, 76), "taken": (96, 200, 120), "expired": (245, 166, 66)},
}
_RUN = {"paused": "paused", "running": "running", "diverged": "stopped", "failed": "stopped"}


class Event(NamedTuple):
    """Something that happened at a time (s) on the timeline."""

    time: float
    text: str


def level(text: str) -> str:
    """How serious it is."""
    if text.startswith(("diverged", "failed")):
        return str(rr.TextLogLevel.ERROR)
    serious = text.startswith(("warning", EXPIRED))
    return str(rr.TextLogLevel.WARN if serious else rr.TextLogLevel.INFO)


def static() -> Logged:
    """The colours of the lanes."""
    for entity, styles in STYLES.items():
        yield entity, rr.StateConfiguration(values=list(styles), colors=list(styles.values()))


def columns(events: Sequence[Event]) -> list[tuple[str, np.ndarray, object]]:
    """Entity, times (s) and columns of what events say."""
    times = np.array([event.time for event in events])
    texts = ["commands are taken" if is_command(event.text) else event.text for event in events]
    levels = [level(event.text) for event in events]
    found: list[tuple[str, np.ndarray, object]] = [
        (entity_paths.EVENTS, times, rr.TextLog.columns(text=texts, level=levels))
    ]
    for entity, of in ((RUN, _run), (COMMANDS, _commands)):
        told = [(event.time, state) for event in events if (state := of(event.text))]
        if told:
            states = rr.StateChange.columns(state=[state for _, state in told])
            found.append((entity, np.array([time for time, _ in told]), states))
    return found


def _run(text: str) -> str:
    return next((state for start, state in _RUN.items() if text.startswith(start)), "")


def _commands(text: str) -> str:
    if is_command(text):
        return "taken"
    return "expired" if text.startswith(EXPIRED) else "none" if text.startswith(RESET) else ""
