"""What a session keeps for its pages: the frame that they show, points to wind back to, and samples for plots."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.pictures.shapes.touching import Touching
from mbd_sim.simulation.run.run_point import RunPoint

MOST_SAMPLES = 3600
MOST_BYTES = 64e6
MOST_POINTS = 5400  # three minutes at 30 points a second


@dataclass(frozen=True, eq=False)
class Frame:
    """What pages show: all of one moment.

    `generation` counts the mechanisms; `mechanism` has the present live values. `poses` (parts, 12) are as in
    `Model.pose_array`, `contacts` are those that are closed; `watched` is what the session was asked to watch, by
    name. `q` (nq,) are the coordinates, `positions` (nv,) those of `coordinate_names`. `pull` are the held point (3,),
    the pointer (3,), the force (3,) and the largest one in N, if something is held. `rate` is how many seconds are
    simulated in one, `speed` how many were asked for. `values` are those of the sliders by key, in SI units.
    """

    generation: int
    number: int
    mechanism: Mechanism
    time: float
    running: bool
    rate: float
    speed: float
    poses: Array
    contacts: Touching
    energies: Array
    q: Array
    positions: Array
    speeds: Array
    watched: Mapping[str, Any]
    pull: tuple[Array, Array, Array, float] | None
    span: tuple[float, float]
    message: str
    recording: str
    values: Mapping[str, float]


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
    def span(self) -> tuple[float, float] | None:
        """The times in s of the first and the last point; None if there is none."""
        return (self._points[0][0], self._points[-1][0]) if self._points else None

    def nearest(self, time: float) -> RunPoint | None:
        """The point nearest to a time in s; None if there is none."""
        if not self._points:
            return None
        at = bisect_left(self._points, time, key=lambda one: one[0])
        around = [self._points[index] for index in (at - 1, at) if 0 <= index < len(self._points)]
        return min(around, key=lambda one: abs(one[0] - time))[1]

    def before(self, time: float) -> RunPoint | None:
        """The last point before a time in s; None if there is none."""
        at = bisect_left(self._points, time, key=lambda one: one[0])
        return self._points[at - 1][1] if at else None

    def points(self) -> list[tuple[float, RunPoint]]:
        """All points with their times."""
        return list(self._points)


@dataclass
class Samples:
    """What the plots show: rows (time, energies, positions, speeds, reading) in the order of time."""

    rows: deque[Array] = field(default_factory=lambda: deque(maxlen=MOST_SAMPLES))

    def add(self, row: Array) -> None:
        """Add a row; later ones belong to a motion that was given up."""
        while self.rows and self.rows[-1][0] >= row[0]:
            self.rows.pop()
        if self.rows and len(self.rows[-1]) != len(row):
            self.rows.clear()
        self.rows.append(row)

    def table(self, most: int) -> Array:
        """At most `most` of the rows (n, width), evenly chosen."""
        rows = list(self.rows)
        stride = max(1, math.ceil(len(rows) / most))
        return np.array(rows[::-1][::stride][::-1])
