"""The tables of a mechanism file, which expressions read by name."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated

from pydantic import Field, model_validator

from mbd_sim.errors import InputError, counted
from mbd_sim.mechanism.tables import Curve, Surface, Table
from mbd_sim.mechanism_file.quantity import AnyNumber, Quantity
from mbd_sim.mechanism_file.schema.base_schema import Spec

MAX_POINTS, MAX_NODES = 1000, 2500  # of one and of two variables: the kernel compares with each of them
CLOSED = 1e-9  # relative difference of lengths and values that count as equal


class TableSpec(Spec):
    """A function through given points: `points` of one variable x, or `values` at the grid points of `x` and `y`.

    With a `period` it repeats itself. Values may have units; they are in SI units then.
    """

    points: list[tuple[AnyNumber, AnyNumber]] | None = Field(None, description="[x, value] in order of increasing x")
    period: Annotated[float, Quantity(None, above=0)] | None = Field(None, description="of a table of one variable")
    x: list[AnyNumber] | None = None
    y: list[AnyNumber] | None = None
    values: list[list[AnyNumber]] | None = Field(None, description="a row for each x, with a value for each y")

    @model_validator(mode="after")
    def _one_form(self) -> TableSpec:
        grid = [key for key in ("x", "y", "values") if getattr(self, key) is not None]
        if (self.points is not None) == bool(grid) or (grid and len(grid) < 3):
            raise InputError("gives neither a curve nor a surface", "Give points, or x, y and values.")
        if self.points is not None:
            _require_increasing("points", [x for x, _ in self.points], MAX_POINTS)
            if self.period is not None:
                self._require_one_period([x for x, _ in self.points], self.period)
            return self
        if self.period is not None:
            raise InputError("a table of two variables has no period", "Remove it, and use mod(x, period).")
        assert self.x is not None and self.y is not None and self.values is not None
        _require_increasing("x", self.x, MAX_NODES)
        _require_increasing("y", self.y, MAX_NODES)
        if len(self.x) * len(self.y) > MAX_NODES:
            raise InputError(f"has {len(self.x) * len(self.y)} values", f"Give at most {MAX_NODES}.")
        if len(self.values) != len(self.x) or any(len(row) != len(self.y) for row in self.values):
            message = f"values is not {counted(len(self.x), 'row')} of {counted(len(self.y), 'number')}"
            raise InputError(message, "Give a row for each x, with a value for each y.")
        return self

    def _require_one_period(self, x: list[float], period: float) -> None:
        assert self.points is not None
        extent, (first, last) = x[-1] - x[0], (self.points[0][1], self.points[-1][1])
        if extent > period * (1.0 + CLOSED):
            raise InputError(f"the points extend over {extent:g}, more than the period {period:g}", "Remove some.")
        size = max(abs(value) for _, value in self.points)
        if extent >= period * (1.0 - CLOSED) and abs(last - first) > CLOSED * size:
            message = f"begins with {first:g} and ends with {last:g}, a period later"
            raise InputError(message, "Give the same value at both ends, or remove the last point.")

    @property
    def table(self) -> Table:
        """The function."""
        if self.points is None:
            assert self.x is not None and self.y is not None and self.values is not None
            return Surface(tuple(self.x), tuple(self.y), tuple(map(tuple, self.values)))
        points = list(self.points)
        if self.period is not None:  # the end of the period is exact, and has the value of its beginning
            if points[-1][0] - points[0][0] >= self.period * (1.0 - CLOSED):
                points.pop()
            points.append((points[0][0] + self.period, points[0][1]))
        x, values = zip(*points, strict=True)
        return Curve(x, values, self.period)


def _require_increasing(key: str, x: list[float], most: int) -> None:
    if not 2 <= len(x) <= most:
        raise InputError(f"{key} has {len(x)} entries", f"Give between 2 and {most}.")
    for before, after in pairwise(x):
        if after <= before:
            raise InputError(f"in {key}, {after:g} comes after {before:g}", "Sort them by increasing x.")
