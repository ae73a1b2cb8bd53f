"""Constraint forces and projections: the mass matrix is eliminated first, which leaves G M⁻¹ Gᵀ."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.linear_algebra import inverse, inverse_of_symmetric, product
from mbd_sim.dynamics.constraints.equations import ConstraintEquations
from mbd_sim.dynamics.constraints.functions import ConstraintFunctions
from mbd_sim.dynamics.constraints.start import AssembledStart
from mbd_sim.dynamics.kinematics.tracing import StateSymbols
from mbd_sim.dynamics.recursion.articulated_body import Accelerations, FactorizedMassMatrix

# Fractions of its typical size at which a pivot counts as weak, as vanished, and as about to become weak.
WEAK, VANISHED, NEARLY_WEAK = 1e-7, 1e-13, 1e-2

# The fractions of the typical size that are added to the diagonal of dependent rows, for accelerations and for
# projections, and the number of corrections that remove the effect. A state that violates the constraints by d makes
# the right side inconsistent; the error is of the order of d²/REGULARIZATION, or d³/PROJECTION in projections.
REGULARIZATION, PROJECTION, CORRECTIONS = 1e-6, 1e-4, 4
TINY = 1e-30
LIGHT = 1e-4  # of its diagonal entry: a typical pivot below it is due to light parts, and not to a weak constraint

Rows = dict[int, dict[int, ca.SX]]  # the entries of a sparse matrix by row and column


@dataclass(frozen=True, eq=False)
class TypicalMatrices:
    """G M⁻¹ Gᵀ (m, m) in some `configurations`, and the `scales` (m,) of its diagonal: the largest entries there."""

    scales: Array
    configurations: Sequence[Array]

    def sizes(self, dependent: NDArray[np.bool_], added: Array) -> Array:
        """The typical sizes (m,) of the pivots, with a diagonal that is `added` (m,) for `dependent` rows.

        They are the scales, unless parts are far lighter than others: in all configurations, some row that is
        eliminated last has a pivot far smaller than its diagonal entry. The sizes of such rows are the medians of these
        pivots, of which a configuration that happens to be nearly singular changes little.
        """
        found = []
        for matrix in self.configurations:
            try:
                last = 1.0 / np.diag(inverse(matrix + np.diag(added)))
            except np.linalg.LinAlgError:  # a singular configuration
                continue
            if np.all(last[~dependent] > VANISHED * self.scales[~dependent]):
                found.append(last)
        light = [np.any(last[~dependent] < LIGHT * self.scales[~dependent]) for last in found]
        if not light or not all(light):
            return self.scales
        least = np.min(found, axis=0)
        return np.where(~dependent & (least < LIGHT * self.scales), np.median(found, axis=0), self.scales)


class ConstraintSolver:
    """G M⁻¹ Gᵀ factorized; `typical` are its sizes, with the scales of its diagonal.

    Rows may depend on each other: `dependent` (m,) marks them. Which of them could be left out changes with the
    configuration, so all of them stay. Their multipliers are those with the smallest Σ scales λ².

    `margin` is negative where one of the other constraints has become weak, and None if there are none. There the
    accelerations respond to a state that violates the constraints with an error that grows without bound, so the stages
    of a step must not drift.
    """

    def __init__(
        self,
        mass_matrix: FactorizedMassMatrix,
        constraints: ConstraintEquations,
        typical: TypicalMatrices,
        dependent: NDArray[np.bool_],
    ) -> None:
        self._mass_matrix, self._constraints = mass_matrix, constraints
        self._net_forces = mass_matrix.net_joint_forces(constraints.gradient.T)
        product = mass_matrix.product(self._net_forces, self._net_forces)
        scales, sizes = typical.scales, typical.sizes(dependent, REGULARIZATION * typical.scales * dependent)
        light = sizes != scales

        def factorized(floor: float, regularization: float) -> GuardedFactors | RegularizedFactors:
            if not dependent.any():
                return GuardedFactors(product, floor * sizes, light)
            floors = np.where(dependent, TINY * scales, floor * sizes)
            return RegularizedFactors(product, regularization * scales * dependent, floors, light)

        self._factors = factorized(VANISHED, REGULARIZATION)
        self._cautious_factors = self._projection_factors = factorized(WEAK, REGULARIZATION)
        if dependent.any():
            self._projection_factors = factorized(WEAK, PROJECTION)
        self._all_dependent = bool(dependent.all())
        margins = [self._factors.pivots[row] - NEARLY_WEAK * sizes[row] for row in np.flatnonzero(~dependent).tolist()]
        self.margin = functools.reduce(ca.fmin, margins) if margins else None

    def multipliers(self, applied: Sequence[ca.SX]) -> ca.SX:
        """λ (m,) that keeps G u' + γ = 0 under applied forces with these net joint forces.

        γ of a weak constraint is left out: only round-off may be left of it, while the other terms vanish with the
        pivot.
        """
        unconstrained = self._mass_matrix.product(self._net_forces, applied)
        if self._all_dependent:  # then both factorizations are the same
            return -self._factors.solve(unconstrained + self._constraints.bias)
        return -self._factors.solve(unconstrained) - self._cautious_factors.solve(self._constraints.bias)

    def coupling(self, net_forces: Sequence[ca.SX]) -> ca.SX:
        """G M⁻¹ F (m, k) for forces F with these net joint forces (., k)."""
        return self._mass_matrix.product(self._net_forces, net_forces)

    def reaction(self, coupling: ca.SX) -> ca.SX:
        """The multipliers (m, k) that keep G u' as it is under forces with this `coupling` (m, k)."""
        columns = [self._factors.solve(-coupling[:, index]) for index in range(coupling.shape[1])]
        return ca.horzcat(ca.SX(coupling.shape[0], 0), *columns)

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
        displacement = self.response(self._projection_factors.solve(-constraints.position))
        q_change = ca.jacobian(state.q_rates, state.u) @ displacement
        defect = constraints.velocity + ca.jtimes(constraints.velocity, state.q, q_change)
        return displacement, self.response(self._projection_factors.solve(-defect))


class GuardedFactors:
    """A sparse symmetric positive semidefinite matrix (m, m) as L D Lᵀ.

    A row whose pivot is no larger than its `floors` (m,) is left out, and its unknown is zero: near a singular
    configuration the constraint of that row depends on those before it.

    `light` (m,) rows are judged by the pivots that they would have as the last of the rows that are left. If a light
    part is held at an end, its inverse mass K is in every row there, but only one pivot is of the order of K: which
    one depends on the angle of the part. A pivot K sin²(angle) is small where the rows depend on each other, and also
    where the next one is K. `pivots` are those by which the rows are judged.
    """

    def __init__(self, matrix: ca.SX, floors: Array, light: NDArray[np.bool_] | None = None) -> None:
        size = matrix.shape[0]
        rest = {i: {j: matrix[i, j] for j in range(size) if matrix.has_nz(i, j)} for i in range(size)}
        self._order = minimum_degree(rest)
        self.pivots: dict[int, ca.SX] = {}
        self._inverse: dict[int, ca.SX] = {}
        self._lower: dict[int, dict[int, ca.SX]] = {}
        for pivot in self._order:
            value, floor = rest[pivot].get(pivot, ca.SX(0)), floors[pivot]
            self.pivots[pivot] = value
            if light is not None and light[pivot]:
                last = self.pivots[pivot] = _last_pivot(rest, pivot, floors)
                floor *= ca.fmax(1.0, value / ca.fmax(last, 0.5 * floor))  # above the value where last < floor
            self._inverse[pivot] = guarded_inverse(value, floor)
            self._lower[pivot] = _eliminate(rest, pivot, self._inverse[pivot])

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


class RegularizedFactors:
    """A singular symmetric positive semidefinite matrix A (m, m) as A + E = L D Lᵀ with a small diagonal E.

    For a right side in the range of A, x ← x + (A + E)⁻¹ (b - A x) converges to the solution with the smallest xᵀ E x:
    the error in the direction of an eigenvalue σ shrinks by ε / (σ + ε) each time. This is iterative improvement with a
    perturbed matrix (Golub & Van Loan, sec. 3.5.3).
    """

    def __init__(self, matrix: ca.SX, added: Array, floors: Array, light: NDArray[np.bool_]) -> None:
        self._matrix = matrix
        self._factors = GuardedFactors(matrix + ca.diag(ca.sparsify(ca.SX(ca.DM(added)))), floors, light)

    @property
    def pivots(self) -> Mapping[int, ca.SX]:
        """The pivots of the regularized matrix, by row."""
        return self._factors.pivots

    def solve(self, right: ca.SX) -> ca.SX:
        """The solution (m,) for a right side (m,)."""
        x = self._factors.solve(right)
        for _ in range(CORRECTIONS):
            x = x + self._factors.solve(right - self._matrix @ x)
        return x


def guarded_inverse(value: ca.SX, floor: float | ca.SX) -> ca.SX:
    """1 / value, or 0 if the value is no larger than the floor."""
    return (value > floor) / ca.fmax(value, floor)


def _eliminate(rest: Rows, pivot: int, inverse: ca.SX) -> dict[int, ca.SX]:
    """Take a row and its column out of the matrix `rest`, with the `inverse` of its pivot; its factors by row."""
    row = rest.pop(pivot)
    others = [index for index in row if index != pivot]
    factors = {index: row[index] * inverse for index in others}
    for position, i in enumerate(others):
        for j in others[position:]:
            updated = rest[i].get(j, 0) - factors[i] * row[j]
            rest[i][j] = rest[j][i] = updated
        del rest[i][pivot]
    return factors


def _last_pivot(rest: Rows, last: int, floors: Array) -> ca.SX:
    """The pivot of a row if all others are eliminated before it."""
    left = {index: dict(row) for index, row in rest.items()}
    for pivot in minimum_degree({index: set(row) - {last} for index, row in rest.items() if index != last}):
        _eliminate(left, pivot, guarded_inverse(left[pivot].get(pivot, ca.SX(0)), floors[pivot]))
    return left[last].get(last, ca.SX(0))


def minimum_degree(neighbors: Mapping[int, Iterable[int]]) -> list[int]:
    """An elimination order with little fill-in: always the row with the fewest entries left.

    :param neighbors: for each row, the columns of its entries.
    """
    left = {index: set(row) - {index} for index, row in neighbors.items()}
    order = []
    while left:
        pivot = min(left, key=lambda index: (len(left[index]), index))
        clique = left.pop(pivot)
        for index in clique:
            left[index] |= clique - {index}
            left[index].discard(pivot)
        order.append(pivot)
    return order


def typical_matrices(functions: ConstraintFunctions, start: AssembledStart) -> TypicalMatrices:
    """G M⁻¹ Gᵀ of the active rows in the configurations around the start."""
    rows = list(start.active)
    matrices, diagonals, scales = list[Array](), [np.zeros(len(rows))], functions.scales
    for t, q in start.nearby:
        gradient = functions.gradient(t, q)[rows]
        in_units = functions.mass_matrix(t, q) * scales * scales[:, None]
        mobility = inverse_of_symmetric(in_units) * scales * scales[:, None]
        matrices.append(product(product(gradient, mobility), gradient.T))
        diagonals.append(np.diag(matrices[-1]))
    return TypicalMatrices(np.asarray(np.max(diagonals, axis=0), dtype=float), matrices)
