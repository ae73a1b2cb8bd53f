"""The contacts that can be closed at one instant, and the forces that keep the accelerations of all of them admissible.

Where forces of friction at rest are indeterminate, they are distributed so that none is near its limit if possible.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.contact.equations import RELEASED
from mbd_sim.simulation.contact.complementarity import independent, least_solution, product
from mbd_sim.simulation.contact.problem import ContactProblem, FrictionLimit, NoSolutionError, contact_forces
from mbd_sim.simulation.contact.search import STOPPED
from mbd_sim.simulation.contact.terms import Mask, OneSidedModel, OneSidedReadings, OneSidedTerms

RESTING = 1e-10  # of the natural speed, up to which a speed counts as zero
YIELDING = 1.0 - 1e-8  # of its limit, that friction bears which has just reached it
UNMOVED = 1e-9  # acceleration, relative to those without contact forces, that counts as zero
RESERVES = (0.5, 0.75, 0.9, *(1.0 - 3.0**-k for k in range(3, 20)))  # of limits, tried where friction is shared
REPEATS = 6  # with the normal forces found, which friction at its limit has changed a little
NEAR = 0.95  # of its limit, beyond which shared friction is distributed in another way if possible
SHARED = 1.0 - 2e-11  # of its limit, that friction bears at most which depends on other sticking friction
PLIANT = 1e-3  # weight of changes of shared friction beside that of normal forces, which so stay as they are
LEAST = 1e-2  # of the largest reserve of friction, that counts at least
EQUAL = 1e-8  # relative difference of forces that counts as none
ATTEMPTS, LOAD_ITERATIONS = 20, 200


@dataclass(frozen=True)
class Forced:
    """What an event has decided: gaps that `open`, and friction elements that begin to slide.

    `yielding` elements have reached their limit; they slide in the direction in which their forces and accelerations
    agree. Those in `slides` bear their limit in a given direction.
    """

    open: frozenset[int] = frozenset()
    yielding: frozenset[int] = frozenset()
    slides: Mapping[int, tuple[float, ...]] = field(default_factory=dict)


NOTHING_FORCED = Forced()


class Candidates:
    """The contacts that can be closed, and the problem for their forces."""

    def __init__(
        self, model: OneSidedModel, readings: OneSidedReadings, terms: OneSidedTerms, touching: Mask, forced: Forced
    ) -> None:
        self._model, self._readings, self._terms, self._forced = model, readings, terms, forced
        gaps = model.layout.gaps
        resting = readings.rates[:gaps] <= RESTING * model.speeds[:gaps]
        self._touching = [index for index in range(gaps) if touching[index] and resting[index]]
        self._closable = [index for index in self._touching if index not in forced.open]
        self._loads = {index: terms.load(index, readings.forces) for index in model.loaded}
        self._direction: dict[int, Array] = {}
        self._share = 1.0  # of the limits of friction at rest
        self._pressures: Array | None = None  # normal forces from which these limits follow
        self._coupled = terms.matrix  # A with the friction of what slides
        self._sticking: list[int] = []
        self._released: list[int] = []  # without slip, and without any capacity at present
        for index, (rows, gap) in enumerate(model.frictions):
            if gap is not None and gap not in self._touching:
                continue
            slip = readings.rates[list(rows)]
            if index in forced.slides:
                self._direction[index] = np.array(forced.slides[index])
            elif (speed := euclidean_norm(slip)) > (RESTING if len(rows) == 1 else STOPPED) * model.speeds[rows[0]]:
                self._direction[index] = slip / speed
            elif terms.sizes[index, 1] > 0.0 and gap not in forced.open:
                self._sticking.append(index)
            elif gap is None and index not in self._loads:
                self._released.append(index)

    def solved(self, before: Array) -> tuple[Array, Forced | None]:
        """The modes, or what of the forced decisions must be withdrawn.

        :param before: the modes until now, of which the signs of loads may stay.

        :raises NoSolutionError: see `ModeFinder.find`.
        """
        for _ in range(ATTEMPTS):
            forces, rates = self._forces_and_loads()
            slipping = self._slipping(forces, rates)
            if not slipping and self._share == 1.0:
                if (reserved := self._with_reserve(forces, rates)) is not None:
                    forces, rates = reserved
                    break
                self._share = RESERVES[-1]  # so near to its limits, all of it begins to slide
                continue
            if not slipping:
                break
            for index, direction in slipping.items():
                self._direction[index] = direction
                self._sticking.remove(index)
        size = self._unmoved
        for index in self._released:
            acceleration = rates[list(self._model.frictions[index][0])]
            if (change := euclidean_norm(acceleration)) > size[self._model.frictions[index][0][0]]:
                self._direction[index] = acceleration / change
        for gap in sorted(self._forced.open & set(self._touching)):
            if rates[gap] < -size[gap]:
                return np.zeros(0), replace(self._forced, open=self._forced.open - {gap})
        for index, given in self._forced.slides.items():
            rows = list(self._model.frictions[index][0])
            at_rest = euclidean_norm(self._readings.rates[rows]) <= RESTING * self._model.speeds[rows[0]]
            if index in self._direction and at_rest and sum((rates[rows] * given).tolist()) < -size[rows[0]]:
                rest = {other: kept for other, kept in self._forced.slides.items() if other != index}
                return np.zeros(0), replace(self._forced, slides=rest)
        return self._modes(forces, rates, size, before), None

    @property
    def _unmoved(self) -> Array:
        """The accelerations (rows,) that count as zero."""
        units = self._model.speeds * self._model.units.rate
        return UNMOVED * units * (1.0 + float(np.max(np.abs(self._terms.free) / units, initial=0.0)))

    def _forces_and_loads(self) -> tuple[Array, Array]:
        """The forces of `_forces`, and the loads of joints that follow from them."""
        for _ in range(LOAD_ITERATIONS):
            forces, rates = self._forces()
            loads = {index: self._terms.load(index, forces) for index in self._loads}
            change = max((abs(loads[index] - load) for index, load in self._loads.items()), default=0.0)
            self._loads = loads
            if change <= 1e-14 * max(loads.values(), default=0.0):
                return forces, rates
        raise NoSolutionError("friction and the loads on which it depends do not balance")

    def _forces(self) -> tuple[Array, Array]:
        """λ (rows,) of all rows, and the accelerations (rows,) with them."""
        model, terms = self._model, self._terms
        n = model.layout.rows
        matrix, free = terms.matrix.copy(), terms.free.copy()
        unit = np.eye(n)  # the forces of all rows by a unit force of each normal row
        constant = np.zeros(n)
        for index, direction in self._direction.items():
            rows, gap = model.frictions[index]
            size = terms.sizes[index, 0] * self._loads.get(index, 1.0)
            for row, part in zip(rows, direction.tolist(), strict=True):
                if gap is None:
                    constant[row] -= size * part
                    free += matrix[:, row] * (-size * part)
                else:
                    unit[row, gap] -= size * part
        for index, direction in self._direction.items():
            rows, gap = model.frictions[index]
            if gap is not None:
                for row, part in zip(rows, direction.tolist(), strict=True):
                    matrix[:, gap] -= terms.matrix[:, row] * (terms.sizes[index, 0] * part)
        self._coupled = matrix
        chosen = [*self._closable, *(row for index in self._sticking for row in model.frictions[index][0])]
        place = {row: position for position, row in enumerate(chosen)}
        limits = [self._limit(index, place) for index in self._sticking]
        normals = [place[gap] for gap in self._closable]
        compliance = model.compliance[chosen]
        solution = contact_forces(ContactProblem(matrix[chosen][:, chosen], free[chosen], normals, limits, compliance))
        forces, rates = constant, free.copy()
        for row, value in zip(chosen, solution.tolist(), strict=True):
            forces += unit[:, row] * value
            rates += matrix[:, row] * value
        return forces, rates

    def _limit(self, index: int, place: Mapping[int, int]) -> FrictionLimit:
        """The limit of friction at rest; `place` has those of rows in the problem."""
        (rows, gap), size = self._model.frictions[index], self._static(index)
        own = tuple(place[row] for row in rows)
        if gap is None or self._pressures is None:
            return FrictionLimit(own, None if gap is None else place[gap], size)
        return FrictionLimit(own, None, size * float(self._pressures[gap]))

    def _with_reserve(self, forces: Array, rates: Array) -> tuple[Array, Array] | None:
        """Other forces with the same accelerations, with which friction that is shared is further from its limits.

        None: there is no reserve.
        """
        if len(self._sticking) < 2 or not any(self._use(index, forces) > NEAR for index in self._sticking):
            return forces, rates
        rows = [row for index in self._sticking for row in self._model.frictions[index][0]]
        rows += [gap for gap in self._closable if forces[gap] > 0.0]
        if len(independent(self._terms.matrix, rows)) == len(rows):
            return forces, rates
        best, low, high = None, 0, len(RESERVES)
        while low < high:  # with a larger share there is a solution as well
            middle = (low + high) // 2
            if (found := self._with_share(RESERVES[middle], forces, rates)) is None:
                low = middle + 1
            else:
                best, high = found, middle
        return best

    def _with_share(self, share: float, forces: Array, rates: Array) -> tuple[Array, Array] | None:
        """Forces with these accelerations and at most a share of the limits of friction at rest, if there are any."""
        found = forces
        for _ in range(REPEATS):
            self._share, self._pressures = share, found
            try:
                found, others = self._forces_and_loads()
            except NoSolutionError:
                return None
            finally:
                self._share, self._pressures = 1.0, None
            if not np.all(np.abs(others - rates) <= self._unmoved):
                return None
            if all(self._use(index, found) <= 0.5 * (1.0 + share) for index in self._sticking):
                return found, others
        return None

    def _use(self, index: int, forces: Array) -> float:
        """The fraction of its limit that sticking friction bears."""
        rows, gap = self._model.frictions[index]
        limit = self._static(index) * (1.0 if gap is None else float(forces[gap]))
        return euclidean_norm(forces[list(rows)]) / limit if limit > 0.0 else 0.0

    def _static(self, index: int) -> float:
        """The limit of an element's friction at rest, for a unit force of its gap if it has one."""
        limit = float(self._terms.sizes[index, 1] * self._loads.get(index, 1.0)) * self._share
        return limit * YIELDING if index in self._forced.yielding else limit

    def _slipping(self, forces: Array, rates: Array) -> dict[int, Array]:
        """Sticking elements that begin to slide, with the direction of that; friction is then at its limit."""
        found, unmoved = {}, self._unmoved
        for index in self._sticking:
            rows, gap = self._model.frictions[index]
            load = 1.0 if gap is None else forces[gap]
            force, limit = forces[list(rows)], self._static(index) * load
            size, acceleration = euclidean_norm(force), rates[list(rows)]
            if size >= limit * (1.0 - 1e-9) and (change := euclidean_norm(acceleration)) > unmoved[rows[0]]:
                found[index] = -force / size if size > 0.0 else acceleration / change
        return found

    def _modes(self, forces: Array, rates: Array, size: Array, before: Array) -> Array:
        model, layout = self._model, self._model.layout
        modes = np.zeros(layout.modes.stop)
        modes[layout.signs] = before[layout.signs]
        closed = [gap for gap in self._closable if forces[gap] > 0.0 or abs(rates[gap]) <= size[gap]]
        closed += self._held(closed, rates, size)
        modes[closed] = 1.0
        sticking = [index for index in self._sticking if model.frictions[index][1] in (None, *closed)]
        self._activate(closed, sticking, forces, modes)
        first = layout.direction.start - layout.gaps
        for index in self._released:
            modes[first + model.frictions[index][0][0]] = RELEASED
        for index, direction in self._direction.items():
            rows, gap = model.frictions[index]
            if index in self._loads:
                modes[layout.active.start + rows[0]] = 1.0
            if gap is None or gap in closed:
                for row, part in zip(rows, direction.tolist(), strict=True):
                    modes[first + row] = part
        model.set_signs(self._terms, forces, modes)
        return modes

    def _held(self, closed: list[int], rates: Array, size: Array) -> list[int]:
        """Of the gaps that were to open, those which the closed ones hold: without force on elastic supports."""
        still = [gap for gap in sorted(self._forced.open & set(self._touching)) if abs(rates[gap]) <= size[gap]]
        rank = len(independent(self._terms.matrix, closed)) if still else 0
        return [gap for gap in still if len(independent(self._terms.matrix, [*closed, gap])) == rank]

    def _activate(self, closed: list[int], sticking: list[int], forces: Array, modes: Array) -> None:
        """Write into the modes which rows are solved for: all that bear a force, and independent ones without."""
        model, matrix = self._model, self._terms.matrix
        rows = sorted(closed, key=lambda gap: (-forces[gap], gap))
        rows += [row for index in sticking for row in model.frictions[index][0]]
        able = {row for index in self._limits(sticking, forces) for row in model.frictions[index][0]}
        shares = [row for row in rows if forces[row] or row in able]
        chosen = independent(matrix, [*shares, *(row for row in rows if row not in shares)])
        first = model.layout.active.start
        modes[[first + row for row in chosen]] = 1.0
        if len(chosen) == len(rows):
            return
        weights = np.zeros(len(forces))
        weights[shares] = model.compliance[shares]
        if not self._are_least(self._coupled, shares, forces, weights):
            pliant, kept = self._pliant(sticking, forces, weights), self._with_kept_shares(sticking, shares, forces)
            if any(index in self._loads for index in sticking) or self._are_least(*kept, pliant):
                weights = pliant
                self._keep_shares(sticking, forces, modes)
            else:  # friction wedges the mechanism: normal forces depend on it
                shares = [row for row in shares if row < model.layout.gaps]
                chosen = independent(matrix, [*shares, *(row for row in rows if row not in shares)])
                modes[[first + row for row in rows]] = 0.0
                modes[[first + row for row in chosen]] = 1.0
                dependent = [index for index in sticking if not set(model.frictions[index][0]) <= set(chosen)]
                self._keep_shares(dependent, forces, modes, but=chosen)
        modes[[first + row for row in shares]] = -weights[shares]

    def _limits(self, sticking: list[int], forces: Array) -> dict[int, float]:
        """What friction at rest can bear, where that is more than zero and no load of a joint."""
        sizes, found = self._terms.sizes, dict[int, float]()
        for index in sticking:
            gap = self._model.frictions[index][1]
            limit = float(sizes[index, 1]) * (1.0 if gap is None else float(forces[gap]))
            if index not in self._loads and limit > 0.0:
                found[index] = limit
        return found

    def _are_least(self, matrix: Array, rows: list[int], forces: Array, weights: Array) -> bool:
        """Whether forces are those of elastic supports: others bear what friction, at its limits, leaves them."""
        matrix, given = matrix[rows][:, rows], forces[rows]
        least = least_solution(matrix, product(matrix, given), weights[rows])
        return bool(np.max(np.abs(least - given), initial=0.0) <= EQUAL * np.max(np.abs(given), initial=0.0))

    def _with_kept_shares(self, sticking: list[int], rows: list[int], forces: Array) -> tuple[Array, list[int], Array]:
        """A where friction at rest bears its share of its limits, the rows, and the forces besides."""
        matrix, rest = self._coupled.copy(), forces.copy()
        for index in self._limits(sticking, forces):
            own, gap = self._model.frictions[index]
            rest[list(own)] = 0.0
            if gap is not None:
                for row in own:
                    matrix[:, gap] += self._terms.matrix[:, row] * (forces[row] / forces[gap])
        return matrix, rows, rest

    def _pliant(self, sticking: list[int], forces: Array, weights: Array) -> Array:
        """Weights with which changes are distributed by what friction can still bear."""
        limits, changed = self._limits(sticking, forces), weights.copy()
        own = {index: list(self._model.frictions[index][0]) for index in limits}
        reserves = {index: limit - euclidean_norm(forces[own[index]]) for index, limit in limits.items()}
        largest = max(reserves.values(), default=0.0) or 1.0
        for index, rows in own.items():
            changed[rows] = self._model.compliance[rows] * PLIANT / max(reserves[index] / largest, LEAST)
        return changed

    def _keep_shares(self, sticking: list[int], forces: Array, modes: Array, but: Sequence[int] = ()) -> None:
        """Let friction at rest keep its share of its limits, except in some rows."""
        first = self._model.layout.direction.start - self._model.layout.gaps
        for index, limit in self._limits(sticking, forces).items():
            rows = self._model.frictions[index][0]
            shares = [0.0 if row in but else -float(forces[row]) / limit for row in rows]
            size = euclidean_norm(shares)
            for row, share in zip(rows, shares, strict=True):
                modes[first + row] = share * min(1.0, SHARED / size) if size else 0.0


def euclidean_norm(vector: Sequence[float] | Array) -> float:
    """The length of a vector, summed in the order of its components."""
    return math.sqrt(sum(float(value) * float(value) for value in vector))


class ModeFinder:
    """Finds the modes of a contact model; `touching` is the gap in natural units that counts as zero."""

    def __init__(self, model: OneSidedModel, touching: float) -> None:
        self._model, self._touching = model, touching

    def is_touching(self, readings: OneSidedReadings) -> Mask:
        """Which gaps (gaps,) are zero; for clutches, whether they do not slip."""
        clutches = self._model.clutches
        limit = np.where(clutches, RESTING, self._touching)
        return np.asarray(readings.gaps <= limit * self._model.gap_units, dtype=bool)

    def find(self, time: float, y: Array, inputs: Array, forced: Forced = NOTHING_FORCED) -> Array:
        """The modes (see `OneSidedLayout.modes`) at a state without approaching contacts.

        :raises NoSolutionError: no forces are admissible.
        """
        inputs = inputs.copy()
        for _ in range(ATTEMPTS):
            readings, terms = self._model.readings(time, y, inputs), self._model.terms(time, y, inputs)
            state = Candidates(self._model, readings, terms, self.is_touching(readings), forced)
            modes, wrong = state.solved(self._model.modes(inputs))
            if wrong is not None:
                forced = wrong
                continue
            self._model.modes(inputs)[:] = modes
            guards = self._model.readings(time, y, inputs)
            overloaded = self._overloaded(guards, terms, modes)
            if not overloaded:
                return modes
            forced = Forced(forced.open, forced.yielding, {**forced.slides, **overloaded})
        raise NoSolutionError("the contacts keep changing their states")

    def _overloaded(self, found: OneSidedReadings, terms: OneSidedTerms, modes: Array) -> dict[int, tuple[float, ...]]:
        """Sticking elements that carry more than they can, with the direction in which each is loaded.

        That happens where several share a load that is indeterminate. Each then bears as much as it can.
        """
        model, overloaded = self._model, dict[int, tuple[float, ...]]()
        sliding, active = model.sliding(modes), modes[model.layout.active]
        scale = model.loads * (1.0 + float(np.max(np.abs(found.forces) / model.loads, initial=0.0)))
        for index, (rows, gap) in enumerate(model.frictions):
            if index in sliding or not any(active[list(rows)]):
                continue
            force = found.forces[list(rows)]
            load = (
                terms.load(index, found.forces) if index in model.loaded else 1.0 if gap is None else found.forces[gap]
            )
            if (size := euclidean_norm(force)) > terms.sizes[index, 1] * load + 1e-9 * scale[rows[0]]:
                overloaded[index] = tuple((-force / size).tolist())
        return overloaded
