"""Buffers commanded efforts from the topics until the next step, with a watchdog. Independent of ROS."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from mbd_sim.errors import CommandError
from mbd_sim.geometry.pose import Array
from mbd_sim.simulation.efforts import EffortMap
from mbd_sim.simulation.events import EventKind


class DueEfforts(NamedTuple):
    """Efforts (nv,) that take effect at the next step; `kind` is `COMMAND` or `EXPIRED`."""

    kind: EventKind
    efforts: Array


class CommandBuffer:
    """Takes commands in one thread and passes the newest efforts to the stepping thread.

    A command is accepted or rejected as a whole. If none has arrived for `timeout` seconds of simulated time
    (0: no limit), the efforts are set to zero until the next command.
    """

    def __init__(self, effort_map: EffortMap, timeout: float) -> None:
        self.map, self.timeout = effort_map, timeout
        self.accepted = self.rejected = self.expired = 0
        self.lapsed = False  # whether the efforts are zero because commands stopped arriving
        self._requested = np.zeros(len(effort_map.names))
        self._new = self._watching = False
        self._last_time = 0.0
        self._lock = threading.Lock()

    def by_order(self, efforts: Sequence[float]) -> None:
        """Take efforts for all coordinates, in their order.

        :raises CommandError: rejected; nothing changes.
        """
        self._take(efforts)

    def by_name(self, names: Sequence[str], efforts: Sequence[float]) -> None:
        """Take efforts for some coordinates; the others keep theirs.

        :raises CommandError: rejected; nothing changes.
        """
        if len(names) != len(efforts):
            self.rejected += 1
            raise CommandError(
                f"'name' and 'effort' differ in length: {len(names)} and {len(efforts)}. Send one effort for each name."
            )
        if len(set(names)) != len(names):
            self.rejected += 1
            raise CommandError("a joint is named twice. Send one effort for each joint.")
        self._take(dict(zip(names, efforts, strict=True)))

    def _take(self, efforts: Mapping[str, float] | Sequence[float]) -> None:
        with self._lock:
            try:
                self._requested = self.map.merged(self._requested, efforts)
            except CommandError:
                self.rejected += 1
                raise
            self.accepted += 1
            self._new = True

    def due(self, time: float) -> DueEfforts | None:
        """The efforts to apply from simulated `time` (s, monotonic) on, or None where they stay as they are."""
        with self._lock:
            if self._new:
                self._new, self._watching, self._last_time = False, True, time
                self.lapsed = False
                return DueEfforts(EventKind.COMMAND, self.map.clamped(self._requested))
            if self._watching and self.timeout > 0.0 and time - self._last_time >= self.timeout:
                self._watching = False
                self.lapsed = True
                self.expired += 1
                self._requested = np.zeros_like(self._requested)
                return DueEfforts(EventKind.EXPIRED, self._requested)
        return None

    def clear(self) -> None:
        """Discard all commands, as after a reset."""
        with self._lock:
            self._requested = np.zeros_like(self._requested)
            self._new = self._watching = self.lapsed = False
