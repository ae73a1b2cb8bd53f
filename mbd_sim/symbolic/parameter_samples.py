"""Samples of the numbers of a mechanism for several values of the parameters of its file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mbd_sim.dynamics.symbolic_parameters import EquationData, StructureError, equation_data, varying_parameters
from mbd_sim.errors import MechanismError
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.symbolic.number_formulas import MAX_TERMS, Samples

Numbers = Callable[[Mechanism], Array]
Changed = Callable[[Mapping[str, float]], Mechanism]
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


def number_samples(changed: Changed, start: Mapping[str, float | None], numbers: Numbers) -> NumberSamples:
    """Sample the numbers of a mechanism.

    :param changed: gives the mechanism with other values at keys of its file.
    :param start: the values that it has at the keys.
    :param numbers: gives the numbers (n,) of a mechanism.
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
        values = _Sampler(changed, kept, base, numbers, random, factor)
        generic = values.draw(1)[0]
        slices = [values.draw(SLICE, np.arange(len(kept)) == index, generic[0]) for index in range(len(kept))]
        joint = values.draw(JOINT)
        if min(len(parameters) for parameters, _ in (*slices, joint)) >= SLICE:
            return NumberSamples(tuple(kept), base, Samples(slices, joint), built_in)
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
    random: np.random.Generator
    factor: float

    def draw(self, count: int, free: Array | None = None, at: Array | None = None) -> tuple[Array, Array]:
        """Parameters and numbers; fewer than `count` samples where the values do not fit.

        :param free: the parameters that vary; the others are those in `at`.
        """
        parameters, found = [], []
        for _ in range(TRIES * count):
            spread = self.factor ** self.random.uniform(-1.0, 1.0, len(self.base))
            other = self.random.uniform(OTHER / 4.0, OTHER, len(self.base))
            values = np.where(self.base == 0.0, other, self.base * spread)
            if free is not None and at is not None:
                values = np.where(free, values, at)
            try:
                changes = dict(zip(self.keys, values.tolist(), strict=True))
                numbers = self.numbers(self.changed(changes))
            except MechanismError:
                continue
            parameters.append(values)
            found.append(numbers)
            if len(found) == count:
                break
        width = len(self.base)
        return np.array(parameters).reshape(-1, width), np.array(found).reshape(len(found), -1)
