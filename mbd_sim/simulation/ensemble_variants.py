"""Variants of one mechanism that share its equations of motion and differ in values and initial state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mbd_sim.dynamics.cam_check import require_followable_cams
from mbd_sim.dynamics.initial_conditions import start_like
from mbd_sim.dynamics.symbolic_parameters import (
    EquationData,
    StructureError,
    SymbolicParameters,
    equation_data,
    varying_parameters,
)
from mbd_sim.errors import MechanismError, Problem
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.mechanism_file.override import with_values
from mbd_sim.simulation.compiled_model import Model

Change = Mapping[str, float | str]


class Variants:
    """One mechanism for each change; members with equal changes share it.

    `values` are the numbers in which the equations of the variants differ.
    """

    def __init__(self, mechanism: Mechanism, changes: Sequence[Change]) -> None:
        """Build the variants.

        :raises MechanismError: a change does not fit, or the equations differ by more than values.
        """
        base = equation_data(mechanism)
        self._mechanisms: list[Mechanism] = []
        self._numbers: list[EquationData] = []
        self._variant_of: list[int] = []  # for each member
        known: dict[tuple[tuple[str, float | str], ...], int] = {}
        for member, change in enumerate(changes):
            key = tuple(sorted(change.items()))
            if key not in known:
                known[key] = len(self._mechanisms)
                try:
                    variant = with_values(mechanism, change) if change else mechanism
                    require_followable_cams(variant)
                except MechanismError as error:
                    raise _of_member(member, error) from error
                self._mechanisms.append(variant)
                self._numbers.append(equation_data(variant) if change else base)
            self._variant_of.append(known[key])
        try:
            self.values: SymbolicParameters = varying_parameters(self._numbers[0], self._numbers)
        except StructureError as error:
            message = f"the members cannot share one set of equations: {error}"
            raise MechanismError([Problem(message, "Build a separate ensemble for each such value.")]) from error

    @property
    def first(self) -> Mechanism:
        """The mechanism of the first member."""
        return self._mechanisms[0]

    def mechanism_of(self, member: int) -> Mechanism:
        """The mechanism with the values of a member."""
        return self._mechanisms[self._variant_of[member]]

    def starts(self, model: Model) -> tuple[Array, Array]:
        """The start states (k, n) and the values (k, m) of the k members.

        :raises MechanismError: the loops of a member cannot be closed.
        """
        equations, states, rows = model.equations, [], []
        for number, (mechanism, numbers) in enumerate(zip(self._mechanisms, self._numbers, strict=True)):
            values = self.values.values_in(numbers)
            constraints = equations.constraints.with_values(values)
            try:
                q, u = start_like(mechanism, model.layout, constraints, equations.rows)
            except MechanismError as error:
                raise _of_member(self._variant_of.index(number), error) from error
            states.append(np.concatenate([q, u, np.zeros(len(model.start) - len(q) - len(u))]))
            rows.append(values)
        return np.array(states)[self._variant_of], np.array(rows)[self._variant_of]

    def effort_limits(self) -> Array:
        """The largest absolute effort (k, nv) of each degree of freedom, in N or N·m."""
        return np.array([mechanism.effort_limits() for mechanism in self._mechanisms])[self._variant_of]


def _of_member(member: int, error: MechanismError) -> MechanismError:
    first, *rest = error.problems
    head = Problem(f"member {member}: {first.message}", first.remedy, first.key, first.value, first.file, first.line)
    return MechanismError([head, *rest])
