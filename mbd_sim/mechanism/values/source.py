"""The file of a mechanism: its data, and the line of every value."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from mbd_sim.base.errors import InputError, Problem, quoted
from mbd_sim.mechanism.values.names import in_quotes, is_name

Location = tuple[str | int, ...]

_PLAIN_KEY = re.compile(r"[\w<-]{1,60}")


@dataclass(frozen=True)
class Origin:
    """Where a value comes from: the file, the line, and its key there."""

    file: str
    line: int
    key: str


@dataclass
class Source:
    """A parsed file: its data, and the line of each value by its location (a tuple of keys and indices).

    `text` is the YAML that was read, and None after a conversion from another `format`. `yaml_text.mechanism_text`
    writes YAML from which alone the mechanism can be built again, after a conversion with `comments` at the top.
    `data` may have been `changed` since they were read.
    `origins` are those of values from another file. `problems` are those that did not prevent reading the file, such
    as a duplicate key; `notes` list what was not imported from another `format`; `remarks` are sentences on what a file
    means that its author may not have meant.

    If entries of the file stand for several, `template` and `template_lines` are data and lines as written,
    `repetitions` the values of the indices by the location of the entry, such as "i = 3", `shaping` the parameters on
    which the entries depend, and `changes` the values that were replaced since, by their keys.

    `other_files` are the digests of the other files that were read, see `digest_of`, by their paths; None if these
    were searched for, so that others may be found another time. `base` and `control` are how the file was read, see
    `load_mechanism`, and `xacro` are the arguments with which a xacro file was expanded.
    """

    data: Any
    lines: dict[Location, int] = field(default_factory=dict)
    file: str = ""
    text: str | None = None
    comments: tuple[str, ...] = ()
    problems: list[Problem] = field(default_factory=list)
    origins: dict[Location, Origin] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    format: str = ""
    changed: bool = False
    template: Any = None
    template_lines: dict[Location, int] = field(default_factory=dict)
    repetitions: dict[Location, str] = field(default_factory=dict)
    shaping: frozenset[str] = frozenset()
    changes: dict[str, Any] = field(default_factory=dict)
    other_files: Mapping[str, str] | None = field(default_factory=dict)
    base: Literal["fixed", "free"] | None = None
    xacro: dict[str, str] = field(default_factory=dict)
    control: Literal["position", "velocity", "effort"] | None = None

    def __repr__(self) -> str:
        return f"<Source {self.file or 'without a file'}{self.format and f', from {self.format}'}>"

    def origin(self, location: Location) -> Origin:
        """The origin of the value at `location`, or else of the innermost value around it that has one."""
        for length in range(len(location), -1, -1):
            outer = location[:length]
            if outer in self.lines:
                return Origin(self.file, self.lines[outer], dotted(location))
            if outer in self.origins:
                return self.origins[outer]
        return Origin(self.file, 1, dotted(location))

    def line(self, location: Location) -> int:
        """The line of the value at `location`, or of the innermost value around it that has one."""
        return self.origin(location).line

    def problem(
        self, location: Location, message: str, remedy: str = "", value: Any = None, repetition: str = ""
    ) -> Problem:
        """A `Problem` at a location of this file."""
        origin = self.origin(location)
        shown = "" if value is None else quoted(value)
        repetition = repetition or self._repetition(location)
        return Problem(message, remedy, origin.key, shown, origin.file, origin.line, repetition)

    def problem_of(self, location: Location, error: InputError, repetition: str = "") -> Problem:
        """A `Problem` at a location of this file, from the error about the value there."""
        return self.problem(location, error.message, error.remedy, error.value, repetition)

    def _repetition(self, location: Location) -> str:
        """The values of the indices in the innermost repeated entry around a location."""
        lengths = range(len(location), 0, -1) if self.repetitions else ()
        return next((self.repetitions[location[:n]] for n in lengths if location[:n] in self.repetitions), "")


def value_at(data: Any, location: Location) -> Any:
    """What a file's data have at a location, None if nothing."""
    for step in location:
        if isinstance(data, list) and isinstance(step, int):
            data = data[step]
        else:
            data = data.get(step) if isinstance(data, Mapping) else None
    return data


def dotted(location: Location) -> str:
    """`('parts', 'rod', 'center', 2)` as `parts.rod.center[2]`."""
    text = ""
    for step in location:
        if isinstance(step, int):
            text += f"[{step}]"
        else:
            text += ("." if text else "") + _written(step)
    return text


def _written(step: str) -> str:
    """A key as `split_key` reads it; what cannot be a name is shown in part."""
    if _PLAIN_KEY.fullmatch(step):
        return step
    return in_quotes(step) if is_name(step) else quoted(step)
