"""Constraint forces and projections: the mass matrix eliminated first, then G M⁻¹ Gᵀ."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import casadi as ca
import numpy as np

from mbd_sim.dynamics.articulated_body import Accelerations, Articulated
from mbd_sim.dynamics.assembly import Conditions
from mbd_sim.dynamics.constraint_equations import Constraints, State
from mbd_sim.dynamics.initial_conditions import Start
from mbd_sim.geometry.pose import Array

# Of its usual size, what a pivot may shrink to before a constraint counts as weak, as vanished, and as in danger.
WEAK, VANISHED, NEARLY = 1e-7, 1e-13, 1e-2


class ConstraintSolver:
    """G M⁻¹ Gᵀ, factorized; `scales` (m,) are the usual sizes of its diagonal.

    `margin` is negative where one of the constraints has become weak. There the accelerations answer a state that
    is off the constraints with an error that grows without bound, so that the stages of a step may not drift.
    """

    def __init__(self, matrix: Articulated, constraints: Constraints, scales: Array) -> None:
        self._matrix, self._constraints = matrix, constraints
        self._shares = matrix.shares(constraints.gradient.T)
        product = matrix.product(self._shares, self._shares)
        self._factors = GuardedFactors(product, VANISHED * scales)
        self._cautious = GuardedFactors(product, WEAK * scales)
        strengths = [self._factors.pivots[row] - NEARLY * scale for row, scale in enumerate(scales)]
        self.margin = functools.reduce(ca.fmin, strengths)

    def multipliers(self, acting: Sequence[ca.SX]) -> ca.SX:
        """λ (m,) that keeps G u' + γ = 0 under forces with these shares.

        γ of a weak constraint is left out: only round-off may be left of it, while the rest vanishes with the pivot.
        """
        free = self._matrix.product(self._shares, acting)
        return -self._factors.solve(free) - self._cautious.solve(self._constraints.bias)

    def accelerations(self, acting: Sequence[ca.SX], multipliers: ca.SX) -> Accelerations:
        """What forces with these shares and the constraint forces make of the mechanism at u' = 0."""
        size = self._constraints.gradient.shape[1]
        shares = [ca.sparsify(one + own @ multipliers) for one, own in zip(acting, self._shares, strict=True)]
        return self._matrix.respond(shares, size)

    def response(self, multipliers: ca.SX) -> ca.SX:
        """M⁻¹ Gᵀ λ (nv,)."""
        size = self._constraints.gradient.shape[1]
        return self._matrix.respond([ca.sparsify(share @ multipliers) for share in self._shares], size).u_rates

    def corrections(self, state: State) -> tuple[ca.SX, ca.SX]:
        """Displacement and change of velocity (nv,) that lead back to the constraints, the smallest in M's metric.

        The velocity is that at the displaced position: near a singular configuration a small displacement turns the
        directions that are free.
        """
        constraints = self._constraints
        displacement = self.response(self._cautious.solve(-constraints.position))
        moved = ca.jacobian(state.q_rates, state.u) @ displacement
        defect = constraints.velocity + ca.jtimes(constraints.velocity, state.q, moved)
        return displacement, self.response(self._cautious.solve(-defect))


class GuardedFactors:
    """A sparse symmetric positive semidefinite matrix (m, m) as L D Lᵀ.

    A row whose pivot is no larger than its `floors` (m,) is left out, and its unknown is zero: near a singular
    configuration the constraint that it belongs to depends on those before it.
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
            inverse = (value > floors[pivot]) / ca.fmax(value, floors[pivot])  # 0 where it is left out
            others = [index for index in row if index != pivot]
            factors = {index: row[index] * inverse for index in others}
            for place, i in enumerate(others):
                for j in others[place:]:
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


def minimum_degree(neighbours: Sequence[set[int]]) -> list[int]:
    """An order of elimination that makes little fill-in: always the row with the fewest entries left."""
    left = {index: set(row) - {index} for index, row in enumerate(neighbours)}
    order = []
    while left:
        pivot = min(left, key=lambda index: (len(left[index]), index))
        clique = left.pop(pivot)
        for index in clique:
            left[index] |= clique - {index}
            left[index].discard(pivot)
        order.append(pivot)
    return order


def usual_sizes(conditions: Conditions, start: Start) -> Array:
    """The largest diagonal (m,) of G M⁻¹ Gᵀ around the start, of the rows that are kept."""
    keep = list(start.keep)
    diagonals = [np.zeros(len(keep))]
    for t, q in start.nearby:
        gradient = conditions.gradient(t, q)[keep]
        diagonals.append(np.einsum("ij,jk,ik->i", gradient, np.linalg.pinv(conditions.mass(t, q)), gradient))
    return np.asarray(np.max(diagonals, axis=0), dtype=float)
