"""Variants of a mechanism that differ in the same numbers, built at once: as one, with batches of these numbers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbd_sim.dynamics.coordinate_layout import coordinate_layout
from mbd_sim.dynamics.initial_conditions import given_starts
from mbd_sim.dynamics.symbolic_parameters import EquationData, equation_data, equation_data_of_variants
from mbd_sim.errors import MbdSimError
from mbd_sim.geometry.batch import Batch, of_all
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.mechanism_file.override import with_values

FEWEST = 16  # variants that are worth it


@dataclass(frozen=True, eq=False)
class VariantNumbers:
    """What members need of a variant: its `data`, start coordinates and speeds, and `effort_limits` (nv,).

    `held` (n,) is what actuators hold before the first command: see `numbers_held`.
    """

    data: EquationData
    q: Array
    u: Array
    effort_limits: Array
    held: Array

    def same_as(self, other: VariantNumbers) -> bool:
        """Whether all numbers agree to the last bit."""
        one, two = self.data, other.data
        return (
            one.paths == two.paths
            and one.fixed.keys() == two.fixed.keys()
            and all(np.array_equal(leaf, two.fixed[path]) for path, leaf in one.fixed.items())
            and all(
                a.tobytes() == b.tobytes()
                for a, b in (
                    (one.free, two.free),
                    (self.q, other.q),
                    (self.u, other.u),
                    (self.effort_limits, other.effort_limits),
                    (self.held, other.held),
                )
            )
        )


def numbers_of(mechanism: Mechanism) -> VariantNumbers:
    """The numbers of a variant that is built by itself."""
    q, u = given_starts(mechanism, coordinate_layout(mechanism), 1)
    held = np.array(numbers_held(mechanism), dtype=float)
    return VariantNumbers(equation_data(mechanism), q[0], u[0], mechanism.effort_limits(), held)


def numbers_held(mechanism: Mechanism) -> list[Any]:
    """The start commands of actuators, and the pressures of cylinders: numbers, or batches of them."""
    found: list[Any] = []
    for actuator in mechanism.actuators:
        found += [*actuator.start.values(), *getattr(actuator.motor, "pressures", ())]
    return found


def build_at_once(
    mechanism: Mechanism, changes: Sequence[Any], build: Callable[[int], Mechanism]
) -> list[VariantNumbers | None]:
    """The numbers of all variants; None for those that have to be built by themselves.

    These are the ones that are not valid, and those for which a decision depends on the numbers that differ. The first,
    the middle and the last of the others are also built by themselves: should anything differ, all are None.

    :param changes: of each variant, see `with_values`.
    :param build: builds a variant by its index.
    """
    alone: list[VariantNumbers | None] = [None] * len(changes)
    names = tuple(changes[0])
    if len(changes) < FEWEST or mechanism.contacts or not names:
        return alone
    if not all(tuple(change) == names and all(map(_is_number, change.values())) for change in changes):
        return alone
    table = np.array([[float(value) for value in change.values()] for change in changes])
    valid: NDArray[np.bool_] = np.all(np.isfinite(table), axis=1)
    try:
        batches = {
            name: Batch(np.ascontiguousarray(column), valid) for name, column in zip(names, table.T, strict=True)
        }
        numbers = _numbers(with_values(mechanism, batches), valid)
    except (MbdSimError, TypeError, ValueError, LookupError, AttributeError, ArithmeticError):
        return alone  # what is wrong, or does not fit a batch, is found variant by variant
    if not all(numbers[index].same_as(numbers_of(build(index))) for index in first_middle_last(np.flatnonzero(valid))):
        return alone
    return [one if fits else None for one, fits in zip(numbers, valid.tolist(), strict=True)]


def first_middle_last(indices: NDArray[np.intp]) -> list[int]:
    """The first, the middle and the last of some indices, each once."""
    return sorted({*indices[:1].tolist(), *indices[len(indices) // 2 :][:1].tolist(), *indices[-1:].tolist()})


def _numbers(mechanism: Mechanism, valid: NDArray[np.bool_]) -> list[VariantNumbers]:
    size = len(valid)
    q, u = given_starts(mechanism, coordinate_layout(mechanism), size)
    data = equation_data_of_variants(mechanism, valid)
    limits = of_all(mechanism.effort_limits(), size)
    held = np.array([of_all(number, size) for number in numbers_held(mechanism)]).reshape(-1, size).T
    return [VariantNumbers(*row) for row in zip(data, q, u, limits, held, strict=True)]


def _is_number(value: Any) -> bool:
    return isinstance(value, float | int | np.floating | np.integer) and not isinstance(value, bool)
