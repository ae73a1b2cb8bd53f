"""Samples of the numbers of a mechanism for several values of the parameters of its file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbd_sim.dynamics.symbolic_parameters import EquationData, StructureError, equation_data, varying_parameters
from mbd_sim.errors import MbdSimError, MechanismError
from mbd_sim.geometry.batch import Batch
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.symbolic.number_formulas import MAX_TERMS, Samples

Numbers = Callable[[Mechanism], Array]
NumbersOfVariants = Callable[[Mechanism, NDArray[np.bool_]], Array]
Changed = Callable[[Mapping[str, Any]], Mechanism]
SLICE, JOINT = 12, MAX_TERMS + 16  # samples
RANGES = (2.0, 1.3, 1.05)  # factors up to which parameters vary
OTHER = 0.4  # the largest value of a parameter that is zero
TRIES = 8


@dataclass(frozen=True, eq=False)
class NumberSamples:
    """The `keys` that can be symbols, their values `base`, and samples; `built_in` are the others, with the reason."""

    keys: tuple[str, ...]
    base: Array
    samples: Samples
    built_in: Mapping[str, str]


def number_samples(
    changed: Changed,
    start: Mapping[str, float | None],
    numbers: Numbers,
    numbers_of_variants: NumbersOfVariants | None = None,
) -> NumberSamples:
    """Sample the numbers of a mechanism.

    :param changed: gives the mechanism with other values at keys of its file, also with batches of values.
    :param start: the values that it has at the keys.
    :param numbers: gives the numbers (n,) of a mechanism.
    :param numbers_of_variants: gives those (k, n) of k variants, from the mechanism with batches and the `valid` of
        these. With it, all samples are computed at once where that is possible; they have the same bits.
    """
    kept, built_in, unchanged = list[str](), dict[str, str](), changed({})
    data, given = equation_data(unchanged), numbers(unchanged)
    for key, value in start.items():
        reason = _reason(changed, data, lambda other: not np.array_equal(numbers(other), given), key, value)
        if reason is None:
            kept.append(key)
        elif reason:
            built_in[key] = reason
    base = np.array([start[key] or 0.0 for key in kept])
    random = np.random.default_rng(3)
    for factor in RANGES if kept else ():
        sampler = _Sampler(changed, kept, base, numbers, numbers_of_variants, random, factor)
        if (samples := sampler.at_once() or sampler.one_by_one()) is not None:
            return NumberSamples(tuple(kept), base, samples, built_in)
    built_in |= dict.fromkeys(kept, "no other values fit")
    one = numbers(changed({}))
    return NumberSamples((), np.zeros(0), Samples((), (np.zeros((1, 0)), one[None, :])), built_in)


def _reason(
    changed: Changed, data: EquationData, differs: Callable[[Mechanism], bool], key: str, value: float | None
) -> str | None:
    """Why a key cannot be a symbol; empty if no number depends on it, None if it can be one."""
    if value is None:
        return "it is not a number"
    for factor in RANGES[1:]:
        try:
            other = changed({key: value / factor if value else OTHER})
            found = varying_parameters(data, [equation_data(other)])
        except MechanismError:
            continue
        except StructureError as error:
            return str(error)
        return None if len(found.base) or differs(other) else ""
    return "no other values fit"


@dataclass(frozen=True, eq=False)
class _Sampler:
    changed: Changed
    keys: Sequence[str]
    base: Array
    numbers: Numbers
    numbers_of_variants: NumbersOfVariants | None
    random: np.random.Generator
    factor: float

    def one_by_one(self) -> Samples | None:
        """A slice along each parameter, and samples of all of them; None where too few values fit."""
        generic = self._draw(1)[0]
        if not len(generic):
            return None
        slices = [self._draw(SLICE, free, generic[0]) for free in np.eye(len(self.keys), dtype=bool)]
        joint = self._draw(JOINT)
        fewest = min(len(parameters) for parameters, _ in (*slices, joint))
        return Samples(slices, joint) if fewest >= SLICE else None

    def at_once(self) -> Samples | None:
        """The samples of `one_by_one`, built as one mechanism with batches; None where one has to be built by itself.

        The first and the last are also built by themselves, to be compared.
        """
        if self.numbers_of_variants is None:
            return None
        state = self.random.bit_generator.state
        generic = self._values()
        rows = [generic]
        for free in np.eye(len(self.keys), dtype=bool):
            rows += [np.where(free, self._values(), generic) for _ in range(SLICE)]
        rows += [self._values() for _ in range(JOINT)]
        table, valid = np.array(rows), np.ones(len(rows), dtype=np.bool_)
        columns = {key: Batch(column.copy(), valid) for key, column in zip(self.keys, table.T, strict=True)}
        try:
            found = self.numbers_of_variants(self.changed(columns), valid)
            fits = np.all(valid) and all(np.array_equal(found[i], self._numbers_at(table[i])) for i in (0, -1))
        except (MbdSimError, TypeError, ValueError, LookupError, AttributeError, ArithmeticError):
            fits = False  # what does not fit a batch is found one by one
        if not fits:
            self.random.bit_generator.state = state
            return None
        ends = np.arange(1, len(rows) - JOINT + 1, SLICE)
        slices = [(table[first : first + SLICE], found[first : first + SLICE]) for first in ends[:-1]]
        return Samples(slices, (table[-JOINT:], found[-JOINT:]))

    def _numbers_at(self, values: Array) -> Array:
        return self.numbers(self.changed(dict(zip(self.keys, values.tolist(), strict=True))))

    def _values(self) -> Array:
        """Random values of all parameters."""
        spread = self.factor ** self.random.uniform(-1.0, 1.0, len(self.base))
        other = self.random.uniform(OTHER / 4.0, OTHER, len(self.base))
        return np.where(self.base == 0.0, other, self.base * spread)

    def _draw(self, count: int, free: Array | None = None, at: Array | None = None) -> tuple[Array, Array]:
        """Parameters and numbers; fewer than `count` samples where the values do not fit.

        :param free: the parameters that vary; the others are those in `at`.
        """
        parameters, found = [], []
        for _ in range(TRIES * count):
            values = self._values()
            if free is not None and at is not None:
                values = np.where(free, values, at)
            try:
                numbers = self._numbers_at(values)
            except MechanismError:
                continue
            parameters.append(values)
            found.append(numbers)
            if len(found) == count:
                break
        width = len(self.base)
        return np.array(parameters).reshape(-1, width), np.array(found).reshape(len(found), -1)
