"""Functions of time that are known by samples: their integrals, derivatives and positive parts.

A function is a polynomial of fifth degree between two samples, through the six samples around. At a time that is given
twice it may jump, and polynomials do not reach beyond it. In a cycle without such times whose ends agree, they reach
around the end, and integrals over equal steps are those of the trapezoidal rule, which for smooth periodic functions
converges faster than any power of the step.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array

SAME = 1e-9  # difference of values at both ends of a cycle, relative to the largest; of places, relative to a step
_POINTS = 6
_BEFORE = _POINTS // 2 - 1  # of them before an interval's start


class SampleTimes:
    """The times (n,) of samples, in s; each may be given twice, where functions jump.

    `cyclic` says that the end of the interval is followed by its start.
    """

    def __init__(self, times: Array, cyclic: bool = True) -> None:
        """Divide the times at jumps.

        :raises InputError: there are fewer than two, they decrease, or a time is given more than twice.
        """
        self.times, self.cyclic = np.asarray(times, dtype=float), cyclic
        steps = np.diff(self.times)
        if len(self.times) < 2 or not np.all(np.isfinite(self.times)) or np.any(steps < 0.0) or not np.any(steps > 0.0):
            raise InputError("the times of a cycle must increase", "Give at least two, in s.")
        if np.any((steps[1:] == 0.0) & (steps[:-1] == 0.0)):
            raise InputError("a time is given more than twice", "A jump has the values before and after it.")
        self.duration = float(self.times[-1] - self.times[0])
        self._left = np.flatnonzero(steps > 0.0)
        self._steps = steps[self._left]
        ends = np.append(np.flatnonzero(steps == 0.0), len(self.times) - 1)
        self._stencils = _stencils(self.times, self._left, ends)
        closed = cyclic and len(ends) == 1 and len(self.times) > _POINTS
        self._around = _cyclic_stencils(self.times, self.duration) if closed else self._stencils

    @property
    def jumps(self) -> NDArray[np.intp]:
        """The rows before jumps."""
        return np.flatnonzero(np.diff(self.times) == 0.0)

    def _pieces(self, values: Array) -> Array:
        """The coefficients (intervals, 6) of the polynomials in s, from 0 to 1 in each interval."""
        values = np.asarray(values, dtype=float)
        joined = abs(values[0] - values[-1]) <= SAME * float(np.max(np.abs(values), initial=0.0))
        rows, weights = self._around if joined else self._stencils
        return np.asarray(np.einsum("ijk,ik->ij", weights, values[rows]))

    def integral(self, values: Array) -> float:
        """The integral over the whole time."""
        return float(self._integrals(values).sum())

    def _integrals(self, values: Array) -> Array:
        return np.asarray(self._pieces(values) @ (1.0 / np.arange(1, _POINTS + 1)) * self._steps)

    def cumulative(self, values: Array) -> Array:
        """The integral (n,) from the start to each time."""
        found = np.zeros(len(self.times))
        found[self._left + 1] = self._integrals(values)
        return np.cumsum(found)

    def mean(self, values: Array) -> float:
        """The mean over time."""
        return self.integral(values) / self.duration

    def rms(self, values: Array) -> float:
        """The root of the mean square."""
        return float(np.sqrt(max(self.mean(np.asarray(values) ** 2), 0.0)))

    def derivative(self, values: Array) -> Array:
        """The derivative (n,) at each time: the mean of those of the polynomials on both sides."""
        pieces = self._pieces(values)
        total, count = np.zeros(len(self.times)), np.zeros(len(self.times))
        starts, ends = pieces[:, 1] / self._steps, pieces @ np.arange(_POINTS) / self._steps
        for rows, slopes in ((self._left, starts), (self._left + 1, ends)):
            np.add.at(total, rows, slopes)
            np.add.at(count, rows, 1.0)
        return total / np.maximum(count, 1.0)

    def positive_part(self, values: Array) -> float:
        """The integral of max(value, 0); changes of sign are located on the polynomials."""
        values = np.asarray(values, dtype=float)
        pieces, integrals = self._pieces(values), self._integrals(values)
        first, last = values[self._left], values[self._left + 1]
        total = float(integrals[(first >= 0.0) & (last >= 0.0)].sum())
        for row in np.flatnonzero(first * last < 0.0):
            root = _root(pieces[row])
            before = float(np.polyval(np.polyint(pieces[row][::-1]), root)) * self._steps[row]
            total += before if first[row] > 0.0 else float(integrals[row]) - before
        return total

    def sign_changes(self, values: Array) -> list[tuple[int, float]]:
        """Where the sign changes: after a row, at a part s of the way to the next one; at samples of zero, s is 0."""
        values = np.asarray(values, dtype=float)
        pieces, before, after = self._pieces(values), values[self._left], values[self._left + 1]
        roots = {int(self._left[i]): _root(pieces[i]) for i in np.flatnonzero(before * after < 0.0)}
        at_rows = {row + round(s) for row, s in roots.items() if min(s, 1.0 - s) <= SAME}
        zeros = np.flatnonzero(values[1:-1] == 0.0) + 1
        at_rows |= {int(row) for row in zeros if values[row - 1] * values[row + 1] < 0.0}
        ends = {0, len(values) - 1} | {int(row) + side for row in self.jumps for side in (0, 1)}
        between = [(row, s) for row, s in roots.items() if min(s, 1.0 - s) > SAME]
        return sorted([*between, *((row, 0.0) for row in at_rows - ends)])

    def with_times_twice(self, places: Sequence[tuple[int, float]], values: Array) -> Array:
        """The values with two more rows at each place, as `sign_changes` gives them; one more where s is 0."""
        values = np.asarray(values, dtype=float)
        pieces, intervals = self._pieces(values), {int(row): number for number, row in enumerate(self._left)}
        rows, added = list[int](), list[float]()
        for row, s in places:
            if s == 0.0:
                rows.append(row + 1)
                added.append(float(values[row]))
            else:
                rows += [row + 1] * 2
                added += [float(np.polyval(pieces[intervals[row]][::-1], s))] * 2
        return np.insert(values, rows, added)

    def signs(self, values: Array) -> Array:
        """The sign (n,) of each value; zeros at jumps and ends have that of the value beside them, as after a split."""
        found = np.sign(values)
        jumps = np.diff(self.times) == 0.0
        firsts, lasts = np.append(True, jumps), np.append(jumps, True)
        after, before = np.append(found[1:], 0.0), np.append(0.0, found[:-1])
        return np.where(found != 0.0, found, np.where(firsts, after, np.where(lasts, before, 0.0)))

    def extremes_of_integral(self, values: Array) -> tuple[float, float]:
        """The least and the greatest value of the integral from the start, also between samples."""
        values = np.asarray(values, dtype=float)
        pieces, running = self._pieces(values), self.cumulative(values)
        found = [float(running.min()), float(running.max())]
        for row in np.flatnonzero(values[self._left] * values[self._left + 1] < 0.0):
            part = float(np.polyval(np.polyint(pieces[row][::-1]), _root(pieces[row])))
            found.append(float(running[self._left[row]]) + part * float(self._steps[row]))
        return min(found), max(found)


def _stencils(times: Array, left: NDArray[np.intp], ends: NDArray[np.intp]) -> tuple[NDArray[np.intp], Array]:
    """For each interval, the rows (6,) of its polynomial, and the weights (6, 6) of their values in its coefficients.

    Between jumps that have less than six samples, the degree is lower, and the last rows repeat without weight.
    """
    end = ends[np.searchsorted(ends, left + 1)]
    starts = np.append(0, ends[:-1] + 1)
    start = starts[np.searchsorted(ends, left + 1)]
    count = np.minimum(end - start + 1, _POINTS)
    first = np.clip(left - _BEFORE, start, end - count + 1)
    rows = np.asarray(first[:, None] + np.minimum(np.arange(_POINTS), count[:, None] - 1), dtype=np.intp)
    steps = times[left + 1] - times[left]
    places = (times[rows] - times[left, None]) / steps[:, None]
    weights = np.zeros((len(left), _POINTS, _POINTS))
    for number in np.unique(count):
        chosen = np.flatnonzero(count == number)
        matrices = places[chosen, :number, None] ** np.arange(number)
        weights[chosen, :number, :number] = np.linalg.inv(matrices)
    return rows, weights


def _cyclic_stencils(times: Array, duration: float) -> tuple[NDArray[np.intp], Array]:
    """The same in a cycle whose last sample is its first one again."""
    count = len(times) - 1
    numbers = np.arange(count)[:, None] + np.arange(-_BEFORE, _POINTS - _BEFORE)
    turns, rows = numbers // count, np.asarray(numbers % count, dtype=np.intp)
    steps = np.diff(times)
    places = (times[rows] + duration * turns - times[:-1, None]) / steps[:, None]
    return rows, np.asarray(np.linalg.inv(places[:, :, None] ** np.arange(_POINTS)), dtype=float)


def _root(piece: Array) -> float:
    """Where a polynomial with different signs at 0 and 1 is zero."""
    low, high = 0.0, 1.0
    positive = piece[0] > 0.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        if (np.polyval(piece[::-1], middle) > 0.0) == positive:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)
