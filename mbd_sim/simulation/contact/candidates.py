"""The contacts that can be closed at one instant, and the forces that keep the accelerations of all of them admissible.

Where forces of friction at rest are indeterminate, they are distributed so that none is near its limit if possible.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.linear_algebra import added
from mbd_sim.dynamics.contact.one_sided_equations import HELD, RELEASED
from mbd_sim.simulation.contact.candidate_forces import ForceFinder
from mbd_sim.simulation.contact.centering import centered
from mbd_sim.simulation.contact.compiled.slip import STOPPED
from mbd_sim.simulation.contact.complementarity import (
    best_conditioned,
    block,
    independent,
    least,
    least_solution,
    null_space,
    pivots,
    product,
)
from mbd_sim.simulation.contact.one_sided_model import Mask, OneSidedModel, OneSidedReadings, OneSidedTerms
from mbd_sim.simulation.contact.problem import NoSolutionError

RESTING = 1e-10  # of the natural speed, up to which a speed counts as zero
UNMOVED = 1e-9  # acceleration, relative to those without contact forces, that counts as zero
AT_LIMIT = 1.0 - 1e-9  # use of its limit, from which on friction at rest has reached it
FORCE_ROUND_OFF = 1e-8  # of the largest force, up to which the forces found are those of elastic supports
BORNE = 1e-10  # of the largest force, up to which a row bears none: it has just become zero, or is about to
PULL = 1e-9  # of the largest force, beyond which a contact that pulls is not the round-off of one without force
NEARLY = 1e-3  # of the forces, that friction may lack beside elastic supports: root of `SOFTNESS`
SOFTEST = 1e-8  # least weight of friction beside the largest one: with the square root of the round-off it is accurate
NARROWINGS = (0.5, 0.1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7)  # parts of their limits that friction has as reserve
SMALLEST = 1e-12  # of the natural force, below which limits are round-off
NARROWED_SOFTEST = 1e-4  # the same as `SOFTEST` within narrower limits, where normal forces share as well
ATTEMPTS = 20


@dataclass(frozen=True)
class Forced:
    """What an event has decided: gaps that `open`, and friction elements that begin to slide, or go on sliding.

    `yielding` elements have reached their limit; they slide in the direction in which their forces and accelerations
    agree, or in that of their slip. Those that are `overloaded` would exceed their limit as they share the load between
    events. Those that are `sliding` do not stop, however slow they are: the event is another one.
    """

    open: frozenset[int] = frozenset()
    yielding: frozenset[int] = frozenset()
    overloaded: frozenset[int] = frozenset()
    sliding: frozenset[int] = frozenset()


NOTHING_FORCED = Forced()


class Candidates:
    """The contacts that can be closed, and the problem for their forces."""

    def __init__(
        self, model: OneSidedModel, readings: OneSidedReadings, terms: OneSidedTerms, touching: Mask, forced: Forced
    ) -> None:
        self._model, self._readings, self._terms, self._forced = model, readings, terms, forced
        gaps = model.layout.gaps
        resting = readings.rates[:gaps] <= RESTING * model.speeds[:gaps]
        self._touching = np.flatnonzero(touching & resting).tolist()
        present, acting = frozenset(self._touching), list(self._touching)
        self._closable = [index for index in self._touching if index not in forced.open]
        self._direction: dict[int, Array] = {}
        self._held: dict[int, Array] = {}  # opposite to friction at its limit, of contacts that others hold
        self._reserves: dict[int, float] = {}  # of friction at rest, once some has reached its limit
        self._narrowing: dict[int, float] = {}  # factors of the limits of friction at rest
        self._sticking: list[int] = []
        self._released: list[int] = []  # without slip, and without any capacity at present
        for index, (rows, gap) in enumerate(model.frictions):
            if gap is not None and gap not in present:
                continue
            acting += rows
            slip = readings.rates[list(rows)]
            slowest = RESTING if len(rows) == 1 or index in forced.yielding | forced.sliding else STOPPED
            if (speed := euclidean_norm(slip)) > slowest * model.speeds[rows[0]]:
                self._direction[index] = slip / speed
            elif terms.sizes[index, 1] > 0.0 and gap not in forced.open:
                self._sticking.append(index)
            elif gap is None and index not in self._model.loaded:
                self._released.append(index)
        self._finder = ForceFinder(model, terms, self._closable, sorted(acting), readings.forces)

    def solved(self, before: Array) -> tuple[Array, Forced | None]:
        """The modes, or what of the forced decisions must be withdrawn.

        :param before: the modes until now, of which the signs of loads may stay.

        :raises NoSolutionError: see `ModeFinder.find`.
        """
        for _ in range(ATTEMPTS):
            forces, rates = self._find_forces()
            if slipping := self._slipping(forces, rates):
                forces, rates = self._nearly_resting(forces, rates)
                slipping = self._slipping(forces, rates)
            self._held, self._reserves, self._narrowed = {}, {}, False
            if not slipping and (limited := self._at_limit(forces)):
                forces = self._with_least_pressures(forces)
                if self._are_held(limited, forces):
                    self._held = self._against(limited, forces)
                else:
                    forces = self._with_reserve(forces)
                    limited = self._at_limit(forces)
                    if limited and (found := self._within_narrower_limits(limited, forces)) is not None:
                        forces, rates = found
                    slipping = self._yielding(forces)
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
        return self._modes(forces, rates, size, before), None

    @cached_property
    def _unmoved(self) -> Array:
        """The accelerations (rows,) that count as zero."""
        units = self._model.speeds * self._model.units.rate
        return UNMOVED * units * (1.0 + float(np.max(np.abs(self._terms.free) / units, initial=0.0)))

    def _find_forces(self) -> tuple[Array, Array]:
        """λ (rows,) of all rows, and the accelerations (rows,) with them."""
        self._found = self._finder.find(self._direction, self._sticking, self._narrowing)
        return self._found.forces, self._found.rates

    def _nearly_resting(self, forces: Array, rates: Array) -> tuple[Array, Array]:
        """Forces and accelerations; where friction at rest that is shared almost balances, with what it lacks.

        Whether it can bear that is decided by its reserve: elastic supports yield without bound as it is used up.
        Rows that cannot all rest, as of two wheels on one axle while it rolls over, have to slide.
        """
        chosen = [gap for gap in self._closable if forces[gap] > 0.0]
        chosen += [row for index in self._able(forces) for row in self._model.frictions[index][0]]
        places = self._finder.places(chosen)
        matrix = block(self._found.coupled, places)
        if len(pivots(matrix)) == len(chosen):
            return forces, rates
        own = self._model.compliance[chosen]
        change, scale = least_solution(matrix, -rates[chosen], own), np.sqrt(own)
        if np.max(np.abs(scale * change)) > NEARLY * np.max(np.abs(scale * forces[chosen])):
            return forces, rates
        balanced = self._finder.with_change(rates, product(self._found.coupled[:, places], change))
        if np.any(np.abs(balanced[chosen]) > self._unmoved[chosen]):
            return forces, rates
        return self._finder.with_change(forces, product(self._found.unit[:, places], change)), balanced

    def _with_reserve(self, forces: Array) -> Array:
        """Other friction at rest with the same effect, as far from its limits as possible."""
        able = [index for index in self._able(forces) if index not in self._model.loaded]
        limits = [self._limit(index, forces) for index in able]
        rows = [self._model.frictions[index][0] for index in able]
        if sum(map(len, rows)) < 2:  # nothing to share
            return forces
        forces, shared = centered(self._terms.matrix, rows, limits, forces)
        self._reserves = {able[k]: limits[k] * (1.0 - self._use(able[k], forces)) for k in shared}
        return forces

    def _within_narrower_limits(self, limited: Sequence[int], forces: Array) -> tuple[Array, Array] | None:
        """Forces and accelerations within narrower limits, with which no more slides; None without any.

        Friction at its limit that others hold along one direction only, or together with normal forces or the friction
        of joints with loads, cannot slide against its force: it is distributed in another way.
        """
        shared = self._entangled(forces)
        if shared.isdisjoint(limited):
            return None
        best, largest, last = self._found, 0, len(NARROWINGS)
        while largest < last:
            middle = (largest + last) // 2
            self._narrowing = dict.fromkeys(shared, 1.0 - NARROWINGS[middle])
            try:
                is_borne = not self._slipping(*self._find_forces())
            except NoSolutionError:
                is_borne = False
            if is_borne:
                best, last, self._narrowed = self._found, middle, True
            else:
                largest = middle + 1
        self._found, self._narrowing = best, {}
        if not self._narrowed:
            return None
        forces = best.forces
        self._reserves = {k: self._limit(k, forces) * (1.0 - self._use(k, forces)) for k in sorted(shared)}
        return forces, best.rates

    def _entangled(self, forces: Array) -> frozenset[int]:
        """Friction at rest that depends on other rows, at least along one direction."""
        rows = {index: list(self._model.frictions[index][0]) for index in self._able(forces)}
        pressed = [gap for gap in self._closable if forces[gap] > 0.0]
        rank = len(independent(self._terms.matrix, [*pressed, *(row for own in rows.values() for row in own)]))
        others = {k: [*pressed, *(row for index in rows if index != k for row in rows[index])] for k in rows}
        return frozenset(k for k in rows if len(independent(self._terms.matrix, others[k])) + len(rows[k]) > rank)

    def _with_least_pressures(self, forces: Array) -> Array:
        """The normal forces of equal elastic supports beside given friction; sliding friction follows them."""
        solved = [*self._closable, *(row for index in self._sticking for row in self._model.frictions[index][0])]
        pressed = [gap for gap in self._closable if forces[gap] > 0.0]
        if not pressed:
            return forces
        places = self._finder.places(pressed)
        free = null_space(self._found.coupled[self._finder.places(solved)][:, places])
        change = least(forces[pressed], free, self._model.compliance[pressed]) - forces[pressed]
        return self._finder.with_change(forces, product(self._found.unit[:, places], change))

    def _are_held(self, limited: Sequence[int], forces: Array) -> bool:
        """Whether other contacts hold those whose friction is at its limit, so that it can stay there."""
        if not self._found.loads.keys().isdisjoint(limited):
            return False
        others = [gap for gap in self._closable if forces[gap] > 0.0]
        able = [index for index in self._able(forces) if index not in limited]
        others += [row for index in able for row in self._model.frictions[index][0]]
        rows = [row for index in limited for row in self._model.frictions[index][0]]
        return len(independent(self._terms.matrix, [*others, *rows])) == len(independent(self._terms.matrix, others))

    def _yielding(self, forces: Array) -> dict[int, Array]:
        """Friction at its limit that has to yield, or has no reserve, with the direction of sliding."""
        forced = self._forced.yielding | self._forced.overloaded
        limited = [index for index in self._at_limit(forces) if index in forced or self._reserves]
        return self._against(limited, forces)

    def _at_limit(self, forces: Array) -> list[int]:
        overloaded = self._forced.overloaded - self._reserves.keys()
        uses = {index: self._use(index, forces) for index in self._sticking}
        return [index for index, use in uses.items() if use >= AT_LIMIT or (use > 0.0 and index in overloaded)]

    def _against(self, elements: Sequence[int], forces: Array) -> dict[int, Array]:
        own = {index: forces[list(self._model.frictions[index][0])] for index in elements}
        return {index: -force / euclidean_norm(force) for index, force in own.items()}

    def _use(self, index: int, forces: Array) -> float:
        """The fraction of its limit that sticking friction bears."""
        limit = self._limit(index, forces)
        return euclidean_norm(forces[list(self._model.frictions[index][0])]) / limit if limit > 0.0 else 0.0

    def _able(self, forces: Array) -> list[int]:
        """Friction at rest that can bear a force: not that of contacts that bear none."""
        least = BORNE * float(np.max(np.abs(forces), initial=0.0))
        return [index for index in self._sticking if self._limit(index, forces) > least]

    def _limit(self, index: int, forces: Array) -> float:
        """The limit of an element's friction at rest."""
        gap = self._model.frictions[index][1]
        return self._static(index) * (1.0 if gap is None else float(forces[gap]))

    def _static(self, index: int) -> float:
        """The limit of an element's friction at rest, for a unit force of its gap if it has one."""
        return float(self._terms.sizes[index, 1] * self._found.loads.get(index, 1.0) * self._narrowing.get(index, 1.0))

    def _slipping(self, forces: Array, rates: Array) -> dict[int, Array]:
        """Sticking elements that begin to slide, with the direction of that; friction is then at its limit.

        That of a gap which opens needs no direction: its gap could be found closed with the one in which it moves while
        it is free, against which it then slides.
        """
        found = {}
        for index in self._sticking:
            rows, gap = self._model.frictions[index]
            if gap is not None and not forces[gap] > 0.0 and rates[gap] > self._unmoved[gap]:
                continue
            force, limit = forces[list(rows)], self._limit(index, forces)
            size, acceleration = euclidean_norm(force), rates[list(rows)]
            at_limit = size >= limit * AT_LIMIT - SMALLEST * self._model.loads[rows[0]]
            if at_limit and (change := euclidean_norm(acceleration)) > self._unmoved[rows[0]]:
                found[index] = -force / size if size > 0.0 else acceleration / change
        return found

    def _modes(self, forces: Array, rates: Array, size: Array, before: Array) -> Array:
        model, layout = self._model, self._model.layout
        modes = np.zeros(layout.size)
        for kept in (layout.signs, layout.features, layout.holders):
            modes[kept] = before[kept]
        closed = [gap for gap in self._closable if forces[gap] > 0.0 or abs(rates[gap]) <= size[gap]]
        closed += self._supported(closed, rates, size)
        modes[closed] = 1.0
        able = [index for index in self._sticking if model.frictions[index][1] in (None, *closed)]
        sticking = [index for index in able if index not in self._held]
        self._activate(closed, sticking, forces, modes)
        first = layout.direction.start - layout.gaps
        for index in self._released:
            modes[first + model.frictions[index][0][0]] = RELEASED
        held = {index: HELD * direction for index, direction in self._held.items()}
        for index, direction in {**self._direction, **held}.items():
            rows, gap = model.frictions[index]
            if index in self._model.loaded and not modes[layout.active][rows[0]]:
                modes[layout.active.start + rows[0]] = 1.0
            if gap is None or gap in closed:
                for row, part in zip(rows, direction.tolist(), strict=True):
                    modes[first + row] = part
        model.set_signs(self._terms, forces, modes)
        return modes

    def _supported(self, closed: list[int], rates: Array, size: Array) -> list[int]:
        """Of the gaps that were to open, those which the closed ones hold: without force on elastic supports."""
        still = [gap for gap in sorted(self._forced.open & set(self._touching)) if abs(rates[gap]) <= size[gap]]
        rank = len(independent(self._terms.matrix, closed)) if still else 0
        return [gap for gap in still if len(independent(self._terms.matrix, [*closed, gap])) == rank]

    def _activate(self, closed: list[int], sticking: list[int], forces: Array, modes: Array) -> None:
        """Write into the modes which rows are solved for: all that bear a force, and independent ones without.

        Where these depend on each other, forces change as those of elastic supports. Where all friction is near its
        limits, it is the softer, the more it could still bear.
        """
        model, matrix = self._model, self._terms.matrix
        rows = [*closed, *(row for index in sticking for row in model.frictions[index][0])]
        able = {row for index in self._able(forces) if index in sticking for row in model.frictions[index][0]}
        least = BORNE * float(np.max(np.abs(forces), initial=0.0))
        shares = [row for row in rows if abs(forces[row]) > least or row in able]
        basis = best_conditioned(matrix, shares)
        if len(basis) < len(rows):
            basis = independent(matrix, [*basis, *(row for row in rows if row not in shares)])
        first = model.layout.active.start
        modes[[first + row for row in basis]] = 1.0
        dependent = [row for row in shares if row not in basis]
        if not dependent:
            return
        sliding = [index for index in self._direction if index in self._model.loaded]
        loaded = [model.frictions[index][0][0] for index in sliding]
        chosen, weights = [*basis, *loaded, *dependent], model.compliance.copy()
        smallest = min(self._reserves.values(), default=0.0)
        softest = NARROWED_SOFTEST if self._narrowed else SOFTEST
        for index, reserve in self._reserves.items():
            share = smallest / reserve if reserve else 1.0
            weights[list(model.frictions[index][0])] *= max(share**2, softest)
        weights[loaded] *= SOFTEST  # what slides supports nothing
        modes[[first + row for row in (*basis, *loaded)]] = weights[[*basis, *loaded]]
        modes[[first + row for row in dependent]] = -weights[dependent]
        self._finder.turn(forces)
        unit, own, finder = self._finder.contact_followers(self._direction)[0], weights[chosen], self._finder
        for index, direction in self._held.items():
            if (gap := model.frictions[index][1]) is not None:
                rows = list(model.frictions[index][0])
                unit[finder.places(rows), finder.place[gap]] -= self._static(index) * direction
        coupled, none = product(finder.matrix, unit), np.zeros(len(unit))
        for index, row in zip(sliding, finder.places(loaded), strict=True):
            factor = self._terms.sizes[index, 0] * self._direction[index][0]
            coupled[row] = unit[row] + factor * finder.load_along(index, unit, none)[0]
        coupled = block(coupled, finder.places(chosen))
        stress = forces[chosen] - least_solution(coupled, product(coupled, forces[chosen]), own)
        scale = np.sqrt(own)
        if np.max(np.abs(scale * stress)) > FORCE_ROUND_OFF * np.max(np.abs(scale * forces[chosen])):
            # with loads, whose directions have several solutions, the forces themselves: from these the kernel starts
            modes[model.layout.given][chosen] = forces[chosen] if loaded else stress


def euclidean_norm(vector: Sequence[float] | Array) -> float:
    """The length of a vector, summed in the order of its components."""
    return math.sqrt(added(float(value) * float(value) for value in vector))


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
        """The modes (see `OneSidedLayout`) at a state without approaching contacts.

        :raises NoSolutionError: no forces are admissible.
        """
        inputs, pulled = inputs.copy(), frozenset[int]()
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
            pulling = self._pulling(guards, modes) - pulled
            if not overloaded and not pulling:
                return modes
            pulled |= pulling
            forced = replace(forced, open=forced.open | pulling, overloaded=forced.overloaded | overloaded)
        raise NoSolutionError("the contacts keep changing their states")

    def _pulling(self, found: OneSidedReadings, modes: Array) -> frozenset[int]:
        """Closed gaps that would pull, as where several share a load that is indeterminate."""
        model = self._model
        forces, loads = found.forces[: model.layout.gaps], model.loads[: model.layout.gaps]
        scale = loads * (1.0 + float(np.max(np.abs(found.forces) / model.loads, initial=0.0)))
        closed = modes[model.layout.closed] != 0.0
        return frozenset(np.flatnonzero(closed & (forces < -PULL * scale)).tolist())

    def _overloaded(self, found: OneSidedReadings, terms: OneSidedTerms, modes: Array) -> frozenset[int]:
        """Sticking elements that carry more than they can, as where several share a load that is indeterminate."""
        model, overloaded = self._model, set[int]()
        sliding, active = model.sliding(modes), modes[model.layout.active]
        able = np.flatnonzero(np.any(active[model.friction_rows] != 0.0, axis=1)).tolist()
        scale = model.loads * (1.0 + float(np.max(np.abs(found.forces) / model.loads, initial=0.0)))
        for index in able:
            rows, gap = model.frictions[index]
            if index in sliding:
                continue
            force = found.forces[list(rows)]
            load = (
                terms.load(index, found.forces) if index in model.loaded else 1.0 if gap is None else found.forces[gap]
            )
            if euclidean_norm(force) > terms.sizes[index, 1] * load + 1e-9 * scale[rows[0]]:
                overloaded.add(index)
        return frozenset(overloaded)
