"""Time stepping: each step moves freely, and then all contacts that have closed in it act at once.

The positions at the end follow from the mean of the speeds before and after (midpoint rule of Moreau). Contacts that
stay closed are projected, so that they neither drift nor creep. The error is of order one in the step; the residual of
the energy account shows it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.linear_algebra import added
from mbd_sim.compiler.python.bound_kernel import Kernel
from mbd_sim.dynamics.equations import Equations
from mbd_sim.dynamics.math.expressions import evaluated
from mbd_sim.simulation.contact.candidates import RESTING
from mbd_sim.simulation.contact.compiled.instant.forces import ACCURATE
from mbd_sim.simulation.contact.compiled.step import HARD, NOT_FINITE
from mbd_sim.simulation.contact.one_sided_model import Mask, OneSidedReadings, address
from mbd_sim.simulation.contact.records import ContactChange, ContactEvent
from mbd_sim.simulation.contact.stepper import EventError, OneSidedStepper
from mbd_sim.simulation.contact.time_stepping.impulses import ImpulseLaws, StepImpulses, add_sliding, resting_modes

NEAR = 0.01  # of the way at the natural speed in a step, within which features that touch together are found


@dataclass(frozen=True, eq=False)
class FreeStep:
    """A step without contacts: its `start` and `length` in s, and the states (n,) `before` and after it, in `y`."""

    start: float
    length: float
    before: Array
    y: Array

    @property
    def end(self) -> float:
        """The time in s after it."""
        return self.start + self.length


class TimeStepper(OneSidedStepper):
    """Advances a state by time stepping; see `OneSidedStepper` for what it reads and tells."""

    def __init__(self, equations: Equations, kernel: Kernel, *arguments: Any) -> None:
        """:param equations: of the mechanism, and `kernel` the compiled ones.

        :param arguments: those of `OneSidedStepper`.
        """
        super().__init__(*arguments)
        self._kernel = kernel
        self._layout, self._constraints, self._open_rates = equations.layout, equations.constraints, equations.rates
        self._alone = [index for index, (_, gap) in enumerate(self._model.frictions) if gap is None]

    def find_modes(self, time: float, y: Array, inputs: Array) -> None:
        """See `OneSidedStepper`. Where contacts have no solution, they are open until the next step."""
        before = y.copy()
        try:
            super().find_modes(time, y, inputs)
        except EventError:
            y[:] = before
            self._model.modes(inputs)[:] = 0.0

    def advance(
        self, y: Array, inputs: Array, history: Array, counter: NDArray[np.int64], h: float, n: int, estimate: Array
    ) -> bool:
        """See `OneSidedStepper`."""
        before, modes, first = y.copy(), inputs.copy(), int(counter[0])
        self._new.clear()
        try:
            step = first
            while step < first + n:
                taken, status = self._contacts.advance_by_time_stepping(y, inputs, step, h, first + n - step, estimate)
                self._note_compiled()
                step += taken
                if status == NOT_FINITE:
                    raise FloatingPointError
                if status == HARD:
                    self._take(y, inputs, step, h, estimate)
                    step += 1
        except BaseException as error:  # Ctrl-C included, after which state and time must belong together
            y[:], inputs[:] = before, modes
            self._contacts.events()
            if isinstance(error, FloatingPointError):
                return False
            raise
        counter[0] = first + n
        self._keep_new()
        return True

    def _take(self, y: Array, inputs: Array, step: int, h: float, estimate: Array) -> None:
        """Take a step: without contacts, then with the impulses of those that have closed."""
        model, old = self._model, self._model.modes(inputs).copy()
        signs = old[model.layout.signs]
        model.modes(inputs)[:] = 0.0
        model.modes(inputs)[model.layout.signs] = signs
        free = self._free_step(y, inputs, step, h, estimate)
        features = model.features
        if features is not None:
            states = (free.start, free.before), (free.end, y)
            features.find_all(states, inputs, max(self._tolerance, NEAR * model.units.speed * h))
        closing = self._closing(model.readings(free.end, y, inputs), h)
        closing |= self._closing(model.readings(free.start, free.before, inputs), h)  # others may press them together
        if np.any(closing) or self._alone:
            self._act(free, y, inputs, closing)
        if features is not None:
            self._contacts.end_step(free.end, y, inputs)
        self._record_changes(free.end, old, model.modes(inputs))

    def _free_step(self, y: Array, inputs: Array, step: int, h: float, estimate: Array) -> FreeStep:
        before = y.copy()
        if not self._kernel.estimating_advance(address(y), address(inputs), step, h, 1, address(estimate)):
            raise FloatingPointError
        before[self._contacts.held] = y[self._contacts.held]
        return FreeStep(step * h, h, before, y.copy())

    def _closing(self, readings: OneSidedReadings, h: float) -> Mask:
        """Which gaps (gaps,) are not positive after a step without contacts; of clutches, whether they slip."""
        model = self._model
        near = np.maximum(self._tolerance, self._rest_speed / model.units.speed * model.units.rate * h)
        limit = np.where(model.clutches, RESTING, near) * model.gap_units
        return np.asarray(readings.gaps <= limit, dtype=bool)

    def _act(self, free: FreeStep, y: Array, inputs: Array, closing: Mask) -> None:
        """Give the impulses of the contacts that close in a step."""
        model, h = self._model, free.length
        time, middle, before, end = self._rates(free, inputs)
        terms = model.terms(time, middle, inputs)
        gaps, rest = np.flatnonzero(closing).tolist(), self._rest_speed * model.speeds / model.units.speed
        laws = ImpulseLaws(model, terms, before, end, model.restitution(inputs), rest, gaps, h)
        found = laws.solved()
        if not np.any(found.impulses):
            return
        change = model.response(time, middle, inputs, found.impulses)
        self._move(free, y, change)
        middle[self._speeds] = 0.5 * (free.before[self._speeds] + y[self._speeds])
        account = slice(self._losses.start, len(y))
        powers = evaluated(self._open_rates, time, middle, inputs).ravel()[account]
        y[account] = free.before[account] + h * powers  # of the motion with these impulses
        modes = model.modes(inputs)
        resting_modes(model, terms, found, modes)
        if model.kernel.project(address(y), address(inputs), free.end) < 0:
            raise FloatingPointError
        add_sliding(model, terms, found, modes)
        self._keep_account(free, y, inputs, found)

    def _rates(self, free: FreeStep, inputs: Array) -> tuple[float, Array, Array, Array]:
        """The middle of a step: its time and state; and the rates (rows,) before the step and after it.

        The latter are extrapolated from the middle, where the impulses act: contacts that stay closed on curved paths
        then lose no energy.
        """
        model, u = self._model, self._speeds
        time, y = free.start + 0.5 * free.length, free.before.copy()
        if model.kernel.part_step(address(y), address(inputs), free.start, 0.5 * free.length) < 0:
            raise FloatingPointError
        before = model.readings(free.start, free.before, inputs).rates
        y[u] = free.before[u]
        change = model.readings(time, y, inputs).rates - before
        y[u] = free.y[u]
        return time, y, before, model.readings(time, y, inputs).rates + change

    def _move(self, free: FreeStep, y: Array, change: Array) -> None:
        """The speeds, and the positions of joints whose speeds change: their mean speed acts for the whole step."""
        nq, u = self._layout.nq, self._speeds
        y[u] += change
        displacement = 0.5 * free.length * (free.before[u] + y[u])
        moved = self._constraints.displaced(free.before[:nq], displacement)
        for joint, own in self._layout.u.items():
            if np.any(change[own]):
                y[self._layout.q[joint]] = moved[self._layout.q[joint]]

    def _keep_account(self, free: FreeStep, y: Array, inputs: Array, found: StepImpulses) -> None:
        """Add the losses of a step to the audit, and record what struck and what has no solution."""
        losses = [max(loss, 0.0) for loss in found.losses]
        y[self._losses] += losses
        y[-1] += added(losses)
        if self._driven or (self.observer is not None and found.hits):
            before, after = self._energy(free.end, free.y, inputs), self._energy(free.end, y, inputs)
            if self._driven:
                y[-2] += after - before + added(losses)
            if self.observer is not None and found.hits:
                self.observer.impact(free.end, before, after)
        for gap in found.hits:
            if impulse := float(found.impulses[gap]):
                name, change = self._model.name_in(self._model.modes(inputs), gap), ContactChange.IMPACT
                self._record(ContactEvent(free.end, name, change, impulse, added(losses), found.factor))
        if found.residual > ACCURATE:
            self._record(ContactEvent(free.end, "contacts", ContactChange.UNSOLVED, loss=found.residual))
