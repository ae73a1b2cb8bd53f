"""Which events are worth a line: of commands, which may come a thousand times a second, only the first."""

from __future__ import annotations

COMMANDED = "command"  # what an event is called that only tells that a command took effect
EXPIRED = "commands expired"
RESET = "reset"


def is_command(text: str) -> bool:
    """Whether it only tells that a command took effect."""
    return text == COMMANDED


class Telling:
    """Goes through the events of a run."""

    def __init__(self) -> None:
        self._commanded = False

    def worth(self, text: str) -> bool:
        """Whether to tell the next event: not of a command that follows on another."""
        repeated = is_command(text) and self._commanded
        self._commanded = is_command(text) or (self._commanded and not text.startswith((EXPIRED, RESET)))
        return not repeated
