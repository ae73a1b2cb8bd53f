"""The file that a mechanism was read from, and the line on which every value stands."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any

from mbd_sim.errors import InputError, Problem, quoted

Location = tuple[str | int, ...]

_PLAIN_KEY = re.compile(r"[\w<-]{1,60}")


@dataclass(frozen=True)
class Origin:
    """Where a value stands that was read from another file: the file, the line, and its name there."""

    file: str
    line: int
    key: str


@dataclass
class Source:
    """A parsed file: its data, and the line of each value by its location (a tuple of keys and indices).

    `text` is YAML and alone enough to build the mechanism again. `origins` are the places of values that came from
    another file. `problems` are those that did not keep the file from being read, such as a key given twice;
    `notes` say what was not taken over from another format.
    """

    data: Any
    lines: dict[Location, int] = field(default_factory=dict)
    file: str = ""
    text: str = ""
    problems: list[Problem] = field(default_factory=list)
    origins: dict[Location, Origin] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def origin(self, location: Location) -> Origin:
        """Where the value at `location` stands, or else the nearest thing that encloses it."""
        for length in range(len(location), -1, -1):
            outer = location[:length]
            if outer in self.lines:
                return Origin(self.file, self.lines[outer], dotted(location))
            if outer in self.origins:
                return self.origins[outer]
        return Origin(self.file, 1, dotted(location))

    def line(self, location: Location) -> int:
        """The line of the value at `location`, or of the nearest thing that encloses it."""
        return self.origin(location).line

    def problem(self, location: Location, message: str, remedy: str = "", value: Any = None) -> Problem:
        """A `Problem` at a location of this file."""
        origin = self.origin(location)
        shown = "" if value is None else quoted(value)
        return Problem(message, remedy, key=origin.key, value=shown, file=origin.file, line=origin.line)

    def problem_of(self, location: Location, error: InputError) -> Problem:
        """A `Problem` at a location of this file, from what is wrong with the value there."""
        return self.problem(location, error.message, error.remedy, error.value)


def dotted(location: Location) -> str:
    """`('parts', 'rod', 'center', 2)` as `parts.rod.center[2]`."""
    text = ""
    for step in location:
        if isinstance(step, int):
            text += f"[{step}]"
        else:
            text += ("." if text else "") + (step if _PLAIN_KEY.fullmatch(step) else quoted(step))
    return text
