"""The steps of a mechanism with one-sided rows: compiled up to an event, the event in Python, and on from there.

An event is located within its step, the impact or the new modes are computed, and the rest of the step follows. Steps
keep their ends at k h, so that publishing and recording stay as they are.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np

from mbd_sim.contact.problem import NoSolutionError
from mbd_sim.errors import DivergedError
from mbd_sim.geometry.pose import Array
from mbd_sim.simulation.contact_impact import Impact, impact
from mbd_sim.simulation.contact_modes import RESTING, STOPPED, Forced, ModeFinder
from mbd_sim.simulation.contact_records import ContactChange, ContactEvent
from mbd_sim.simulation.contact_terms import ContactModel, ContactReadings, Mask
from mbd_sim.simulation.event_location import first_zero

EVENTS_KEPT = 10_000
MOST_EVENTS = 500  # in one step, beyond which nothing rebounds
FRACTION = 1e-3  # of a step, in which a direction of sliding becomes apparent


class EventError(DivergedError):
    """A contact problem that has no solution; the message says where."""


class ContactStepper:
    """Advances a state `y` and the modes among its `inputs`, both in place.

    `energy(time, y, inputs)` is the total energy in J. `events` are the latest ones of `count` in all.
    """

    def __init__(
        self,
        model: ContactModel,
        energy: Callable[[float, Array, Array], float],
        speeds: slice,
        losses: slice,
        rest_speed: float,
        tolerance: float,
        driven: bool,
    ) -> None:
        self._model, self._energy, self._speeds, self._losses = model, energy, speeds, losses
        self._rest_speed, self._tolerance, self._driven = rest_speed, tolerance, driven
        self._finder = ModeFinder(model, tolerance)
        self.events: deque[ContactEvent] = deque(maxlen=EVENTS_KEPT)
        self.count = 0

    def advance(self, y: Array, inputs: Array, first: int, h: float, n: int, estimate: Array) -> bool:
        """Take n steps; False, with nothing changed, where the state would not stay finite.

        :raises EventError: contacts without a solution; nothing is changed then either.
        """
        before, modes, known, count = y.copy(), inputs.copy(), list(self.events), self.count
        try:
            done = 0
            while done < n:
                addresses = y.ctypes.data, inputs.ctypes.data
                taken = self._model.kernel.advance_to_event(*addresses, first + done, h, n - done, estimate.ctypes.data)
                if taken < 0:
                    raise FloatingPointError
                done += taken
                if done < n:
                    self._step(y, inputs, (first + done) * h, (first + done + 1) * h, h)
                    done += 1
        except (FloatingPointError, EventError) as error:
            y[:], inputs[:] = before, modes
            self.events.clear()
            self.events.extend(known)
            self.count = count
            if isinstance(error, EventError):
                raise
            return False
        return True

    def settle(self, time: float, y: Array, inputs: Array) -> None:
        """Find the modes of a state as if nothing were known of them, with impacts of contacts that approach.

        :raises EventError: contacts without a solution.
        """
        self._model.modes(inputs)[:] = 0.0
        self._resolve(time, y, inputs, Forced(), np.zeros(self._model.layout.gaps, dtype=bool), True, first=True)

    def _step(self, y: Array, inputs: Array, start: float, end: float, h: float) -> None:
        t, left = start, h
        for count in range(4 * MOST_EVENTS):
            trial = self._moved(y, inputs, t, left)
            found = self._first_event(y, trial, inputs, t, left)
            if found is None:
                y[:] = trial
                return
            if found > 0.0:
                y[:] = self._moved(y, inputs, t, found)
                t += found
            self._switch(t, y, inputs, count < MOST_EVENTS)
            left = end - t
            if left <= 0.0:
                return
        raise EventError(f"more than {4 * MOST_EVENTS} events of contacts within the step at {start:.9g} s")

    def _moved(self, y: Array, inputs: Array, t: float, length: float) -> Array:
        moved = y.copy()
        self._model.kernel.part_step(moved.ctypes.data, inputs.ctypes.data, t, length)
        if not np.all(np.isfinite(moved)):
            raise FloatingPointError
        return moved

    def _first_event(self, y: Array, trial: Array, inputs: Array, t: float, length: float) -> float | None:
        """The length of the step up to its first event, or None."""
        before, after = self._model.readings(t, y, inputs), self._model.readings(t + length, trial, inputs)
        self._turn(before, inputs)
        after = self._model.readings(t + length, trial, inputs)
        if not np.all(np.isfinite(after.guards)):
            raise FloatingPointError

        def guard(index: int) -> Callable[[float], float]:
            def value(s: float) -> float:
                at = self._moved(y, inputs, t, s)
                return float(self._model.readings(t + s, at, inputs).guards[index])

            return value

        start = self._model.readings(t, y, inputs).guards
        found = []
        for index in np.flatnonzero(after.guards < -self._tolerance).tolist():
            zero = first_zero(guard(index), length, float(start[index]), float(after.guards[index]), self._tolerance)
            if zero == 0.0 and self._may_turn(index, inputs):
                zero = FRACTION * length  # from rest into an unstable direction: the motion finds the stable one
            found.append(zero)
        found += [
            grazed
            for index in self._may_graze(before, after, inputs)
            if (grazed := self._grazing(y, inputs, t, length, index, before)) is not None
        ]
        return min(found, default=None)

    def _may_turn(self, guard: int, inputs: Array) -> bool:
        """Whether a guard is that of sliding along two directions."""
        layout, modes = self._model.layout, self._model.modes(inputs)
        number = guard - layout.gaps
        if not 0 <= number < len(self._model.frictions):
            return False
        rows, first = self._model.frictions[number][0], layout.direction.start - layout.gaps
        return len(rows) == 2 and any(modes[first + row] for row in rows)

    def _may_graze(self, before: ContactReadings, after: ContactReadings, inputs: Array) -> list[int]:
        gaps = self._model.layout.gaps
        closed = inputs[self._model.span][self._model.layout.closed] != 0.0
        turns = (before.rates[:gaps] < 0.0) & (after.rates[:gaps] > 0.0) & (before.gaps > self._tolerance)
        return np.flatnonzero(turns & ~closed & ~self._model.clutches & (after.gaps >= -self._tolerance)).tolist()

    def _grazing(
        self, y: Array, inputs: Array, t: float, length: float, index: int, before: ContactReadings
    ) -> float | None:
        """Where a gap that turns within the step becomes zero before that."""

        def rate(s: float) -> float:
            return -float(self._model.readings(t + s, self._moved(y, inputs, t, s), inputs).rates[index])

        def gap(s: float) -> float:
            return float(self._model.readings(t + s, self._moved(y, inputs, t, s), inputs).gaps[index])

        lowest = first_zero(rate, length, -float(before.rates[index]), rate(length), 0.0)
        depth = gap(lowest)
        return (
            first_zero(gap, lowest, float(before.gaps[index]), depth, self._tolerance)
            if depth < -self._tolerance
            else None
        )

    def _turn(self, readings: ContactReadings, inputs: Array) -> None:
        """Set the stored directions of sliding along two directions to the present ones."""
        layout, modes = self._model.layout, self._model.modes(inputs)
        first = layout.direction.start - layout.gaps
        for rows, _ in self._model.frictions:
            if len(rows) == 2 and any(modes[first + row] for row in rows):
                slip = readings.rates[list(rows)]
                speed = float(np.sqrt(slip[0] * slip[0] + slip[1] * slip[1]))
                if speed > STOPPED:
                    for row, part in zip(rows, slip.tolist(), strict=True):
                        modes[first + row] = part / speed

    def _switch(self, time: float, y: Array, inputs: Array, elastic: bool) -> None:
        """Make the changes whose guards are zero or negative."""
        layout, modes = self._model.layout, self._model.modes(inputs)
        readings = self._model.readings(time, y, inputs)
        self._turn(readings, inputs)
        readings = self._model.readings(time, y, inputs)
        reached = readings.guards <= self._tolerance
        if not reached.any():
            return  # a direction of sliding has turned
        self._model.flip_signs(modes, reached)
        closed = modes[layout.closed] != 0.0
        touched = reached[: layout.gaps] & ~closed
        opening = frozenset(np.flatnonzero(reached[: layout.gaps] & closed).tolist())
        first = layout.direction.start - layout.gaps
        yielding = frozenset(
            index
            for index, (rows, _) in enumerate(self._model.frictions)
            if reached[layout.gaps + index] and not any(modes[first + row] for row in rows)
        )
        self._resolve(time, y, inputs, Forced(opening, yielding), touched, elastic)

    def _resolve(
        self, time: float, y: Array, inputs: Array, forced: Forced, touched: Mask, elastic: bool, first: bool = False
    ) -> None:
        """Impacts of touching contacts that approach, then the new modes."""
        model = self._model
        old = model.modes(inputs).copy()
        readings = model.readings(time, y, inputs)
        touching = self._finder.is_touching(readings) | touched
        rates = readings.rates[: model.layout.gaps]
        returning = touched & (rates > RESTING)
        if np.any(touching & (rates < -RESTING)) or np.any(returning):
            self._impact(time, y, inputs, readings, touching, returning, elastic)
            forced = Forced()
        try:
            modes = self._finder.find(time, y, inputs, forced)
        except NoSolutionError:
            readings = model.readings(time, y, inputs)
            self._impact(time, y, inputs, readings, touching, np.zeros_like(touching), False)
            try:
                modes = self._finder.find(time, y, inputs)
            except NoSolutionError as error:
                names = ", ".join(name for name, at in zip(model.names, touching, strict=True) if at)
                raise EventError(
                    f"at {time:.9g} s no contact forces are possible ({names}): the mechanism jams, or slides with "
                    "too much friction (Painlevé's paradox). Reduce the friction, or make the contacts elastic."
                ) from error
        model.modes(inputs)[:] = modes
        if not first:
            self._record_changes(time, old, modes)

    def _impact(
        self,
        time: float,
        y: Array,
        inputs: Array,
        readings: ContactReadings,
        touching: Mask,
        returning: Mask,
        elastic: bool,
    ) -> None:
        model = self._model
        before = self._energy(time, y, inputs) if self._driven else 0.0
        try:
            found: Impact = impact(model, time, y, inputs, readings, touching, returning, self._rest_speed, elastic)
        except NoSolutionError as error:
            raise EventError(f"at {time:.9g} s no impulses of an impact were found") from error
        y[self._speeds] += found.u_change
        y[self._losses.start] += found.loss
        y[-1] += found.loss
        if self._driven:
            y[-2] += self._energy(time, y, inputs) - before + found.loss
        for gap in np.flatnonzero(found.impulses[: model.layout.gaps]).tolist():
            impulse = float(found.impulses[gap])
            self._record(ContactEvent(time, model.names[gap], ContactChange.IMPACT, impulse, found.loss, found.factor))

    def _record(self, event: ContactEvent) -> None:
        self.events.append(event)
        self.count += 1

    def _record_changes(self, time: float, old: Array, new: Array) -> None:
        layout, model = self._model.layout, self._model
        for gap, (was, now) in enumerate(zip(old[layout.closed], new[layout.closed], strict=True)):
            if was != now:
                change = ContactChange.CLOSED if now else ContactChange.OPENED
                self._record(ContactEvent(time, model.names[gap], change))
        first = layout.direction.start - layout.gaps
        for rows, load in model.frictions:
            if load is not None and not new[load]:
                continue
            slid, slides = (any(modes[first + row] for row in rows) for modes in (old, new))
            reverses = slid and sum(old[first + row] * new[first + row] for row in rows) < 0.0
            stuck = any(old[layout.active.start + row] for row in rows)
            name = model.row_names[rows[0]] if load is None else model.names[load]
            if (slides and not slid) or reverses:
                self._record(ContactEvent(time, name, ContactChange.SLIDES))
            elif not slides and (slid or not stuck):
                self._record(ContactEvent(time, name, ContactChange.STICKS))
