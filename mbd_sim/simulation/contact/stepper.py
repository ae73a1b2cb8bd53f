"""The steps of a mechanism with one-sided rows: compiled up to an event, the event in Python, and on from there.

An event is located within its step, the impact or the new modes are computed, and the rest of the step follows. Steps
keep their ends at k h, so that publishing and recording stay as they are.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.errors import DivergedError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.simulation.contact.candidates import RESTING, Forced, ModeFinder
from mbd_sim.simulation.contact.compiled.step import (
    BRIEF,
    CHANGED,
    DONE,
    HARD,
    LONGER,
    MOST_AT_ONCE,
    MOST_EVENTS,
    MOST_STAGES,
    NOT_FINITE,
    NOT_SIMPLE,
    SAME,
)
from mbd_sim.simulation.contact.compiled_contacts import CompiledContacts
from mbd_sim.simulation.contact.impact import Impact, impact, tangential_impact
from mbd_sim.simulation.contact.one_sided_model import Mask, OneSidedModel, OneSidedReadings, address
from mbd_sim.simulation.contact.problem import NoSolutionError
from mbd_sim.simulation.contact.records import ContactChange, ContactEvent, ContactObserver
from mbd_sim.simulation.contact.search import EventSearch, TrialMotion

Marks: TypeAlias = NDArray[np.int64]

EVENTS_KEPT = 10_000
NO_FORCES = (
    "no contact forces are possible ({}): the mechanism jams, or slides with too much friction (Painlevé's paradox). "
    "Reduce the friction, make the contacts compliant, or choose time stepping with method moreau."
)
NO_IMPULSES = (
    "no impulses satisfy the laws of impact and friction ({}). Reduce the friction, or make the contacts compliant."
)
CREEPING = 20  # parts of a step that end with a slip which counts as zero, until it stops if it can


class EventError(DivergedError):
    """A contact problem that has no solution; the message says where."""


@dataclass
class _Decided:
    """What events at one instant have decided: 1 for gaps that are `opening` and friction that is `yielding`.

    `count` is the number of these events.
    """

    opening: Marks
    yielding: Marks
    count: int = 0

    def clear(self) -> None:
        """Begin another instant."""
        self.opening[:], self.yielding[:], self.count = 0, 0, 0


class OneSidedStepper:
    """Advances a state `y` and the modes among its `inputs`, both in place.

    `energy(time, y, inputs)` is the total energy in J, and `moving_drives` of the same are the names of the drives that
    move. `events` are the latest ones of `count` in all. An `observer`
    sees them, in order, at the latest when a call of `advance` ends.
    """

    def __init__(
        self,
        model: OneSidedModel,
        contacts: CompiledContacts,
        energy: Callable[[float, Array, Array], float],
        speeds: slice,
        losses: slice,
        rest_speed: float,
        tolerance: float,
        driven: bool,
        moving_drives: Callable[[float, Array, Array], Sequence[str]] = lambda *_: (),
        held: Sequence[int] = (),
    ) -> None:
        """:param held: the components of y that change between steps only."""
        self._held = list(held)
        self._clearances = None if model.features is None else model.features.clearances()
        self._model, self._contacts, self._energy, self._moving_drives = model, contacts, energy, moving_drives
        self._speeds, self._losses = speeds, losses
        self._rest_speed, self._tolerance, self._driven = rest_speed, tolerance, driven
        self._finder, self._search = ModeFinder(model, tolerance), EventSearch(model, contacts, tolerance)
        self.events: deque[ContactEvent] = deque(maxlen=EVENTS_KEPT)
        self.count = 0
        self._observer: ContactObserver | None = None
        self._new: list[ContactEvent] = []  # of the present call

    @property
    def packed(self) -> Marks:
        """The contacts for `advance_members`."""
        return self._contacts.packed

    @property
    def is_compiled(self) -> bool:
        """Whether `advance_members` can take its steps: nobody sees the events, and no features change."""
        return self._observer is None and self._model.features is None

    @property
    def observer(self) -> ContactObserver | None:
        """Who sees the events."""
        return self._observer

    @observer.setter
    def observer(self, observer: ContactObserver | None) -> None:
        self._observer = observer
        self._contacts.observe(observer is not None)

    def advance(
        self, y: Array, inputs: Array, history: Array, counter: NDArray[np.int64], h: float, n: int, estimate: Array
    ) -> bool:
        """Take n steps, and count them; False, with nothing changed, where the state would not stay finite.

        :param history: what the method keeps of earlier steps, behind the inputs in memory.
        :raises EventError: contacts without a solution. Nothing is changed then either, nor after any other exception.
        """
        before, modes, kept, first = y.copy(), inputs.copy(), history.copy(), int(counter[0])
        features = self._model.features
        self._new.clear()
        try:
            done = 0
            while done < n:
                if features is None:
                    taken, why = self._contacts.advance(y, inputs, first + done, h, n - done, estimate)
                    self._note_compiled()
                else:
                    taken, why = self._without_event(y, inputs, history, first + done, h, estimate)
                done += taken
                if why == NOT_FINITE:
                    raise FloatingPointError
                if why == HARD:
                    self._step(y, inputs, (first + done) * h, (first + done + 1) * h)
                    done += 1
                if features is not None:
                    features.end_step((first + done) * h, y, inputs)
            counter[0] = first + n
        except BaseException as error:  # Ctrl-C included, after which state and time must belong together
            y[:], inputs[:], history[:], counter[0] = before, modes, kept, first
            if isinstance(error, FloatingPointError):
                return False
            raise
        self._keep_new()
        return True

    def _without_event(
        self, y: Array, inputs: Array, history: Array, first: int, h: float, estimate: Array
    ) -> tuple[int, int]:
        """Take a step in which features can change if it has no event: see `compiled.step.advance` for the result."""
        before, features = y.copy(), self._model.features
        assert features is not None and self._clearances is not None
        taken = self._model.kernel.advance_to_event(*map(address, (y, inputs)), first, h, 1, address(estimate))
        if taken < 0:
            return 0, NOT_FINITE
        before[self._held] = y[self._held]
        motion = TrialMotion(self._model, before, inputs, first * h, {h: y})
        if taken and features.first_change(motion, inputs, self._clearances, None, h) is not None:
            y[:], history[:], taken = before, 0.0, 0
        return taken, DONE if taken else HARD

    def find_modes(self, time: float, y: Array, inputs: Array) -> None:
        """Find the modes of a state as if nothing were known of them, with impacts of contacts that approach.

        :raises EventError: contacts without a solution.
        """
        self._new.clear()
        self._model.modes(inputs)[:] = 0.0
        self._renew(time, y, inputs)
        self._resolve(time, y, inputs, Forced(), np.zeros(self._model.layout.gaps, dtype=bool), True)
        self._keep_new()

    def _step(self, y: Array, inputs: Array, start: float, end: float) -> None:
        """Take a step with events as `compiled.step.step` does, with those that it leaves to others."""
        t, events, longest, creeping, brief = start, 0, np.inf, 0, BRIEF * (end - start)
        ignored, decided = self._contacts.marks(self._model.guard_count), self._nothing_decided()
        for _ in range(MOST_STAGES):
            is_ignored = bool(ignored.any())
            stage = self._search.stage(y, inputs, t, min(end - t, brief) if is_ignored else end - t, longest, ignored)
            y[:] = stage.y
            longest = np.inf if stage.is_event else LONGER * stage.length
            is_last = stage.length >= end - t
            t = end if is_last else t + stage.length
            creeping += stage.creeps
            if stage.is_event or creeping > CREEPING:
                creeping = 0
                events += 1
                if events > 2 * MOST_EVENTS:
                    break
                if stage.length > 0.0:
                    decided.clear()
                ignored = self._switch(t, y, inputs, decided, events <= MOST_EVENTS)
            elif stage.length > 0.0:
                if is_ignored:
                    brief *= LONGER
                    decided.clear()
                ignored[:] = 0
            if is_last:
                return
        self._record(ContactEvent(t, "contacts", ContactChange.BOUND))
        if t < end and self._model.kernel.part_step(y.ctypes.data, inputs.ctypes.data, t, end - t) < 0:
            raise FloatingPointError

    def _nothing_decided(self) -> _Decided:
        return _Decided(self._contacts.marks(self._model.layout.gaps), self._contacts.marks(len(self._model.frictions)))

    def _switch(self, time: float, y: Array, inputs: Array, decided: _Decided, elastic: bool) -> Marks:
        """Make the changes whose guards are zero or negative; the guards that must be left as they are."""
        old = self._model.modes(inputs).copy()
        self._renew(time, y, inputs)
        before, kept = y.copy(), inputs.copy()
        reached = self._contacts.marks(self._model.guard_count)
        found = self._contacts.switch(time, y, inputs, old, decided.opening, decided.yielding, elastic, reached)
        if found == NOT_SIMPLE:
            y[:], inputs[:] = before, kept
            found = self._decide(time, y, inputs, old, decided, elastic, reached)
        else:
            self._note_compiled()
        decided.count += 1
        if not ((decided.count > 1 and found == SAME) or decided.count > MOST_AT_ONCE):
            reached[:] = 0
        return reached

    def _decide(
        self, time: float, y: Array, inputs: Array, old: Array, decided: _Decided, elastic: bool, into: Marks
    ) -> int:
        """Make those changes without compiled code: whether anything has changed; the guards become 1 in `into`.

        :param old: the modes before.
        """
        layout, modes = self._model.layout, self._model.modes(inputs)
        readings = self._model.readings(time, y, inputs)
        reached = readings.guards <= self._tolerance
        into[:] = reached
        speeds = y[self._speeds].copy()
        self._model.flip_signs(modes, reached)
        closed = modes[layout.closed] != 0.0
        touched = reached[: layout.gaps] & ~closed
        decided.opening[reached[: layout.gaps] & closed] = 1
        at_limit = reached[layout.gaps : layout.gaps + len(self._model.frictions)]
        at_limit[self._model.sliding(modes)] = False
        decided.yielding[at_limit] = 1
        opening, yielding = (frozenset(np.flatnonzero(marks).tolist()) for marks in (decided.opening, decided.yielding))
        self._resolve(time, y, inputs, Forced(opening, yielding), touched, elastic)
        self._record_changes(time, old, modes)
        is_same = bool(np.all(modes == old) and np.all(y[self._speeds] == speeds))
        return SAME if is_same else CHANGED

    def _renew(self, time: float, y: Array, inputs: Array) -> None:
        if self._model.features is not None:
            self._model.features.renew(time, y, inputs)

    def _resolve(self, time: float, y: Array, inputs: Array, forced: Forced, touched: Mask, elastic: bool) -> None:
        """Impacts of touching contacts that approach, then the new modes."""
        model = self._model
        readings = model.readings(time, y, inputs)
        touching = self._finder.is_touching(readings) | touched
        gaps = model.layout.gaps
        rates = readings.rates[:gaps] / model.speeds[:gaps]
        returning = touched & (rates > RESTING)
        if np.any(touching & (rates < -RESTING)) or np.any(returning):
            self._impact(time, y, inputs, readings, touching, returning, elastic)
            forced = Forced()
        try:
            modes = self._finder.find(time, y, inputs, forced)
        except NoSolutionError:
            self._stop_slip(time, y, inputs, touching)
            try:
                modes = self._finder.find(time, y, inputs)
            except NoSolutionError as error:
                raise self._unsolved(time, y, inputs, touching, NO_FORCES) from error
        model.modes(inputs)[:] = modes

    def _unsolved(self, time: float, y: Array, inputs: Array, touching: Mask, law: str) -> EventError:
        """The error of contacts without a solution: gaps that only drives or the time change, or too much friction."""
        movable = np.diag(self._model.terms(time, y, inputs).matrix)[: len(touching)] > 0.0
        if not np.any(touching & ~movable):
            return EventError(f"at {time:.9g} s {law.format(self._names(touching))}")
        drives = self._moving_drives(time, y, inputs)
        by = f"the {'drive' if len(drives) == 1 else 'drives'} of {', '.join(drives)}" if drives else "the time"
        names = self._names(touching & ~movable)
        return EventError(
            f"at {time:.9g} s the gap of {names} is closed by {by} alone, and no contact force can stop that motion. "
            "Change it so that the gap stays open, or let a part yield: with a spring in place of a driven joint, or a "
            "compliant contact."
        )

    def _names(self, touching: Mask) -> str:
        return ", ".join(name for name, at in zip(self._model.names, touching, strict=True) if at)

    def _stop_slip(self, time: float, y: Array, inputs: Array, touching: Mask) -> None:
        """The impulse without collision that ends a motion for which there are no forces (Painlevé)."""
        found = tangential_impact(self._model, time, y, inputs, touching)
        if found is not None:
            self._apply(time, y, inputs, found)

    def _impact(
        self,
        time: float,
        y: Array,
        inputs: Array,
        readings: OneSidedReadings,
        touching: Mask,
        returning: Mask,
        elastic: bool,
    ) -> None:
        model = self._model
        touching = touching | model.clutches  # an impact elsewhere may engage them
        try:
            found = impact(model, time, y, inputs, readings, touching, returning, self._rest_speed, elastic)
        except NoSolutionError as error:
            raise self._unsolved(time, y, inputs, touching, NO_IMPULSES) from error
        self._apply(time, y, inputs, found)

    def _apply(self, time: float, y: Array, inputs: Array, found: Impact) -> None:
        """Change the speeds and the audit by an impact, and record it."""
        before = self._energy(time, y, inputs) if self._driven or self.observer is not None else 0.0
        y[self._speeds] += found.u_change
        y[self._losses.start] += found.loss
        y[-1] += found.loss
        if self._driven:
            y[-2] += self._energy(time, y, inputs) - before + found.loss
        if self.observer is not None:
            self.observer.impact(time, before, self._energy(time, y, inputs))
        for gap in np.flatnonzero(found.impulses[: self._model.layout.gaps]).tolist():
            impulse = float(found.impulses[gap])
            self._record(
                ContactEvent(time, self._model.names[gap], ContactChange.IMPACT, impulse, found.loss, found.factor)
            )

    def _note_compiled(self) -> None:
        """Record the events of the last compiled call."""
        for event in self._contacts.events():
            if isinstance(event, ContactEvent):
                self._record(event)
            elif self.observer is not None:
                self.observer.impact(event.time, event.before, event.after)

    def _record(self, event: ContactEvent) -> None:
        self._new.append(event)
        if self.observer is not None:
            self.observer.event(event)

    def _keep_new(self) -> None:
        self.events.extend(self._new)
        self.count += len(self._new)

    def _record_changes(self, time: float, old: Array, new: Array) -> None:
        layout, model = self._model.layout, self._model
        for gap, (was, now) in enumerate(zip(old[layout.closed], new[layout.closed], strict=True)):
            if was != now:
                change = ContactChange.CLOSED if now else ContactChange.OPENED
                self._record(ContactEvent(time, model.names[gap], change))
        first = layout.direction.start - layout.gaps
        sliding = [frozenset(model.sliding(modes)) for modes in (old, new)]
        for index, (rows, load) in enumerate(model.frictions):
            if load is not None and not new[load]:
                continue
            slid, slides = (index in elements for elements in sliding)
            reverses = slid and slides and sum(old[first + row] * new[first + row] for row in rows) < 0.0
            stuck = not slid and (load is None or old[load] != 0.0)
            name = model.friction_name(index)
            if (slides and not slid) or reverses:
                self._record(ContactEvent(time, name, ContactChange.SLIDES))
            elif not slides and (slid or not stuck):
                self._record(ContactEvent(time, name, ContactChange.STICKS))
