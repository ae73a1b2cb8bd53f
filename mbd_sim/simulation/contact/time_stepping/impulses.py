"""The impulses of one step of time stepping: what all contacts together exert in it, with the laws of impacts.

v_N⁺ + e v_N⁻ ≥ 0, Λ_N ≥ 0, one of them zero, with the speeds v⁻ at the start of the step and v⁺ at its end; friction up
to μ Λ_N against the slip at the end. Contacts that stay closed do not move, so that Λ/h is then their mean force.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.linear_algebra import added
from mbd_sim.simulation.contact.candidate_forces import LOAD_ITERATIONS
from mbd_sim.simulation.contact.candidates import RESTING, euclidean_norm
from mbd_sim.simulation.contact.complementarity import best_conditioned, least_solution, product
from mbd_sim.simulation.contact.impact import ELASTIC_REST, GAIN, largest_factor
from mbd_sim.simulation.contact.one_sided_model import OneSidedModel, OneSidedTerms
from mbd_sim.simulation.contact.problem import ContactProblem, FrictionLimit, nearest_forces

SETTLED = 1e-12  # relative change of the loads of joints


@dataclass(frozen=True, eq=False)
class StepImpulses:
    """The `impulses` (rows,) of a step of some `length` in s, the rates (rows,) at its end, and the `losses` in J.

    `hits` are the gaps that approach faster than contacts at rest. `factor` is 1, or what the coefficients of
    restitution were reduced by, and `residual` how far the impulses are from satisfying all laws, relative to their
    size.
    """

    length: float
    impulses: Array
    rates: Array
    losses: tuple[float, float]
    hits: tuple[int, ...]
    factor: float
    residual: float


class ImpulseLaws:
    """The laws of contacts in a step of `h` s, for some `gaps` that are closed in it.

    :param terms: those of the configuration in which the impulses act.
    :param before: the rates (rows,) at the start of the step, and `free` (rows,) those at its end without impulses.
    :param e: the coefficients of restitution (gaps,), and `rest` (rows,) the speeds below which contacts are at rest.
    """

    def __init__(
        self,
        model: OneSidedModel,
        terms: OneSidedTerms,
        before: Array,
        free: Array,
        e: Array,
        rest: Array,
        gaps: Sequence[int],
        h: float,
    ) -> None:
        self._model, self._terms, self._before, self._free, self._h = model, terms, before, free, h
        slow = np.where(e == 1.0, ELASTIC_REST * model.speeds[: len(e)], rest[: len(e)])
        self._hits = tuple(gap for gap in gaps if before[gap] < -slow[gap])
        self._rebound = np.zeros(len(free))
        self._rebound[list(self._hits)] = e[list(self._hits)] * before[list(self._hits)]
        self._gaps, self._rest = list(gaps), rest
        self._elements = [
            index for index, (_, gap) in enumerate(model.frictions)
            if (gap is None or gap in gaps) and float(np.max(terms.sizes[index])) > 0.0
        ]  # fmt: skip
        self._rows = [*gaps, *(row for index in self._elements for row in model.frictions[index][0])]

    def solved(self) -> StepImpulses:
        """The impulses; where Newton's law would add energy, with the largest restitution that adds none."""
        factor, (impulses, rates, residual) = 1.0, self._with_factor(1.0)
        losses = self._losses(impulses, rates)
        exchanged = 0.5 * float(np.sum(np.abs(impulses * self._before)))
        if np.any(self._rebound) and added(losses) < -GAIN * exchanged:
            factor = largest_factor(
                lambda trial: added(self._losses(*self._with_factor(trial)[:2])), added(losses), GAIN * exchanged
            )
            impulses, rates, residual = self._with_factor(factor)
            losses = self._losses(impulses, rates)
        return StepImpulses(self._h, impulses, rates, losses, self._hits, factor, residual)

    def _losses(self, impulses: Array, rates: Array) -> tuple[float, float]:
        """What normal impulses and friction dissipate: impulses at the mean of the speeds before and after."""
        lost, gaps = -0.5 * impulses * (self._before + rates), self._model.layout.gaps
        return added(lost[:gaps].tolist()), added(lost[gaps:].tolist())

    def _with_factor(self, factor: float) -> tuple[Array, Array, float]:
        """Impulses, rates and the residual, with restitution reduced by a factor."""
        model, rows = self._model, self._rows
        place = {row: position for position, row in enumerate(rows)}
        matrix, normals = self._terms.matrix[rows][:, rows], range(len(self._gaps))
        right = (self._free + factor * self._rebound)[rows]
        impulses, loads = np.zeros(len(self._free)), dict.fromkeys(model.loaded, 0.0)
        for _ in range(LOAD_ITERATIONS if loads else 1):
            known, loads = loads, {index: self._load(index, impulses) for index in loads}
            change = max((abs(loads[index] - known[index]) for index in loads), default=0.0)
            if known and np.any(impulses) and change <= SETTLED * max(loads.values()):
                break
            limits = [self._limit(index, place, loads.get(index)) for index in self._elements]
            problem = ContactProblem(matrix, right, normals, limits, model.compliance[rows])
            impulses[rows], residual = nearest_forces(problem)
        return impulses, self._free + product(self._terms.matrix, impulses), residual

    def _limit(self, index: int, place: dict[int, int], load: float | None) -> FrictionLimit:
        """The limit of an element: that of friction at rest where it does not slip at the start of the step."""
        rows, gap = self._model.frictions[index]
        at_rest = euclidean_norm(self._before[list(rows)]) <= self._rest[rows[0]]
        size = float(self._terms.sizes[index, 1 if at_rest else 0])
        own = tuple(place[row] for row in rows)
        if gap is not None:
            return FrictionLimit(own, place[gap], size)
        return FrictionLimit(own, None, size * (self._h if load is None else load))

    def _load(self, index: int, impulses: Array) -> float:
        """What a joint transmits in the step, in N·s, but for what impacts do: no friction belongs to that."""
        steady = impulses.copy()
        steady[list(self._hits)] = 0.0
        return self._h * self._terms.load(index, steady / self._h)


def resting_modes(model: OneSidedModel, terms: OneSidedTerms, found: StepImpulses, modes: Array) -> None:
    """Write modes at the end of a step, without sliding: closed are gaps that have borne something and do not open."""
    layout, still = model.layout, RESTING * model.speeds
    modes[: layout.given.stop] = 0.0
    closed = [g for g in range(layout.gaps) if found.impulses[g] > 0.0 and found.rates[g] <= still[g]]
    modes[closed] = 1.0
    sticking = [
        row for index, (rows, gap) in enumerate(model.frictions) for row in rows
        if (gap is None or gap in closed) and terms.sizes[index, 1] > 0.0 and not _slip(model, index, found)
    ]  # fmt: skip
    rows, first = [*closed, *sticking], layout.active.start
    basis = best_conditioned(terms.matrix, rows)
    dependent = [row for row in rows if row not in basis]
    modes[[first + row for row in basis]] = model.compliance[basis] if dependent else 1.0
    modes[[first + row for row in dependent]] = -model.compliance[dependent]


def add_sliding(model: OneSidedModel, terms: OneSidedTerms, found: StepImpulses, modes: Array) -> None:
    """Write the directions of sliding, and the signs of loads, into the modes at the end of a step."""
    layout = model.layout
    first = layout.direction.start - layout.gaps
    for index, (rows, gap) in enumerate(model.frictions):
        speed = _slip(model, index, found)
        if speed and (gap is None or modes[gap]):
            modes[[first + row for row in rows]] = found.rates[list(rows)] / speed
            if index in model.loaded:
                modes[layout.active.start + rows[0]] = 1.0
    model.set_signs(terms, found.impulses / found.length, modes)
    if not found.hits:
        _share(model, terms, found, modes)


def _share(model: OneSidedModel, terms: OneSidedTerms, found: StepImpulses, modes: Array) -> None:
    """Write what forces that depend on each other have in the step beyond the least ones, so that they are read so."""
    layout, weights = model.layout, modes[model.layout.active]
    if not np.any(weights < 0.0):
        return
    unit, first = np.eye(layout.rows), layout.direction.start - layout.gaps
    for index, (rows, gap) in enumerate(model.frictions):
        if gap is not None:
            unit[list(rows), gap] -= terms.sizes[index, 0] * modes[[first + row for row in rows]]
    chosen = np.flatnonzero(weights).tolist()
    coupled, forces = product(terms.matrix, unit)[chosen][:, chosen], found.impulses[chosen] / found.length
    least = least_solution(coupled, product(coupled, forces), np.abs(weights[chosen]))
    modes[model.layout.given][chosen] = forces - least


def _slip(model: OneSidedModel, element: int, found: StepImpulses) -> float:
    """The speed with which friction slips at the end of a step; 0 where it sticks."""
    rows = model.frictions[element][0]
    speed = euclidean_norm(found.rates[list(rows)])
    return speed if speed > RESTING * model.speeds[rows[0]] else 0.0
