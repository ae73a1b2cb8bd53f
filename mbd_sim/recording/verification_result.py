"""The result of verifying a recorded file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np


@dataclass(frozen=True)
class Difference:
    """A recorded number that differs from the recomputed one; `tick` counts steps since the node started."""

    topic: str
    name: str
    tick: int
    time: float
    recorded: float
    computed: float

    @property
    def size(self) -> float:
        """The absolute difference; infinite if one of the numbers is not finite."""
        size = abs(self.recorded - self.computed)
        return size if np.isfinite(size) else float("inf")


@dataclass
class Verification:
    """The comparison of one file with its recomputation. Without a `tolerance` it is bit for bit."""

    path: Path
    mechanism: str = ""
    method: str = ""
    step: float = 0.0
    tolerance: float | None = None
    environment_differences: Sequence[str] = ()  # between the recording's environment and this one
    compared: Counter[str] = field(default_factory=Counter)  # number of messages by role
    commands: Counter[str] = field(default_factory=Counter)
    steps: int = 0
    wall_time: float = 0.0  # s
    first: Difference | None = None
    largest: Difference | None = None
    differing: int = 0  # number of messages
    agreeing_since: int = 0  # number of messages that agree after the last that does not
    suspected_commands: list[str] = field(default_factory=list)  # between the last state that agrees and `first`
    problem: str = ""  # why the file is incomplete
    index_problem: str = ""  # damage of indexes and summary, because of which other readers may refuse the file
    content_problem: str = ""  # damage of records that are not compared
    failure: str = ""  # why the comparison ended before the end of the file

    @property
    def agrees(self) -> bool:
        """Whether every recorded state is the recomputed one."""
        return self.first is None and not self.failure

    @property
    def is_intact(self) -> bool:
        """Whether all states agree, and nothing else of the file is damaged; it may be truncated."""
        return self.agrees and not self.index_problem and not self.content_problem
