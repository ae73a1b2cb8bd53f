"""Events on the timeline: a log line for each, and state lanes that show whether the run is going and commanded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr

from mbd_sim.simulation.events import ERRORS, EventKind
from mbd_sim.viewer import entity_paths
from mbd_sim.viewer.entity import LoggedItems

RUN, COMMANDS = f"{entity_paths.STATES}/run", f"{entity_paths.STATES}/commands"
STYLES = {
    RUN: {"running": (70, 130, 180), "paused": (150, 150, 160), "stopped": (229, 101, 98)},
    COMMANDS: {"none": (60, 66, 76), "taken": (96, 200, 120), "expired": (245, 166, 66)},
}
# The state that each lane enters with an event; other events leave a lane as it is.
_LANES: Mapping[str, Mapping[EventKind, str]] = {
    RUN: {
        EventKind.PAUSED: "paused",
        EventKind.RUNNING: "running",
        **dict.fromkeys(ERRORS, "stopped"),
    },
    COMMANDS: {
        EventKind.COMMAND: "taken",
        EventKind.EXPIRED: "expired",
        EventKind.RESET: "none",
        EventKind.NEW_STATE: "none",
    },
}
_WARNINGS = (EventKind.WARNING, EventKind.EXPIRED)


@dataclass(frozen=True, slots=True)
class LoggedEvent:
    """An event at a time (s) on the timeline, with its text."""

    time: float
    kind: EventKind
    text: str


def level(kind: EventKind) -> str:
    """The severity of an event as Rerun shows it."""
    if kind in ERRORS:
        return str(rr.TextLogLevel.ERROR)
    return str(rr.TextLogLevel.WARN if kind in _WARNINGS else rr.TextLogLevel.INFO)


def static() -> LoggedItems:
    """The colors of the lanes."""
    for entity, styles in STYLES.items():
        yield entity, rr.StateConfiguration(values=list(styles), colors=list(styles.values()))


def columns(events: Sequence[LoggedEvent]) -> list[tuple[str, np.ndarray, object]]:
    """The entities that the events change, each with its times (s) and columns."""
    times = np.array([event.time for event in events])
    texts = ["commands are accepted" if event.kind is EventKind.COMMAND else event.text for event in events]
    lines = rr.TextLog.columns(text=texts, level=[level(event.kind) for event in events])
    found: list[tuple[str, np.ndarray, object]] = [(entity_paths.EVENTS, times, lines)]
    for entity, states in _LANES.items():
        changes = [(event.time, states[event.kind]) for event in events if event.kind in states]
        if changes:
            lane = rr.StateChange.columns(state=[state for _, state in changes])
            found.append((entity, np.array([time for time, _ in changes]), lane))
    return found
