"""Forces at one-sided contacts with Coulomb friction: Lemke's method finds the modes, Newton's the forces.

With the rates s = A λ + r of all rows, of velocity for impulses λ and of acceleration for forces,

- a normal row has s ≥ 0, λ ≥ 0, s λ = 0;
- friction along one or two rows has |λ_T| ≤ μ λ_N, or |λ_T| ≤ F without a normal row, and s_T = -σ λ_T with σ ≥ 0,
  which is zero unless friction is at its limit.

For Lemke's method friction is written along opposite directions (Stewart & Trinkle 1996).

Where rows depend on each other, as those of a table on four legs, rigid bodies leave the forces undetermined. They are
then those that equal elastic supports would share: of all forces those with the least sum of squares. Rows that are a
little elastic tell which of them bear a force.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.geometry.pose import Array
from mbd_sim.compiler.ir.python_kinds import packed
from mbd_sim.simulation.contact.compiled.instant.forces import ACCURATE, SOFTNESS, ForceProblem
from mbd_sim.simulation.contact.compiled.library import called
from mbd_sim.simulation.contact.complementarity import pivots

STIFFER, LEAST_RATIO = 10.0, 1.01  # ratios of the softnesses of supports that become rigid, from one to the next
RIGID = 1e-13  # softness that is not distinguished from that of rigid ones
FEW, SWEEPS = 40, 400  # rows up to which all ways are tried in a step; sweeps where none leads to forces
FOLLOWED = 1e-12  # residual up to which forces of such supports are accepted


class NoSolutionError(ValueError):
    """No forces satisfy the conditions of all contacts (Painlevé), or they could not be found."""


@dataclass(frozen=True)
class FrictionLimit:
    """Friction along one or two rows: up to `size` times the force of row `normal`, or up to `size` without one."""

    rows: tuple[int, ...]
    normal: int | None
    size: float


@dataclass(frozen=True, eq=False)
class ContactProblem:
    """`matrix` A (n, n) and rates r (n,) without forces, `normals` among the rows, and their friction.

    Σ C λ² is least, with the `compliance` C (n,) of the supports; None where all are equal.
    """

    matrix: Array
    free: Array
    normals: Sequence[int]
    frictions: Sequence[FrictionLimit]
    compliance: Array | None = None

    @property
    def supports(self) -> Array:
        """The compliance (n,) of the supports."""
        return np.ones(len(self.free)) if self.compliance is None else self.compliance

    @cached_property
    def packed(self) -> NDArray[np.int64]:
        """The problem for compiled functions."""
        return packed(self._for_compiled)

    @cached_property
    def _for_compiled(self) -> ForceProblem:
        rows = [[*one.rows, -1][:2] for one in self.frictions]
        loads = [-1 if one.normal is None else one.normal for one in self.frictions]
        return ForceProblem(
            len(self.free),
            np.ascontiguousarray(self.matrix, dtype=float),
            np.ascontiguousarray(self.free, dtype=float),
            len(self.normals),
            np.array(self.normals, dtype=np.int64),
            len(rows),
            np.array(rows, dtype=np.int64).ravel(),
            np.array(loads, dtype=np.int64),
            np.array([one.size for one in self.frictions], dtype=float),
        )

    def rates(self, forces: Array) -> Array:
        """s (n,), summed in order."""
        total = self.free.copy()
        for column, force in enumerate(forces.tolist()):
            if force:
                total += self.matrix[:, column] * force
        return total


def contact_forces(problem: ContactProblem) -> Array:
    """λ (n,) that satisfies all conditions; of several the elastic ones.

    :raises NoSolutionError: there is none, or none was found.
    """
    unique = np.zeros(len(problem.free))
    if called("settled_forces", problem.packed, problem.supports, unique):
        return unique
    for rows in (islands := _islands(problem)):
        unique[rows] = _forces_together(problem if len(islands) == 1 else _island(problem, rows))
    return unique


def _islands(problem: ContactProblem) -> list[list[int]]:
    """The rows of each island: see `compiled.instant.islands`."""
    numbers = np.empty(len(problem.free), dtype=np.int64)
    return [np.flatnonzero(numbers == k).tolist() for k in range(called("find_islands", problem.packed, numbers))]


def _island(problem: ContactProblem, rows: Sequence[int]) -> ContactProblem:
    """The problem of some rows that form an island."""
    place = {row: position for position, row in enumerate(rows)}
    frictions = [
        FrictionLimit(
            tuple(place[row] for row in one.rows), None if one.normal is None else place[one.normal], one.size
        )
        for one in problem.frictions
        if one.rows[0] in place
    ]
    normals = [place[row] for row in problem.normals if row in place]
    compliance = None if problem.compliance is None else problem.compliance[list(rows)]
    return ContactProblem(problem.matrix[rows][:, rows], problem.free[list(rows)], normals, frictions, compliance)


def _forces_together(problem: ContactProblem) -> Array:
    """See `contact_forces`; of an island."""
    n = len(problem.free)
    unique = np.zeros(n)
    if called("unique_forces", problem.packed, unique):
        return unique
    scaled, scale = _scaled(problem)
    rigid, start = _quick(scaled)
    if max(len(problem.normals), len(problem.frictions)) < 2 or len(pivots(scaled.matrix)) == n:
        return _solution(scaled, rigid, start) * scale
    elastic = _elastic(scaled)
    if elastic is None:
        elastic = _solution(scaled, rigid, start)
    for forces in (_shared(scaled, elastic), elastic):
        if _natural(scaled, forces) <= ACCURATE:
            return _newton(scaled, forces)[0] * scale
    polished, residual = _newton(scaled, elastic)
    return (polished if residual <= ACCURATE else _solution(scaled, rigid, start)) * scale


def _shared(problem: ContactProblem, forces: Array) -> Array:
    """The forces of least Σ C λ² near some that satisfy all conditions: see `compiled.least_forces.share`."""
    found = forces.copy()
    called("share", problem.packed, problem.supports, found)
    return found


def nearest_forces(problem: ContactProblem) -> tuple[Array, float]:
    """λ (n,) of a step of time stepping that satisfies all conditions, and 0: see `compiled.together.step_forces`.

    Where none is found, the nearest ones, and their relative residual.
    """
    forces, residual = np.zeros(len(problem.free)), 0.0
    if called("nearest_forces", problem.packed, problem.supports, forces):
        return forces, residual
    for rows in _islands(problem):
        forces[rows], missing = _nearest_together(_island(problem, rows))
        residual = max(residual, missing)
    return forces, residual


def _nearest_together(problem: ContactProblem) -> tuple[Array, float]:
    """See `nearest_forces`; of an island."""
    found = np.zeros(len(problem.free))
    if called("nearest_forces", problem.packed, problem.supports, found):
        return found, 0.0
    with suppress(NoSolutionError):
        if len(found) <= FEW:
            return contact_forces(problem), 0.0
    scaled, scale = _scaled(problem)
    called("sweep", scaled.packed, SWEEPS, found)
    polished, residual = _newton(scaled, found)
    return polished * scale, residual


def _elastic(problem: ContactProblem) -> Array | None:
    """The forces of elastic supports that become stiffer and stiffer; None if they were not found."""
    forces = np.zeros(len(problem.free))
    return forces if called("elastic_forces", problem.packed, problem.compliance, forces) else None


def _softened(problem: ContactProblem, softness: float) -> ContactProblem:
    """A contact problem with elastic supports."""
    assert problem.compliance is not None
    softer, places = problem.matrix.copy(), range(len(problem.matrix))
    softer[places, places] += softness * problem.compliance
    return replace(problem, matrix=softer)


def _quick(problem: ContactProblem) -> tuple[Array | None, Array | None]:
    """The solution, or None; and what Lemke's method finds."""
    found = np.zeros(len(problem.free))
    start = found if called("by_lemke", problem.packed, found) else None
    attempts = [start] if start is not None else []
    for forces in (*attempts, np.zeros(len(problem.free))):
        polished, residual = _newton(problem, forces)
        if residual <= ACCURATE:
            return polished, start
    return (None if start is None else _with_fast_rates(problem, start, SOFTNESS)), start


def _continued(problem: ContactProblem) -> Array | None:
    """The solution that the forces of elastic supports approach as these become rigid, step by step; or None.

    Where rows at rest depend on each other and their rates differ a little, as of two wheels on one axle while it rolls
    over, some must slide: friction is at its limit though the rates are small beside it.
    """
    forces, softness, ratio = np.zeros(len(problem.free)), STIFFER, STIFFER
    while softness > RIGID and ratio > LEAST_RATIO:
        found = _with_fast_rates(_softened(problem, softness / ratio), forces, softness / ratio)
        if found is None:
            ratio = math.sqrt(ratio)
            continue
        forces, softness, ratio = found, softness / ratio, min(STIFFER, ratio**2)
        if (rigid := _with_fast_rates(problem, forces, softness)) is not None:
            return rigid
    return None


def _with_fast_rates(problem: ContactProblem, start: Array, softness: float) -> Array | None:
    """The solution by Newton's method from a `start`, or None. Rates times a factor have the same one.

    Beside forces of size 1, rates of the size of the `softness` then tell what slides.
    """
    for factor in (1.0, softness**-0.5, 1.0 / softness):
        faster = replace(problem, matrix=factor * problem.matrix, free=factor * problem.free)
        polished, residual = _newton(problem, _newton(faster, start)[0])
        if residual <= FOLLOWED:
            return polished
    return None


def _solution(problem: ContactProblem, found: Array | None, start: Array | None) -> Array:
    """The solution that `_quick` has `found`, or else the one that those of elastic supports approach."""
    if found is not None:
        return found
    if start is None and all(len(friction.rows) == 1 for friction in problem.frictions):
        raise NoSolutionError("no forces satisfy the conditions of all contacts")  # Lemke's method decides that
    if (continued := _continued(problem)) is None:
        raise NoSolutionError("no forces satisfy the conditions of all contacts")
    return continued


def _scaled(problem: ContactProblem) -> tuple[ContactProblem, Array]:
    """Scale a problem to rows of unit diagonal and rates of at most 1; λ = scale · λ of the scaled one.

    Its largest compliance is 1. The rows of one friction element keep a common scale, so that its circle stays one, and
    so does its normal row.
    """
    diagonal = np.diag(problem.matrix).copy()
    for friction in problem.frictions:
        group = [*friction.rows, *([] if friction.normal is None else [friction.normal])]
        diagonal[group] = np.max(diagonal[group])
    changed = True
    while changed:  # rows that share a normal row
        changed = False
        for friction in problem.frictions:
            group = [*friction.rows, *([] if friction.normal is None else [friction.normal])]
            if np.any(diagonal[group] != np.max(diagonal[group])):
                diagonal[group], changed = np.max(diagonal[group]), True
    weights = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    free = weights * problem.free
    size = float(np.abs(free).max()) or 1.0
    matrix = problem.matrix * weights[:, None] * weights[None, :]
    scale = size * weights
    frictions = [
        friction if friction.normal is not None
        else FrictionLimit(friction.rows, None, friction.size / scale[friction.rows[0]])
        for friction in problem.frictions
    ]  # fmt: skip
    compliance = weights**2 * (1.0 if problem.compliance is None else problem.compliance)
    compliance /= np.max(compliance)
    return ContactProblem(matrix, free / size, problem.normals, frictions, compliance), scale


def _natural(problem: ContactProblem, forces: Array) -> float:
    """How far forces are from satisfying all conditions: see `compiled.forces.residual_of`."""
    n = len(forces)
    residual: float = called("residual_of", problem.packed, forces, np.empty(n), np.empty(n))
    return residual


def _newton(problem: ContactProblem, forces: Array) -> tuple[Array, float]:
    """The best iterate of Newton's method, and the size of its residual: see `compiled.forces.newton`."""
    found = forces.astype(float)
    return found, called("newton", problem.packed, found, False)
