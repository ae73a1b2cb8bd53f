"""The exceptions of the package, the problem record, and helpers that word error messages."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, fields

from mbd_sim.base.short_repr import short_repr

MAX_SHOWN = 20  # problems listed in the text of one error
MAX_KEY, MAX_TEXT = 200, 800  # characters of a key, and of a message or a remedy, in which names may be of any length
MAX_COMPARED = 500  # names compared with a misspelled one
MAX_SUGGESTIONS = 2 * MAX_SHOWN  # searches for similar names in one file, each of which may take milliseconds

_suggestions_left: ContextVar[list[int] | None] = ContextVar("suggestions_left", default=None)


@dataclass(frozen=True)
class Problem:
    """One problem with a mechanism: what is wrong, the remedy, and the key, value, file and line.

    `repetition` are the values of the indices in an entry that stands for several, such as "i = 3".
    """

    message: str
    remedy: str = ""
    key: str = ""
    value: str = ""
    file: str = ""
    line: int = 0
    repetition: str = ""

    __repr__ = short_repr

    def __post_init__(self) -> None:
        for field in fields(self):
            if field.name != "file" and isinstance(text := getattr(self, field.name), str):
                most = MAX_KEY if field.name == "key" else MAX_TEXT
                object.__setattr__(self, field.name, printable(shortened(text, most)))

    def __str__(self) -> str:
        position = ":".join(str(part) for part in (printable(self.file), self.line) if part)
        head = " ".join(part for part in (position and f"{position}:", self._where()) if part)
        text = f"{head} {self.message}".strip()
        if self.value:
            text += f" (got {self.value})"
        return f"{text}. {self.remedy}" if self.remedy else f"{text}."

    def _where(self) -> str:
        repetition = f" ({self.repetition})" if self.repetition else ""
        return f"{self.key}{repetition}:" if self.key else ""


class MbdSimError(Exception):
    """Base class of the errors that this package raises deliberately: what is wrong, and the remedy.

    Their texts can be printed to any terminal.
    """

    def __init__(self, message: str = "", remedy: str = "") -> None:
        self.message, self.remedy = message, remedy

    def __str__(self) -> str:
        text = f"{self.message}. {self.remedy}" if self.remedy else self.message
        return printable(text if text.endswith((".", "?")) else f"{text}.", keep="\n")


class InputError(MbdSimError, ValueError):
    """A value that a user gave and that cannot be used, in which names may be of any length.

    `value` is the value to show, None where the message says enough.
    """

    def __init__(self, message: str, remedy: str = "", value: object = None) -> None:
        super().__init__(shortened(message, MAX_TEXT), shortened(remedy, MAX_TEXT))
        self.value = value


class MechanismError(MbdSimError):
    """A mechanism file that cannot be used; `problems` lists everything that is wrong with it."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems = list(problems)
        lines = [str(problem) for problem in self.problems[:MAX_SHOWN]]
        if len(self.problems) > MAX_SHOWN:
            lines.append(f"… and {len(self.problems) - MAX_SHOWN} more problems.")
        super().__init__("\n".join(lines))


class NoInertiaError(MechanismError):
    """A mechanism without equations of motion, because some joints move no inertia. Its kinematics are defined."""


class DivergedError(MbdSimError):
    """The state became infinite or undefined; the simulation stays at the last finite state."""


class CommandError(InputError):
    """A command that cannot be applied; no part of it is."""


def nearest(name: str, valid: Iterable[str]) -> str:
    """A remedy that lists the valid names, the one most similar to `name` first; empty if there are none.

    It is also empty when `few_suggestions` allows no further search.
    """
    if not may_suggest():
        return ""
    names = sorted({other for other in valid if other})
    if not names:
        return ""
    close = difflib.get_close_matches(name[:100], names[:MAX_COMPARED], n=1, cutoff=0.5)
    if close:
        rest = [other for other in names if other != close[0]]
        return f"Did you mean '{close[0]}'?" + (f" Others: {listed(rest)}." if rest else "")
    return f"Valid: {listed(names)}."


@contextmanager
def few_suggestions() -> Iterator[None]:
    """Within this context, only `MAX_SUGGESTIONS` searches for similar names are made: a file may have thousands."""
    token = _suggestions_left.set([MAX_SUGGESTIONS])
    try:
        yield
    finally:
        _suggestions_left.reset(token)


def may_suggest() -> bool:
    """Whether a further search for similar names is allowed; each call counts as one."""
    left = _suggestions_left.get()
    if left is None:
        return True
    left[0] -= 1
    return left[0] >= 0


def printable(text: str, keep: str = "") -> str:
    """The text with control characters, bidirectional overrides and other invisible characters escaped.

    :param keep: characters that stay as they are, such as line breaks.
    """
    if text.isprintable():
        return text
    return "".join(
        letter if letter.isprintable() or letter in keep else letter.encode("unicode_escape").decode()
        for letter in text
    )


def shortened(text: str, most: int) -> str:
    """The text, without its middle if it has more than `most` characters."""
    return text if len(text) <= most else f"{text[: most * 3 // 4]} … {text[-most // 4 :]}"


def quoted(value: object, max_length: int = 60) -> str:
    """A value as the user wrote it, for an error message: printable, on one line, cut to `max_length` characters."""
    text = str(value) if isinstance(value, int | float) else repr(value)
    return text if len(text) <= max_length else text[: max_length - 1] + "…"


def require_each_once(names: Sequence[str], remedy: str) -> None:
    """Refuse joints of a command of which one is named twice, in a time proportional to their number.

    :raises CommandError: with the first such name.
    """
    seen = set[str]()
    for name in names:
        if name in seen:
            raise CommandError(f"{quoted(name)} is named twice", remedy)
        seen.add(name)


def counted(count: int, noun: str) -> str:
    """A number of things: "1 step", "2 steps"."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def cause_of(error: Exception) -> str:
    """What an error of the operating system says, without its number; of others their text."""
    return getattr(error, "strerror", None) or str(error)


def listed(names: Sequence[str], max_count: int = 12) -> str:
    """The names separated by commas; if there are more than one beyond `max_count`, only their number."""
    if len(names) <= max_count + 1:
        return ", ".join(names)
    return f"{', '.join(names[:max_count])}, … ({len(names) - max_count} more)"
