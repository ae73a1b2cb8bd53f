"""The forces at one instant, given which contacts can be closed and which friction slides in which direction.

Friction of a joint is up to μ |N|, where the load N is affine in all forces. Along the direction n of N it is up to
μ n·N: one more row of the contact problem, whose force is n·N and acts on nothing. Its direction is that of the
solution before; where loads and friction limit each other, their sizes are thus found together.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.linear_algebra import added
from mbd_sim.simulation.contact.complementarity import block, product, solve
from mbd_sim.simulation.contact.one_sided_model import OneSidedModel, OneSidedTerms
from mbd_sim.simulation.contact.problem import ContactProblem, FrictionLimit, NoSolutionError, contact_forces

LOAD_ITERATIONS = 200
ROUND_OFF, NOISE = 1e-14, 1e-8  # changes of loads, relative to the largest: to be reached, and that of shared forces
LEAST_SHARE = 1e-3  # of a change of loads that is made, down to which that is tried
RIGID = 1e-12  # compliance of rows that are no supports


@dataclass(frozen=True, eq=False)
class FoundForces:
    """λ (rows,), the accelerations (rows,) with them, and the `loads` of joints in N by the friction element.

    Of the k rows that may act, the forces are `unit` (k, k) times those of the rows that are solved for, and constant
    ones; `coupled` (k, k) are the accelerations by unit forces. Accelerations of other rows are those without forces.
    """

    forces: Array
    rates: Array
    loads: Mapping[int, float]
    unit: Array
    coupled: Array


@dataclass(eq=False)
class ForceFinder:
    """Finds forces; it remembers the `directions` of loads, from which it starts again.

    While it looks for forces, loads may have given `sizes` in N instead: where directions go from side to side.

    :param closable: gaps that can be closed.
    :param acting: the rows that may act, in order: those of all gaps that touch, and of their friction and of joints.
    :param forces: λ (rows,) before, which loads have their directions from.
    """

    model: OneSidedModel
    terms: OneSidedTerms
    closable: Sequence[int]
    acting: Sequence[int]
    forces: Array
    directions: dict[int, Array] = field(init=False)
    place: dict[int, int] = field(init=False)
    matrix: Array = field(init=False)  # A (k, k) of the rows that may act
    sizes: dict[int, float] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        self.place = {row: position for position, row in enumerate(self.acting)}
        self.matrix = block(self.terms.matrix, self.acting)
        self.turn(self.forces)

    def places(self, rows: Sequence[int]) -> list[int]:
        """Where rows are among those that may act."""
        return [self.place[row] for row in rows]

    def with_change(self, values: Array, change: Array) -> Array:
        """Numbers of all rows (rows,) with a change of those that may act (k,)."""
        changed = values.copy()
        changed[list(self.acting)] += change
        return changed

    def turn(self, forces: Array) -> None:
        """Let loads have the directions that they have under some forces (rows,)."""
        self.directions = {index: self._direction(index, forces) for index in self.model.loaded}

    def find(
        self, sliding: Mapping[int, Array], sticking: Sequence[int], narrowing: Mapping[int, float]
    ) -> FoundForces:
        """The forces.

        :param sliding: the directions of the friction elements that slide.
        :param narrowing: factors of the limits of some that stick.
        :raises NoSolutionError: no forces are admissible, or none were found.
        """
        kept = dict(self.directions)
        for alone in (False,) if narrowing else (False, True):
            self.sizes = {index: self.terms.load(index, self.forces) for index in kept} if alone else {}
            found = self._iterated(sliding, sticking, narrowing)
            self.sizes, self.directions = {}, dict(kept)
            if found is not None:
                self.turn(found.forces)
                return found
        raise NoSolutionError("friction and the loads on which it depends do not balance")

    def _iterated(
        self, sliding: Mapping[int, Array], sticking: Sequence[int], narrowing: Mapping[int, float]
    ) -> FoundForces | None:
        """The forces with the directions of their loads, or with their sizes where these are set; None without any."""
        before, share = math.inf, 1.0
        for _ in range(LOAD_ITERATIONS):
            found, supposed = self._with_loads(sliding, sticking, narrowing)
            most = max(found.loads.values(), default=0.0)
            change = max((abs(load - supposed[index]) for index, load in found.loads.items()), default=0.0)
            share *= 0.5 if change > 0.9 * before else 1.0  # where they go from side to side
            for index in found.loads:
                turned = self._direction(index, found.forces)
                self.directions[index] = share * turned + (1.0 - share) * self.directions[index]
            if self.sizes:
                self.sizes = {k: share * found.loads[k] + (1.0 - share) * size for k, size in self.sizes.items()}
            if change <= ROUND_OFF * most or 0.5 * before <= change <= NOISE * most:
                return found
            before = change
            if share < LEAST_SHARE:
                break
        return None

    def _direction(self, index: int, forces: Array) -> Array:
        """The unit vector of a load; zero where there is none."""
        load = self.terms.load_vector(index, forces)
        size = math.sqrt(added((load * load).tolist()))
        return load / size if size > 0.0 else load

    def _with_loads(
        self, sliding: Mapping[int, Array], sticking: Sequence[int], narrowing: Mapping[int, float]
    ) -> tuple[FoundForces, dict[int, float]]:
        """The forces with the present directions of loads, or their sizes, and what the loads are with these."""
        model, terms = self.model, self.terms
        unit, constant = self._followers(sliding)
        acting = list(self.acting)
        coupled, free = product(self.matrix, unit), terms.free[acting] + product(self.matrix, constant)
        along = {index: self.load_along(index, unit, constant) for index in self.directions}
        limited = [index for index in sticking if index in along]
        chosen = [*self.closable, *(row for index in sticking for row in model.frictions[index][0])]
        place = {row: position for position, row in enumerate(chosen)}
        size, total, own = len(chosen), len(chosen) + len(limited), self.places(chosen)
        matrix, rates, compliance = np.zeros((total, total)), np.zeros(total), np.full(total, RIGID)
        matrix[:size, :size], rates[:size] = block(coupled, own), free[own]
        compliance[:size] = model.compliance[chosen]
        bears = {index: size + number for number, index in enumerate(limited)}  # the rows of loads
        for index, position in bears.items():
            slopes, without = along[index]
            row = model.frictions[index][0][0]
            scale = float(terms.matrix[row, row]) or 1.0
            matrix[position, :size], matrix[position, position] = -scale * slopes[own], scale
            rates[position] = -scale * without
        limits = []
        for index in sticking:
            rows, gap = model.frictions[index]
            normal = bears.get(index) if gap is None else place[gap]
            coefficient = float(terms.sizes[index, 1] * narrowing.get(index, 1.0))
            limits.append(FrictionLimit(tuple(place[row] for row in rows), normal, coefficient))
        normals = [*(place[gap] for gap in self.closable), *bears.values()]
        solution = contact_forces(ContactProblem(matrix, rates, normals, limits, compliance))[:size]
        forces, accelerations = np.zeros(len(terms.free)), terms.free.copy()
        for column, value in zip(own, solution.tolist(), strict=True):
            constant += unit[:, column] * value
            free += coupled[:, column] * value
        forces[acting], accelerations[acting] = constant, free
        supposed = {
            index: added((slopes[own] * solution).tolist()) + without for index, (slopes, without) in along.items()
        }
        loads = {index: terms.load(index, forces) for index in self.directions}
        return FoundForces(forces, accelerations, loads, unit, coupled), supposed

    def load_along(self, index: int, unit: Array, constant: Array) -> tuple[Array, float]:
        """The load along its direction, as slopes (k,) by the rows that are solved for, and a constant."""
        if self.sizes:
            return np.zeros(len(unit)), self.sizes[index]
        unloaded, by_force = self.terms.loads[index]
        direction = self.directions[index]
        slopes = product(by_force[:, list(self.acting)].T, direction)
        without = added((direction * unloaded).tolist()) + added((slopes * constant).tolist())
        return product(unit.T, slopes), without

    def contact_followers(self, sliding: Mapping[int, Array]) -> tuple[Array, Array]:
        """All forces as `unit` (k, k) times those of some rows, and constant ones (k,), without loads."""
        unit, constant = np.eye(len(self.acting)), np.zeros(len(self.acting))
        for index, direction in sliding.items():
            rows, gap = self.model.frictions[index]
            for row, part in zip(rows, (self.terms.sizes[index, 0] * direction).tolist(), strict=True):
                if gap is not None:
                    unit[self.place[row], self.place[gap]] -= part
                elif index not in self.directions:
                    constant[self.place[row]] -= part
        return unit, constant

    def _followers(self, sliding: Mapping[int, Array]) -> tuple[Array, Array]:
        """As `contact_followers`, with the friction of joints with loads that slides."""
        unit, constant = self.contact_followers(sliding)
        loaded = [index for index in sliding if index in self.directions]
        if not loaded:
            return unit, constant
        rows = self.places([self.model.frictions[index][0][0] for index in loaded])
        factors = [float(self.terms.sizes[index, 0] * sliding[index][0]) for index in loaded]
        along = [self.load_along(index, unit, constant) for index in loaded]
        slopes = np.array([factor * slope for factor, (slope, _) in zip(factors, along, strict=True)])
        offsets = np.array([factor * without for factor, (_, without) in zip(factors, along, strict=True)])
        coupling = np.eye(len(rows)) + slopes[:, rows]
        for column in range(len(unit)):
            unit[rows, column] = 0.0 if column in rows else -solve(coupling, slopes[:, column])
        constant[rows] = -solve(coupling, offsets)
        return unit, constant
