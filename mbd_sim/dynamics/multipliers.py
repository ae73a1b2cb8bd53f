"""Constraint forces and projections: the mass matrix is eliminated first, which leaves G M⁻¹ Gᵀ."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import casadi as ca
import numpy as np

from mbd_sim.dynamics.articulated_body import Accelerations, FactorizedMassMatrix
from mbd_sim.dynamics.constraint_equations import ConstraintEquations
from mbd_sim.dynamics.constraint_functions import ConstraintFunctions
from mbd_sim.dynamics.initial_conditions import AssembledStart
from mbd_sim.dynamics.tracing import StateSymbols
from mbd_sim.geometry.pose import Array

# Fractions of its typical size at which a pivot counts as weak, as vanished, and as about to become weak.
WEAK, VANISHED, NEARLY_WEAK = 1e-7, 1e-13, 1e-2


class ConstraintSolver:
    """G M⁻¹ Gᵀ of independent constraints, factorized; `scales` (m,) are the typical sizes of its diagonal.

    `margin` is negative where one of the constraints has become weak. There the accelerations respond to a state that
    violates the constraints with an error that grows without bound, so the stages of a step must not drift.
    """

    def __init__(self, mass_matrix: FactorizedMassMatrix, constraints: ConstraintEquations, scales: Array) -> None:
        self._mass_matrix, self._constraints = mass_matrix, constraints
        self._net_forces = mass_matrix.net_joint_forces(constraints.gradient.T)
        product = mass_matrix.product(self._net_forces, self._net_forces)
        self._factors = GuardedFactors(product, VANISHED * scales)
        self._cautious_factors = GuardedFactors(product, WEAK * scales)
        margins = [self._factors.pivots[row] - NEARLY_WEAK * scale for row, scale in enumerate(scales)]
        self.margin = functools.reduce(ca.fmin, margins)

    def multipliers(self, applied: Sequence[ca.SX]) -> ca.SX:
        """λ (m,) that keeps G u' + γ = 0 under applied forces with these net joint forces.

        γ of a weak constraint is left out: only round-off may be left of it, while the other terms vanish with the
        pivot.
        """
        unconstrained = self._mass_matrix.product(self._net_forces, applied)
        return -self._factors.solve(unconstrained) - self._cautious_factors.solve(self._constraints.bias)

    def accelerations(self, applied: Sequence[ca.SX], multipliers: ca.SX) -> Accelerations:
        """The accelerations under applied forces with these net joint forces and the constraint forces."""
        net_forces = [ca.sparsify(one + own @ multipliers) for one, own in zip(applied, self._net_forces, strict=True)]
        return self._mass_matrix.solve(net_forces)

    def response(self, multipliers: ca.SX) -> ca.SX:
        """M⁻¹ Gᵀ λ (nv,)."""
        return self._mass_matrix.solve([ca.sparsify(force @ multipliers) for force in self._net_forces]).u_rates

    def corrections(self, state: StateSymbols) -> tuple[ca.SX, ca.SX]:
        """The displacement and the change of u (nv,), smallest in the metric of M, that restore the constraints.

        The change of u is that at the displaced position: near a singular configuration a small displacement rotates
        the free directions.
        """
        constraints = self._constraints
        displacement = self.response(self._cautious_factors.solve(-constraints.position))
        q_change = ca.jacobian(state.q_rates, state.u) @ displacement
        defect = constraints.velocity + ca.jtimes(constraints.velocity, state.q, q_change)
        return displacement, self.response(self._cautious_factors.solve(-defect))


class GuardedFactors:
    """A sparse symmetric positive semidefinite matrix (m, m) as L D Lᵀ.

    A row whose pivot is no larger than its `floors` (m,) is left out, and its unknown is zero: near a singular
    configuration the constraint of that row depends on those before it.
    """

    def __init__(self, matrix: ca.SX, floors: Array) -> None:
        size = matrix.shape[0]
        rest = [{j: matrix[i, j] for j in range(size) if matrix.has_nz(i, j)} for i in range(size)]
        self._order = minimum_degree([set(row) for row in rest])
        self.pivots: dict[int, ca.SX] = {}
        self._inverse: dict[int, ca.SX] = {}
        self._lower: dict[int, dict[int, ca.SX]] = {}
        for pivot in self._order:
            row = rest[pivot]
            value = row.get(pivot, ca.SX(0))
            inverse = (value > floors[pivot]) / ca.fmax(value, floors[pivot])  # 0 if the row is left out
            others = [index for index in row if index != pivot]
            factors = {index: row[index] * inverse for index in others}
            for position, i in enumerate(others):
                for j in others[position:]:
                    updated = rest[i].get(j, 0) - factors[i] * row[j]
                    rest[i][j] = rest[j][i] = updated
                del rest[i][pivot]
            self.pivots[pivot], self._inverse[pivot], self._lower[pivot] = value, inverse, factors

    def solve(self, right: ca.SX) -> ca.SX:
        """The solution (m,) for a right side (m,)."""
        x = {index: right[index] for index in self._order}
        for pivot in self._order:
            for index, factor in self._lower[pivot].items():
                x[index] = x[index] - factor * x[pivot]
        for pivot in reversed(self._order):
            x[pivot] = x[pivot] * self._inverse[pivot]
            for index, factor in self._lower[pivot].items():
                x[pivot] = x[pivot] - factor * x[index]
        return ca.sparsify(ca.vertcat(ca.SX(0, 1), *(x[index] for index in range(len(x)))))


def minimum_degree(neighbors: Sequence[set[int]]) -> list[int]:
    """An elimination order with little fill-in: always the row with the fewest entries left.

    :param neighbors: for each row, the columns of its entries.
    """
    left = {index: set(row) - {index} for index, row in enumerate(neighbors)}
    order = []
    while left:
        pivot = min(left, key=lambda index: (len(left[index]), index))
        clique = left.pop(pivot)
        for index in clique:
            left[index] |= clique - {index}
            left[index].discard(pivot)
        order.append(pivot)
    return order


def typical_diagonal(functions: ConstraintFunctions, start: AssembledStart) -> Array:
    """The largest diagonal (m,) of G M⁻¹ Gᵀ in the configurations around the start, of the independent rows."""
    rows = list(start.independent)
    diagonals = [np.zeros(len(rows))]
    for t, q in start.nearby:
        gradient = functions.gradient(t, q)[rows]
        diagonals.append(np.einsum("ij,jk,ik->i", gradient, np.linalg.pinv(functions.mass_matrix(t, q)), gradient))
    return np.asarray(np.max(diagonals, axis=0), dtype=float)
