"""Rows that combine the columns of a basis: the unit wrenches on the parts of slots, and rows of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from mbd_sim.compiler.rows.row_factors import FactorBlock, Factors, RowFactor
from mbd_sim.dynamics.constraints.equations import ConstraintEquations, joined
from mbd_sim.dynamics.constraints.rows import ConstraintRow
from mbd_sim.dynamics.contact.rows.slots import Slots


@dataclass(frozen=True, eq=False)
class CombinedRows:
    """The `equations` of rows, with symbols for the values of `slots`, and their `basis`, whose motion is that of rows.

    A multiplier of a row counts for those of the basis as much as its row of the `combination` (rows, columns) says.
    The rows of pools are zero there: which part they act on is known to compiled code, see `pooled_rows`.
    Each of the `groups` of columns is used as a whole.
    """

    equations: ConstraintEquations
    slots: Slots
    basis: ConstraintEquations
    combination: ca.SX
    groups: tuple[tuple[int, ...], ...]

    @cached_property
    def written(self) -> ConstraintEquations:
        """The equations in the state."""
        own, slots = self.equations, self.slots
        return ConstraintEquations(
            rows=own.rows,
            position=slots.written(own.position),
            gradient=slots.written(own.gradient),
            velocity=slots.written(own.velocity),
            bias=slots.written(own.bias),
            wrenches=[slots.written(wrench) for wrench in own.wrenches],
            driven_factors=own.driven_factors,
            own_rate=own.own_rate,
            branch_checks=own.branch_checks,
        )

    def factors(self, left: ca.SX, right: ca.SX, last: ca.SX) -> tuple[Factors, tuple[ca.SX, ca.SX]]:
        """L and R with C leftᵀ right Cᵀ last = Lᵀ R for the combination C, and their numbers; of the same blocks."""
        pattern = [each.sparsity() for each in (ca.sparsify(left), ca.sparsify(right))]
        blocks = []
        for group in self.groups:
            found = {row for each in pattern for k in group for row in each.row()[each.colind(k) : each.colind(k + 1)]}
            blocks.append(FactorBlock(tuple(sorted(found)), len(group)))
        shape, pairs = tuple(blocks), []
        for columns, combination in ((left, self.combination), (right, last.T @ self.combination)):
            entries = [
                ca.vec(ca.densify(columns[list(block.places), list(group)]))
                for block, group in zip(blocks, self.groups, strict=True)
            ]
            terms, weights = self._terms(ca.sparsify(combination).T)
            factor = RowFactor(columns.shape[0], shape, terms, weights.shape[0])
            pairs.append((factor, ca.densify(ca.vertcat(ca.SX(0, 1), *entries, weights))))
        (first, numbers), (second, others) = pairs
        return (first, second), (numbers, others)

    def _terms(self, by_row: ca.SX) -> tuple[tuple[tuple[tuple[int, int], ...], ...], ca.SX]:
        """The terms of a `RowFactor`, and its coefficients, for a combination (columns, rows)."""
        group_of = {column: number for number, group in enumerate(self.groups) for column in group}
        terms, count, weights, pattern = [], 0, [ca.SX(0, 1)], by_row.sparsity()
        for row in range(by_row.shape[1]):
            own = []
            for number in sorted({group_of[k] for k in pattern.row()[pattern.colind(row) : pattern.colind(row + 1)]}):
                own.append((number, count))
                weights.append(ca.densify(by_row[list(self.groups[number]), row]))
                count += len(self.groups[number])
            terms.append(tuple(own))
        return tuple(terms), ca.vertcat(*weights)


def matrix_of(factor: RowFactor, numbers: ca.SX) -> ca.SX:
    """The matrix (size, rows) of a factor from its numbers."""
    columns = []
    for terms in factor.terms:
        column = ca.SX(factor.size, 1)
        for number, offset in terms:
            block, start = factor.blocks[number], factor.starts[number]
            entries = ca.reshape(numbers[start : start + block.size], len(block.places), block.columns)
            first = factor.starts[-1] + offset
            column[list(block.places)] += entries @ numbers[first : first + block.columns]
        columns.append(column)
    return ca.horzcat(ca.SX(factor.size, 0), *columns)


def combined_rows(
    plain: ConstraintEquations,
    plain_places: Sequence[int],
    slots: Slots,
    slot_places: Sequence[Sequence[int]],
    rows: Sequence[ConstraintRow],
) -> CombinedRows:
    """The `rows`, of which some are `plain` ones, and some those of slots, at these places."""
    motions, wrenches = slots.motions, slots.motions.wrenches
    basis, first = joined(wrenches, plain), len(wrenches.rows)
    combination = ca.SX(len(rows), len(basis.rows))
    for place, row in enumerate(plain_places):
        combination[row, first + place] = 1.0
    positions, velocities, biases = ([ca.SX(1, 1)] * len(rows) for _ in range(3))
    for place, row in enumerate(plain_places):
        positions[row], velocities[row], biases[row] = plain.position[place], plain.velocity[place], plain.bias[place]
    for slot, own in zip(slots.slots, slot_places, strict=True):
        positions[own[0]] = slot.position
        for place, row in enumerate(own):
            velocities[row], biases[row] = slot.velocity[place], slot.bias[place]
            for part, factors in zip(slot.parts, slot.wrenches, strict=True) if slot.pool is None else ():
                combination[row, list(motions.places(part))] = factors[place, :]
    combination = ca.sparsify(combination)
    none = ca.SX(0, 1)
    equations = ConstraintEquations(
        rows=list(rows),
        position=ca.vertcat(none, *positions),
        gradient=ca.sparsify(combination @ basis.gradient),
        velocity=ca.vertcat(none, *velocities),
        bias=ca.vertcat(none, *biases),
        wrenches=[ca.sparsify(wrench @ combination.T) for wrench in basis.wrenches],
        driven_factors={name: combination @ factors for name, factors in basis.driven_factors.items()},
        own_rate=combination @ basis.own_rate,
        branch_checks=plain.branch_checks,
    )
    parts = [tuple(motions.places(part)) for part in range(len(motions.links))]
    own_columns = [(first + place,) for place in range(len(plain_places))]
    return CombinedRows(equations, slots, basis, combination, (*parts, *own_columns))
