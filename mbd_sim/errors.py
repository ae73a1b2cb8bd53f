"""What went wrong, said so that the reader can mend it."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

MOST_SHOWN = 50  # problems in the text of one error
MOST_COMPARED = 500  # names among which the nearest is looked for


@dataclass(frozen=True)
class Problem:
    """One thing wrong with a mechanism: where it stands, what stands there, and the remedy."""

    message: str
    remedy: str = ""
    key: str = ""
    value: str = ""
    file: str = ""
    line: int = 0

    def __str__(self) -> str:
        place = ":".join(str(part) for part in (self.file, self.line) if part)
        head = " ".join(part for part in (place and f"{place}:", self.key and f"{self.key}:") if part)
        text = f"{head} {self.message}".strip()
        if self.value:
            text += f" (got {self.value})"
        return f"{text}. {self.remedy}" if self.remedy else f"{text}."


class MbdSimError(Exception):
    """Base of every error that this package raises on purpose."""


class InputError(MbdSimError, ValueError):
    """A value that a user gave and that cannot be used: what is wrong with it, and the remedy.

    `value` is the value to show, None where the message says enough.
    """

    def __init__(self, message: str, remedy: str = "", value: object = None) -> None:
        super().__init__(message, remedy, value)
        self.message, self.remedy, self.value = message, remedy, value

    def __str__(self) -> str:
        return f"{self.message}. {self.remedy}" if self.remedy else self.message


class MechanismError(MbdSimError):
    """A mechanism file that cannot be used; `problems` holds all that is wrong with it."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems = list(problems)
        lines = [str(problem) for problem in self.problems[:MOST_SHOWN]]
        if len(self.problems) > MOST_SHOWN:
            lines.append(f"… and {len(self.problems) - MOST_SHOWN} more problems.")
        super().__init__("\n".join(lines))


class DivergedError(MbdSimError):
    """The state became infinite or undefined; the simulation stands at the last finite state."""


class CommandError(MbdSimError, ValueError):
    """A command that cannot be applied; it is rejected whole."""


def nearest(name: str, valid: Iterable[str]) -> str:
    """A remedy that names the valid names, the nearest one to `name` first."""
    names = sorted({other for other in valid if other})
    if not names:
        return ""
    close = difflib.get_close_matches(name[:100], names[:MOST_COMPARED], n=1, cutoff=0.5)
    if close:
        rest = [other for other in names if other != close[0]]
        return f"Did you mean '{close[0]}'?" + (f" Others: {listed(rest)}." if rest else "")
    return f"Valid: {listed(names)}."


def quoted(value: object, most: int = 60) -> str:
    """A value as the user would recognise it: on one line, printable, cut to `most` characters."""
    text = str(value) if isinstance(value, int | float) else repr(value)
    return text if len(text) <= most else text[: most - 1] + "…"


def listed(names: Sequence[str], most: int = 12) -> str:
    """The names separated by commas, cut after `most`."""
    shown = ", ".join(names[:most])
    return shown if len(names) <= most else f"{shown}, … ({len(names) - most} more)"
