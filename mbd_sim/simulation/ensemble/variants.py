"""Variants of one mechanism that share its equations of motion and differ in values and initial state.

Variants that differ in the same numbers are built at once: as one mechanism, with batches of these numbers.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.errors import InputError, MbdSimError, MechanismError, Problem, quoted
from mbd_sim.base.geometry.batch import Batch, of_all
from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.constraints.assembly import start_many
from mbd_sim.dynamics.constraints.functions import ManyConstraints
from mbd_sim.dynamics.constraints.start import given_starts, start_like
from mbd_sim.dynamics.contact.cams import require_followable_cams
from mbd_sim.dynamics.kinematics.parameters import (
    EquationData,
    StructureError,
    SymbolicParameters,
    equation_data,
    equation_data_of_variants,
    varying_parameters,
)
from mbd_sim.dynamics.layouts.vectors import coordinate_layout
from mbd_sim.files.checks.override import with_values
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.simulation.model.model import Model

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
    """The start commands of actuators, and the start states of their machines: numbers, or batches of them."""
    found: list[Any] = []
    for actuator in mechanism.actuators:
        found += [*actuator.start.values(), *actuator.motor.start_states.values()]
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


Change = Mapping[str, float | str]
Progress = Callable[[float], None]
UNNOTICED = 2.0  # s, after which a build shows its progress


def member_changes(members: int | Sequence[Change]) -> list[Change]:
    """The changes of each member of an ensemble, which are given, or only their number.

    :raises InputError: there are no members, or something else is given.
    """
    changes: list[Change] | None = None
    if isinstance(members, int | np.integer) and not isinstance(members, bool):
        changes = [{}] * int(members)
    elif isinstance(members, Iterable) and not isinstance(members, str | Mapping):
        changes = list(members)
    if changes is None or not all(isinstance(change, Mapping) for change in changes):
        remedy = "Give their number, or a list with the changed values of each one by key."
        raise InputError(f"members of an ensemble cannot be {quoted(members)}", remedy)
    if not changes:
        raise InputError("an ensemble needs at least one member")
    return changes


class Variants:
    """One mechanism for each change, built when it is needed; members with equal changes share it.

    `values` are the numbers in which the equations of the variants differ.
    """

    def __init__(self, mechanism: Mechanism, changes: Sequence[Change], progress: Progress | None = None) -> None:
        """Build the variants, those that change the same numbers at once.

        :param progress: called with the fraction of the variants that are built; by default it is shown on a terminal.
        :raises MechanismError: a change does not fit, or the equations differ by more than values.
        """
        self._mechanism = mechanism
        self._mechanisms: dict[int, Mechanism] = {}  # those that have been built
        self._variant_of: list[int] = []  # for each member
        known: dict[tuple[tuple[str, float | str], ...], int] = {}
        self._changes: list[Change] = []
        for change in changes:
            key = tuple((name, _hashable(value)) for name, value in sorted(change.items()))
            if key not in known:
                known[key] = len(known)
                self._changes.append(change)
            self._variant_of.append(known[key])
        self._numbers = self._all_numbers(progress or shown_on_terminal(len(self._changes)))
        try:
            data = [numbers.data for numbers in self._numbers]
            self.values: SymbolicParameters = varying_parameters(data[0], data)
        except StructureError as error:
            message = f"the members cannot share one set of equations: {error}"
            raise MechanismError([Problem(message, "Build a separate ensemble for each such value.")]) from error

    def _all_numbers(self, progress: Progress) -> list[VariantNumbers]:
        groups: dict[tuple[str, ...], list[int]] = {}
        for number, change in enumerate(self._changes):
            groups.setdefault(tuple(change), []).append(number)
        found: dict[int, VariantNumbers] = {}
        for numbers in groups.values():
            changes = [self._changes[number] for number in numbers]
            at_once = build_at_once(self._mechanism, changes, partial(self._built_among, numbers))
            found |= {number: one for number, one in zip(numbers, at_once, strict=True) if one is not None}
        for number in range(len(self._changes)):
            if number not in found:
                progress(len(found) / len(self._changes))
                found[number] = numbers_of(self._built(number))
        progress(1.0)
        return [found[number] for number in range(len(self._changes))]

    def _built_among(self, numbers: Sequence[int], index: int) -> Mechanism:
        return self._built(numbers[index])

    @property
    def first(self) -> Mechanism:
        """The mechanism of the first member."""
        return self._built(0)

    def mechanism_of(self, member: int) -> Mechanism:
        """The mechanism with the values of a member."""
        return self._built(self._variant_of[member])

    def holding(self, member: int) -> Mechanism:
        """A mechanism with the start commands of a member."""
        return self.mechanism_of(member) if self._hold_differently else self.first

    @cached_property
    def _hold_differently(self) -> bool:
        first = self._numbers[0].held
        return any(not np.array_equal(numbers.held, first) for numbers in self._numbers)

    def _built(self, number: int) -> Mechanism:
        """A variant by its number, which is built when it is first needed.

        :raises MechanismError: its change does not fit.
        """
        if number not in self._mechanisms:
            change = self._changes[number]
            try:
                variant = with_values(self._mechanism, change) if change else self._mechanism
                require_followable_cams(variant)
            except MechanismError as error:
                raise _of_member(self._variant_of.index(number), error) from error
            self._mechanisms[number] = variant
        return self._mechanisms[number]

    def starts(self, model: Model) -> tuple[Array, Array]:
        """The start states (k, n) and the values (k, m) of the k members.

        :raises MechanismError: the loops of a member cannot be closed.
        """
        q, u = (np.array([getattr(numbers, name) for numbers in self._numbers]) for name in ("q", "u"))
        values = np.array([self.values.values_in(numbers.data) for numbers in self._numbers])
        if model.equations.rows:
            self._assemble(model, q, u, values)
        states = np.zeros((len(q), len(model.start)))
        states[:, model.q_range], states[:, model.u_range] = q, u
        return states[self._variant_of], values[self._variant_of]

    def _assemble(self, model: Model, q: Array, u: Array, values: Array) -> None:
        """Close the loops of all variants, in place."""
        constraints, joints = ManyConstraints(model.equations.constraints, values), self.first.joints.values()
        waiting = np.ones(len(q), dtype=bool)
        if len(q) >= FEWEST:
            fixed_q = np.array([flag for joint in joints for flag in joint.fixed_in_assembly], dtype=bool)
            fixed_u = np.array([flag for joint in joints for flag in joint.fixed_speeds], dtype=bool)
            found = start_many(constraints, q, u, fixed_q, fixed_u, model.equations.start.rank)
            done = np.flatnonzero(found.assembled)
            for number in first_middle_last(done):
                alone = self._start(model, number, values[number])
                if not (np.array_equal(found.q[number], alone[0]) and np.array_equal(found.u[number], alone[1])):
                    done = done[:0]
            q[done], u[done], waiting[done] = found.q[done], found.u[done], False
        for number in np.flatnonzero(waiting).tolist():
            q[number], u[number] = self._start(model, number, values[number])

    def _start(self, model: Model, number: int, values: Array) -> tuple[Array, Array]:
        """The start of a variant that is assembled by itself."""
        constraints, rows = model.equations.constraints.with_values(values), model.equations.rows
        try:
            return start_like(self._built(number), model.layout, constraints, rows, model.equations.start.rank)
        except MechanismError as error:
            raise _of_member(self._variant_of.index(number), error) from error

    def effort_limits(self) -> Array:
        """The largest absolute effort (k, nv) of each degree of freedom, in N or N·m."""
        return np.array([numbers.effort_limits for numbers in self._numbers])[self._variant_of]


def shown_on_terminal(count: int) -> Progress:
    """Show on a terminal which part of `count` variants is built, from `UNNOTICED` seconds on."""
    begun, shown = time.monotonic(), False

    def show(fraction: float) -> None:
        nonlocal shown
        if sys.stderr.isatty() and (shown or time.monotonic() > begun + UNNOTICED):
            shown = True
            end = "\n" if fraction == 1.0 else ""
            print(f"\rbuilt {round(fraction * count)} of {count} variants", end=end, file=sys.stderr, flush=True)

    return show


def _hashable(value: float | str) -> float | str:
    """A value of a change, or the text of a list, to tell changes apart."""
    return value if isinstance(value, Hashable) else repr(value)


def _of_member(member: int, error: MechanismError) -> MechanismError:
    return MechanismError([replace(each, message=f"member {member}: {each.message}") for each in error.problems])
