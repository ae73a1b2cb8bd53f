"""Effort commands: checked as a whole, then clamped to the effort limits of the joints."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from mbd_sim.errors import CommandError, listed, nearest, printable, quoted
from mbd_sim.geometry.pose import Array


class UnknownJointError(CommandError):
    """A command for a joint that does not exist. The nearest name is searched only when the text is needed."""

    def __init__(self, name: str, valid: Iterable[str]) -> None:
        super().__init__(name)
        self.name, self._valid = name, valid

    def __str__(self) -> str:
        remedy = nearest(self.name, self._valid) or "No joint of this mechanism accepts efforts."
        return printable(f"there is no joint '{self.name}'. {remedy}")


class EffortMap:
    """Commands by order or by name, as one effort (N or N·m) for each degree of freedom."""

    def __init__(self, names: Sequence[str], limits: Array, driven: Sequence[str] = ()) -> None:
        """Efforts of `names`, with absolute values up to `limits` (nv,); `driven` coordinates take no effort."""
        self.names, self._driven = tuple(names), frozenset(driven)
        self._index = {name: index for index, name in enumerate(self.names)}
        self._count = len(self.names)
        self.limit(limits)

    def limit(self, limits: Array) -> None:
        """Set the largest absolute values (nv,) of the efforts from now on."""
        self.limits = limits
        self._bounds = np.minimum(limits, sys.float_info.max).tolist()

    def within(self, efforts: Any) -> Sequence[float] | None:
        """The efforts if they are an array, a list or a tuple of one number each, within all limits; None otherwise.

        This takes a tenth of the time of `merged` and `clamped`, which say what is wrong or do what is necessary.
        """
        kind = type(efforts)
        if kind is np.ndarray:
            efforts = efforts.tolist()
        elif kind is not list and kind is not tuple:
            return None
        if len(efforts) != self._count:
            return None
        for value, bound in zip(efforts, self._bounds):  # noqa: B905  # the check of their lengths costs more
            if type(value) is not float or not -bound <= value <= bound:
                return None
        values: Sequence[float] = efforts
        return values

    def merged(self, current: Array, efforts: Mapping[str, float] | Sequence[float] | Array) -> Array:
        """The efforts (nv,) after a command; those that it does not name stay as in `current`.

        :raises CommandError: wrong length, an unknown name, or a value that is not a finite number.
        """
        merged = current.copy()
        try:
            given = efforts.values() if isinstance(efforts, Mapping) else efforts
            if texts := [value for value in given if isinstance(value, str | bytes)]:
                raise TypeError(f"{quoted(texts[0])} is a text")
            if isinstance(efforts, Mapping):
                for name, value in efforts.items():
                    merged[self._index_of(name)] = value
            elif len(efforts) != len(self.names):
                raise CommandError(
                    f"{_counted(len(self.names), 'effort')} expected, but {len(efforts)} given. "
                    f"Give one for each of: {listed(self.names)}."
                )
            else:
                merged[:] = efforts
        except (TypeError, ValueError) as error:
            if isinstance(error, CommandError):
                raise
            raise CommandError(f"an effort is not a number ({error}). Give numbers.") from error
        if not np.all(np.isfinite(merged)):
            bad = [name for name, value in zip(self.names, merged, strict=True) if not math.isfinite(value)]
            raise CommandError(f"the effort of {listed(bad)} is not finite. Give finite numbers.")
        return merged

    def clamped(self, efforts: Array) -> Array:
        """The efforts within the effort limits of the joints."""
        return np.clip(efforts, -self.limits, self.limits)

    def require(self, name: str) -> None:
        """Check that a joint exists and is not driven.

        :raises CommandError: it does not exist, or is driven.
        """
        self._index_of(name)

    def _index_of(self, name: str) -> int:
        if name in self._driven:
            raise CommandError(
                f"joint '{name}' is driven: its drive prescribes the motion, so it accepts no effort. "
                "Command another joint."
            )
        if name not in self._index:
            raise UnknownJointError(name, self._index)
        return self._index[name]


def _counted(number: int, noun: str) -> str:
    """`1 effort`, `2 efforts`."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
