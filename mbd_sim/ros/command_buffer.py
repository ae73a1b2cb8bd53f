"""Buffers commanded efforts from the topics until the next step, with a watchdog. Independent of ROS."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbd_sim.errors import CommandError
from mbd_sim.geometry.pose import Array
from mbd_sim.simulation.efforts import EffortMap
from mbd_sim.simulation.events import EventKind


class DueEfforts(NamedTuple):
    """Efforts (nv,) that take effect at the next step; `kind` is `COMMAND` or `EXPIRED`.

    `expired` are the coordinates whose efforts have been set to zero.
    """

    kind: EventKind
    efforts: Array
    expired: tuple[str, ...] = ()


class CommandBuffer:
    """Takes commands in one thread and passes the newest efforts to the stepping thread.

    A command is accepted or rejected as a whole. A coordinate for which none has arrived for `timeout` seconds of
    simulated time (0: no limit) gets the effort zero until the next command for it, whatever others are sent.
    """

    def __init__(self, effort_map: EffortMap, timeout: float) -> None:
        self.map, self.timeout = effort_map, timeout
        self.accepted = self.rejected = self.expired = 0
        size = len(effort_map.names)
        self._requested, self._new = np.zeros(size), False
        self._commanded, self._lapsed = np.zeros(size, dtype=bool), np.zeros(size, dtype=bool)
        self._last_times, self._oldest = np.full(size, np.inf), np.inf  # of the coordinates that are watched
        self._lock = threading.Lock()

    @property
    def lapsed(self) -> tuple[str, ...]:
        """The coordinates whose efforts are zero because commands for them stopped arriving."""
        return self._names_of(self._lapsed)

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
            self._commanded |= [name in efforts for name in self.map.names] if isinstance(efforts, Mapping) else True

    def due(self, time: float) -> list[DueEfforts]:
        """The efforts to apply from simulated `time` (s, monotonic) on, in this order; none where they stay."""
        with self._lock:
            found = []
            if self._new:
                self._last_times[self._commanded] = time
                self._lapsed &= ~self._commanded
                self._commanded[:], self._new = False, False
                self._oldest = float(self._last_times.min(initial=np.inf))
                found.append(DueEfforts(EventKind.COMMAND, self.map.clamped(self._requested)))
            if self.timeout > 0.0 and time - self._oldest >= self.timeout:
                found.append(self._expire(time - self._last_times >= self.timeout))
        return found

    def _expire(self, expiring: NDArray[np.bool_]) -> DueEfforts:
        self._last_times[expiring] = np.inf
        self._oldest = float(self._last_times.min(initial=np.inf))
        self._lapsed |= expiring
        self.expired += 1
        self._requested = np.where(expiring, 0.0, self._requested)
        return DueEfforts(EventKind.EXPIRED, self.map.clamped(self._requested), self._names_of(expiring))

    def _names_of(self, flags: NDArray[np.bool_]) -> tuple[str, ...]:
        return tuple(name for name, flag in zip(self.map.names, flags, strict=True) if flag)

    def clear(self) -> None:
        """Discard all commands, as after a reset."""
        with self._lock:
            self._requested = np.zeros_like(self._requested)
            self._commanded[:] = self._lapsed[:] = self._new = False
            self._last_times[:] = self._oldest = np.inf
