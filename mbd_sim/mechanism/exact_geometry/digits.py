"""How precisely the lengths and directions of a mechanism are written.

A number with four to nine significant digits is rounded at its last one, and one with three is as precise as the
others: in a file that writes 0.1414, 0.173 is 0.1730. Shorter ones, such as 0.25 or 0, are exact, and longer ones too.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from decimal import Decimal
from typing import Any

import numpy as np

from mbd_sim.base.geometry.pose import Array

PLAIN, FEWEST, MOST = 2, 4, 9  # significant digits of a number that is exact, and of one that is rounded


GEOMETRY = ("rotate", "axis", "direction", "normal")
ANGLE = re.compile(r"\s*([-+.\deE]+)\s*(deg)?\s*")


def half_unit_of_angles(data: Any) -> float:
    """The largest half unit of the last digits of what a file's data write as directions and orientations, in rad."""
    return max((0.5 * unit for key in GEOMETRY for value in _under(key, data) for unit in _units(value)), default=0.0)


def _under(key: str, data: Any) -> Iterator[Any]:
    """The values of a key wherever it is in a file's data."""
    if isinstance(data, Mapping):
        for name, value in data.items():
            yield from [value] if name == key else _under(key, value)
    elif isinstance(data, list | tuple):
        for value in data:
            yield from _under(key, value)


def _units(value: Any) -> Iterator[float]:
    """The units of the last digits of the rounded numbers in a value, in rad."""
    if isinstance(value, Mapping):
        value = list(value.values())
    if isinstance(value, list | tuple):
        for one in value:
            yield from _units(one)
        return
    found = ANGLE.fullmatch(str(value))
    try:
        count, place = _written(float(found[1])) if found else (0, 0)
    except ValueError:  # an expression
        return
    if found and FEWEST <= count <= MOST:
        yield 10.0**place * (np.pi / 180.0 if found[2] else 1.0)


class Digits:
    """Half units of the last digits of numbers."""

    def __init__(self, numbers: Iterable[float]) -> None:
        written = [found for number in numbers if FEWEST <= (found := _written(number))[0] <= MOST]
        self._significant = max((count for count, _ in written), default=0)
        self._last = min((place for _, place in written), default=0)

    def __bool__(self) -> bool:
        return bool(self._significant)

    def half_units(self, numbers: Array) -> Array:
        """Half a unit of the last digit of each number; 0 if it is exact."""
        return np.array([self._half_unit(float(number)) for number in numbers])

    def _half_unit(self, number: float) -> float:
        count, place = _written(number)
        if not self or count > MOST:
            return 0.0
        if count <= PLAIN:
            return 0.0
        if count < FEWEST:
            place = min(place, max(self._last, int(np.floor(np.log10(abs(number)))) + 1 - self._significant))
        return 0.5 * 10.0**place


def _written(number: float) -> tuple[int, int]:
    """The count of significant digits of a number, and the power of ten of the last one."""
    _, digits, exponent = Decimal(f"{number:.12g}").normalize().as_tuple()
    return len(digits) if number else 0, int(exponent)
