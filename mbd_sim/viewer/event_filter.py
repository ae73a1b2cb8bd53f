"""Selects the events worth a line in the log: of commands, which may come a thousand times a second, only the first."""

from __future__ import annotations

from mbd_sim.simulation.events import RESTARTS, EventKind


class EventFilter:
    """Follows the events of a run in their order."""

    def __init__(self) -> None:
        self._commanded = False

    def accepts(self, kind: EventKind) -> bool:
        """Whether to show the next event: every one, except a command after another command."""
        repeated = kind is EventKind.COMMAND and self._commanded
        if kind is EventKind.COMMAND:
            self._commanded = True
        elif kind in (EventKind.EXPIRED, *RESTARTS):
            self._commanded = False
        return not repeated
