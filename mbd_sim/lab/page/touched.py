"""Which controls the user is moving: these do not follow the session meanwhile."""

from __future__ import annotations

import math
import time

UNTOUCHED = 1.5  # s after which a control that the user has moved follows the session again


class Touched:
    """The times at which the user last moved each control, by name."""

    def __init__(self) -> None:
        self._times: dict[str, float] = {}

    def touch(self, control: str) -> None:
        """The user has moved a control."""
        self._times[control] = time.monotonic()

    def free(self, control: str) -> bool:
        """Whether a control may follow the session."""
        return time.monotonic() - self._times.get(control, -math.inf) > UNTOUCHED
