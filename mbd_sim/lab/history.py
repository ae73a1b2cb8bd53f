"""The last minutes of a run, to which it can be wound back."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque

from mbd_sim.simulation.run.state import RunPoint

MOST_BYTES = 64e6
MOST_POINTS = 5400  # three minutes at 30 points a second


class History:
    """Points of a run in the order of time; the oldest ones are forgotten."""

    def __init__(self) -> None:
        self._points: deque[tuple[float, RunPoint]] = deque(maxlen=MOST_POINTS)

    def __len__(self) -> int:
        return len(self._points)

    def add(self, time: float, point: RunPoint) -> None:
        """Add a point at a time in s. Points from then on belong to a motion that was given up: they are forgotten."""
        if not self._points:
            size = point.state.nbytes + point.inputs.nbytes + point.samples.nbytes + point.history.nbytes + 500
            self._points = deque(maxlen=max(2, min(MOST_POINTS, int(MOST_BYTES / size))))
        while self._points and self._points[-1][0] >= time:
            self._points.pop()
        self._points.append((time, point))

    def clear(self) -> None:
        """Forget everything, as other equations hold from here on."""
        self._points.clear()

    @property
    def span(self) -> tuple[float, float]:
        """The times in s of the first and the last point; zeros if there is none."""
        return (self._points[0][0], self._points[-1][0]) if self._points else (0.0, 0.0)

    def nearest(self, time: float) -> RunPoint | None:
        """The point nearest to a time in s; None if there is none."""
        if not self._points:
            return None
        at = bisect_left(self._points, time, key=lambda one: one[0])
        around = [self._points[index] for index in (at - 1, at) if 0 <= index < len(self._points)]
        return min(around, key=lambda one: abs(one[0] - time))[1]

    def points(self) -> list[tuple[float, RunPoint]]:
        """All points with their times."""
        return list(self._points)
