"""The numbers of a mechanism's records as symbols, so that one set of equations serves many values.

A number is known by its path through the records. `numbers_of` reads those that can be symbols, and the rest that the
equations depend on and that can not, such as directions of axes and tables of springs; `with_symbols` puts symbols in
their place.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from mbd_sim.dynamics.links import Link, links
from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.mechanism import constraints as c
from mbd_sim.mechanism.expression import TimeExpression
from mbd_sim.mechanism.force_elements import Spring
from mbd_sim.mechanism.laws import Expressed, Friction, GreenStrain, Linear, PowerLaw
from mbd_sim.mechanism.records import (
    Attachment,
    Joint,
    Limits,
    Mechanism,
    Part,
)

Path = tuple[str | int, ...]

# Of each record the fields whose numbers can be symbols; records not named here have none.
_SYMBOLIC: Mapping[type, tuple[str, ...]] = {
    Mechanism: ("gravity",),
    Part: ("mass", "center"),
    Link: ("inertia",),
    Pose: ("position", "rotation"),
    Joint: ("stiffness", "rest", "damping"),
    Limits: ("lower", "upper", "stiffness", "damping"),
    Linear: ("stiffness",),
    GreenStrain: ("stiffness", "length"),
    PowerLaw: ("coefficient",),
    Friction: ("coulomb", "static", "stribeck_velocity", "viscous", "regularization"),
    Spring: ("length", "damping", "mass"),
    Attachment: ("point",),
    TimeExpression: ("names",),
    c.Rolling: ("radius",),
}
# Of each record the fields that the equations do not read.
_UNREAD: Mapping[type, tuple[str, ...]] = {
    Mechanism: ("name", "description", "parameters", "source", "method", "step", "ground_points", "tree"),
    Part: ("inertia", "points", "shapes"),  # of a link the inertia is its own
    Joint: ("position", "velocity", "held", "held_speeds", "effort_limit"),
    Link: ("type", "q", "u"),
}


@dataclass(frozen=True, eq=False)
class Numbers:
    """What the equations of a mechanism depend on: `free` numbers by path, and what is `fixed` in them."""

    paths: tuple[Path, ...]
    free: Array
    fixed: Mapping[Path, Any]


@dataclass(frozen=True, eq=False)
class Values:
    """Which numbers are symbols: those at `places` of all free ones are the values (n,) at `columns`.

    Numbers that are always the same, as the two ends of one length, share a value.
    """

    numbers: Numbers
    places: NDArray[np.intp]
    columns: NDArray[np.intp]
    base: Array

    @cached_property
    def symbols(self) -> ca.SX:
        """The symbols (n,)."""
        return ca.SX.sym("p", len(self.base))

    def among(self, numbers: Numbers) -> Array:
        """The values (n,) of a mechanism that is known to differ in them only."""
        values = self.base.copy()
        values[self.columns] = numbers.free[self.places]
        return values

    def of(self, numbers: Numbers) -> Array:
        """The values (n,) of another mechanism of the same shape.

        :raises UnvariedError: it differs in what is not a value.
        """
        if numbers.paths != self.numbers.paths:
            raise UnvariedError("its parts, joints or forces are others")
        for path, kept in numbers.fixed.items():
            if not _same(kept, self.numbers.fixed.get(path)):
                raise UnvariedError(f"{_named(path)} differs, which is built into the equations")
        values = self.among(numbers)
        expected = self.numbers.free.copy()
        expected[self.places] = values[self.columns]
        if len(off := np.flatnonzero(expected != numbers.free)):
            raise UnvariedError(f"{_named(numbers.paths[off[0]])} differs, which is not among the values")
        return values


class UnvariedError(ValueError):
    """A mechanism differs from another one by more than values."""


def numbers_of(mechanism: Mechanism) -> Numbers:
    """The numbers that the equations depend on."""
    paths: list[Path] = []
    free: list[float] = []
    fixed: dict[Path, Any] = {}
    for path, leaf, symbolic in _leaves((mechanism, tuple(links(mechanism))), (), False):
        if not symbolic:
            fixed[path] = leaf
        elif isinstance(leaf, np.ndarray):
            paths += [(*path, index) for index in range(leaf.size)]
            free += leaf.ravel().tolist()
        else:
            paths.append(path)
            free.append(float(leaf))
    return Numbers(tuple(paths), np.array(free), fixed)


def values_among(base: Numbers, others: Sequence[Numbers]) -> Values:
    """The values in which some mechanisms differ from each other.

    :raises UnvariedError: they differ in what cannot be a value.
    """
    for other in others:
        if other.paths != base.paths:
            raise UnvariedError("its parts, joints or forces are others")
        for path, kept in other.fixed.items():
            if not _same(kept, base.fixed.get(path)):
                raise UnvariedError(f"{_named(path)} differs, which is built into the equations")
    table = np.array([base.free, *(other.free for other in others)])
    places = np.flatnonzero(np.any(table != table[0], axis=0))
    alike: dict[bytes, int] = {}
    columns = [alike.setdefault(table[:, place].tobytes(), len(alike)) for place in places]
    first = np.zeros(len(alike))
    first[columns] = base.free[places]
    return Values(base, places, np.array(columns, dtype=np.intp), first)


def with_symbols(mechanism: Mechanism, values: Values) -> tuple[Mechanism, list[Link]]:
    """The mechanism and its links, with symbols for the values."""
    chain = tuple(links(mechanism))
    if not len(values.base):
        return mechanism, list(chain)
    symbols = {
        values.numbers.paths[place]: values.symbols[int(column)]
        for place, column in zip(values.places, values.columns, strict=True)
    }
    prefixes = {path[:length] for path in symbols for length in range(len(path) + 1)}
    mechanism, chain = _replaced((mechanism, chain), (), symbols, prefixes)
    return mechanism, list(chain)


def _leaves(record: Any, path: Path, symbolic: bool) -> Iterator[tuple[Path, Any, bool]]:
    if isinstance(record, Expressed):  # its potential is integrated beforehand
        yield path, record, False
    elif dataclasses.is_dataclass(record) and not isinstance(record, type):
        kind = type(record)
        for field in dataclasses.fields(record):
            if field.name not in _UNREAD.get(kind, ()):
                can = field.name in _SYMBOLIC.get(kind, ())
                yield from _leaves(getattr(record, field.name), (*path, field.name), can)
    elif isinstance(record, Mapping):
        for key, value in record.items():
            yield from _leaves(value, (*path, key), symbolic)
    elif isinstance(record, tuple | list):
        for index, value in enumerate(record):
            yield from _leaves(value, (*path, index), symbolic)
    else:
        yield path, record, symbolic and isinstance(record, float | int | np.ndarray)


def _replaced(record: Any, path: Path, symbols: Mapping[Path, ca.SX], prefixes: set[Path]) -> Any:
    if path not in prefixes:
        return record
    if path in symbols:
        return symbols[path]
    if isinstance(record, np.ndarray):
        matrix = ca.SX(ca.DM(record))
        for index, place in enumerate(np.ndindex(record.shape)):
            if (symbol := symbols.get((*path, index))) is not None:
                matrix[place] = symbol
        return matrix
    if isinstance(record, Mapping):
        return {key: _replaced(value, (*path, key), symbols, prefixes) for key, value in record.items()}
    if isinstance(record, tuple):
        return tuple(_replaced(value, (*path, index), symbols, prefixes) for index, value in enumerate(record))
    changed = {
        field.name: _replaced(getattr(record, field.name), (*path, field.name), symbols, prefixes)
        for field in dataclasses.fields(record)
        if (*path, field.name) in prefixes
    }
    return dataclasses.replace(record, **changed)


def _same(one: Any, other: Any) -> bool:
    return bool(np.array_equal(one, other)) if isinstance(one, np.ndarray) else bool(one == other)


def _named(path: Path) -> str:
    """A path in words: where in the records it stands."""
    return ".".join(str(step) for step in path[1:])
