"""Effort commands: checked as a whole, then clamped to the effort limits of the joints.

Compiled code does the same for arrays, lists and tuples that need no error message: see `bounded_writer`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from mbd_sim.errors import CommandError, counted, listed, nearest, printable, quoted
from mbd_sim.geometry.pose import Array
from mbd_sim.short_repr import short_repr


class UnknownJointError(CommandError):
    """A command for a joint that does not exist. The nearest name is searched only when the text is needed."""

    def __init__(self, name: str, valid: Iterable[str]) -> None:
        super().__init__(f"there is no joint '{name}'")
        self.name, self._valid = name, valid

    def __str__(self) -> str:
        remedy = nearest(self.name, self._valid) or "No joint of this mechanism accepts efforts."
        return printable(f"{self.message}. {remedy}")


class EffortMap:
    """Commands by order or by name, as one effort (N or N·m) for each degree of freedom."""

    __repr__ = short_repr

    def __init__(self, names: Sequence[str], limits: Array, driven: Sequence[str] = ()) -> None:
        """Efforts of `names`, with absolute values up to `limits` (nv,); `driven` coordinates take no effort."""
        self.names, self._driven = tuple(names), frozenset(driven)
        self._index = {name: index for index, name in enumerate(self.names)}
        self.limits = np.array(limits, dtype=float)

    def limit(self, limits: Array) -> None:
        """Set the largest absolute values (nv,) of the efforts from now on, in place: compiled code reads them."""
        self.limits[:] = limits

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
                    f"{counted(len(self.names), 'effort')} expected, but {len(efforts)} given",
                    f"Give one for each of: {listed(self.names)}.",
                )
            else:
                merged[:] = efforts
        except (TypeError, ValueError) as error:
            if isinstance(error, CommandError):
                raise
            raise CommandError(f"an effort is not a number ({error})", "Give numbers.") from error
        if not np.all(np.isfinite(merged)):
            bad = [name for name, value in zip(self.names, merged, strict=True) if not math.isfinite(value)]
            raise CommandError(f"the effort of {listed(bad)} is not finite", "Give finite numbers.")
        return merged

    def clamped(self, efforts: Array) -> Array:
        """The efforts within the effort limits of the joints."""
        clamped: Array = np.copysign(np.minimum(np.abs(efforts), self.limits), efforts)
        return clamped

    def require(self, name: str) -> None:
        """Check that a joint exists and is not driven.

        :raises CommandError: it does not exist, or is driven.
        """
        self._index_of(name)

    def _index_of(self, name: str) -> int:
        if name in self._driven:
            raise CommandError(
                f"joint '{name}' is driven: its drive prescribes the motion, so it accepts no effort",
                "Command another joint.",
            )
        if name not in self._index:
            raise UnknownJointError(name, self._index)
        return self._index[name]
