"""The steps of a mechanism with one-sided rows, and the events that compiled code leaves to Python.

An event is located within its step, the impact or the new modes are computed, and the rest of the step follows. Steps
keep their ends at k h, so that publishing and recording stay as they are.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.errors import DivergedError, InputError, Problem, listed, quoted
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.linear_algebra import added
from mbd_sim.simulation.contact.candidates import RESTING, Forced, ModeFinder
from mbd_sim.simulation.contact.compiled.step import CHANGED, SAME
from mbd_sim.simulation.contact.compiled_contacts import CompiledContacts, Marks
from mbd_sim.simulation.contact.impact import Impact, impact, is_jammed, return_at_once, tangential_impact
from mbd_sim.simulation.contact.one_sided_model import Mask, OneSidedModel, OneSidedReadings
from mbd_sim.simulation.contact.problem import ContactProblem, NoSolutionError, contact_forces
from mbd_sim.simulation.contact.records import ContactChange, ContactEvent, ContactObserver, without_round_off
from mbd_sim.simulation.contact.slow_slip import end_slips, slips_to_end

EVENTS_KEPT = 10_000
NO_FORCES = Problem(
    "no contact forces are possible ({}): the mechanism jams, or slides with too much friction (Painlevé's paradox)",
    "Reduce the friction, make the contacts compliant, or choose time stepping with method moreau.",
)
NO_IMPULSES = Problem(
    "no impulses satisfy the laws of impact and friction ({})",
    "Reduce the friction, or make the contacts compliant.",
)


class EventError(DivergedError):
    """A contact problem that has no solution; the message says where."""


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
    ) -> None:
        self._model, self._contacts, self._energy, self._moving_drives = model, contacts, energy, moving_drives
        self._speeds, self._losses = speeds, losses
        self._rest_speed, self._tolerance, self._driven = rest_speed, tolerance, driven
        self._finder = ModeFinder(model, tolerance)
        self.events: deque[ContactEvent] = deque(maxlen=EVENTS_KEPT)
        self.count = 0
        self._observer: ContactObserver | None = None
        self._new: list[ContactEvent] = []  # of the present call
        self._moving: tuple[Array, Array] = np.zeros(0), np.zeros(0)  # the state and the inputs of the present call
        contacts.connect(self._decide, self._note_compiled)

    @property
    def packed(self) -> Marks:
        """The contacts for `advance_members`."""
        return self._contacts.for_members

    @property
    def is_compiled(self) -> bool:
        """Whether `advance_members` can take its steps: nobody sees the events."""
        return self._observer is None

    @property
    def observer(self) -> ContactObserver | None:
        """Who sees the events."""
        return self._observer

    @observer.setter
    def observer(self, observer: ContactObserver | None) -> None:
        lacking = [name for name in ("impact", "event") if not callable(getattr(observer, name, None))]
        if observer is not None and lacking:
            remedy = "Give an object with the methods impact(time, before, after) and event(event)."
            raise InputError(f"{quoted(observer)} observes no contacts: it has no method {listed(lacking)}", remedy)
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
        self._new.clear()
        self._moving = y, inputs
        try:
            is_finite = self._contacts.advance(y, inputs, first, h, n, estimate)
            self._note_compiled()
            if not is_finite:
                raise FloatingPointError
            counter[0] = first + n
        except BaseException as error:  # Ctrl-C included, after which state and time must belong together
            y[:], inputs[:], history[:], counter[0] = before, modes, kept, first
            self._contacts.events()
            if isinstance(error, FloatingPointError):
                return False
            raise
        self._keep_new()
        return True

    def find_modes(self, time: float, y: Array, inputs: Array) -> None:
        """Find the modes of a state as if nothing were known of them, with impacts of contacts that approach.

        :raises EventError: contacts without a solution.
        """
        self._new.clear()
        self._model.modes(inputs)[:] = 0.0
        self._contacts.renew(time, y, inputs)
        self._resolve(time, y, inputs, Forced(), np.zeros(self._model.layout.gaps, dtype=bool), True, self._rest_speed)
        self._keep_new()

    def _decide(
        self, time: float, into: Marks, old: Array, opening: Marks, yielding: Marks, elastic: bool, rest: float
    ) -> int:
        """Make the changes whose guards are zero or negative: whether anything has changed.

        :param into: becomes 1 for these guards.
        :param old: the modes before.
        :param opening: and `yielding` are what earlier events at this instant have decided, with what this one adds.
        """
        self._note_compiled()
        y, inputs = self._moving
        layout, modes = self._model.layout, self._model.modes(inputs)
        readings = self._model.readings(time, y, inputs)
        reached = readings.guards <= self._tolerance
        into[:] = reached
        speeds = y[self._speeds].copy()
        self._model.flip_signs(modes, reached)
        closed = modes[layout.closed] != 0.0
        touched = reached[: layout.gaps] & ~closed
        opening[reached[: layout.gaps] & closed] = 1
        at_limit = reached[layout.gaps : layout.gaps + len(self._model.frictions)]
        sliding = self._model.sliding(modes)
        at_limit[sliding] = False
        yielding[at_limit] = 1
        opens, yields = (frozenset(np.flatnonzero(marks).tolist()) for marks in (opening, yielding))
        goes_on = frozenset(sliding) if np.any(reached) else frozenset[int]()
        self._resolve(time, y, inputs, Forced(opens, yields, sliding=goes_on), touched, elastic, rest)
        self._record_changes(time, old, modes)
        is_same = bool(np.all(modes == old) and np.all(y[self._speeds] == speeds))
        return SAME if is_same else CHANGED

    def _resolve(
        self, time: float, y: Array, inputs: Array, forced: Forced, touched: Mask, elastic: bool, rest: float
    ) -> None:
        """Impacts of touching contacts that approach, then the new modes."""
        model = self._model
        readings = model.readings(time, y, inputs)
        touching = self._finder.is_touching(readings) | touched
        gaps = model.layout.gaps
        rates = readings.rates[:gaps] / model.speeds[:gaps]
        returning = touched & (rates > RESTING)
        if np.any(touching & (rates < -RESTING)) or np.any(returning):
            self._impact(time, y, inputs, readings, touching, returning, elastic, rest)
            self._find(time, y, inputs, Forced(), touching)
            after = model.readings(time, y, inputs)
            returning = return_at_once(model, after, model.terms(time, y, inputs), inputs, touching, self._tolerance)
            if not np.any(returning):
                return
            touching &= returning | (model.modes(inputs)[model.layout.closed] != 0.0) | model.clutches
            self._impact(time, y, inputs, after, touching, returning, elastic, rest)
            forced = Forced()
        self._find(time, y, inputs, forced, touching)

    def _find(self, time: float, y: Array, inputs: Array, forced: Forced, touching: Mask) -> None:
        """Find the modes after any impacts."""
        modes = self._model.modes(inputs)
        modes[:] = self._found(time, y, inputs, forced, touching)
        if (slow := slips_to_end(self._model, self._model.readings(time, y, inputs), modes)) is not None:
            self._change_speeds(time, y, inputs, end_slips(self._model, time, y, inputs, slow))
            modes[:] = self._found(time, y, inputs, forced, touching)

    def _found(self, time: float, y: Array, inputs: Array, forced: Forced, touching: Mask) -> Array:
        try:
            return self._finder.find(time, y, inputs, forced)
        except NoSolutionError:
            self._stop_slip(time, y, inputs, touching)
            try:
                return self._finder.find(time, y, inputs)
            except NoSolutionError as error:
                raise self._unsolved(time, y, inputs, touching, NO_FORCES) from error

    def _unsolved(self, time: float, y: Array, inputs: Array, touching: Mask, law: Problem) -> EventError:
        """The error of contacts without a solution: they jam by drives or the time alone, or by too much friction."""
        if not self._jams(time, y, inputs, touching, law):
            return EventError(f"at {time:.9g} s {law.message.format(self._names(touching))}", law.remedy)
        drives = self._moving_drives(time, y, inputs)
        by = f"the {'drive' if len(drives) == 1 else 'drives'} of {', '.join(drives)}" if drives else "the time"
        gaps = "gaps of {} are" if np.sum(touching) > 1 else "gap of {} is"
        return EventError(
            f"at {time:.9g} s the {gaps.format(self._names(touching))} closed by {by} alone, and no contact force can "
            "stop that motion",
            "Change it so that the gap stays open, or let a part yield: with a spring in place of a driven joint, or "
            "a compliant contact.",
        )

    def _jams(self, time: float, y: Array, inputs: Array, touching: Mask, law: Problem) -> bool:
        """Whether touching contacts have no solution without friction either, or one that divides by round-off."""
        model, rows = self._model, [int(gap) for gap in np.flatnonzero(touching)]
        terms = model.terms(time, y, inputs)
        rates = (model.readings(time, y, inputs).rates if law == NO_IMPULSES else terms.free)[rows]
        problem = ContactProblem(terms.matrix[rows][:, rows], rates, range(len(rows)), (), model.compliance[rows])
        try:
            return is_jammed(model, contact_forces(problem), rates, rows)
        except NoSolutionError:
            return True

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
        rest: float,
    ) -> None:
        model = self._model
        touching = touching | model.clutches  # an impact elsewhere may engage them
        try:
            found = impact(model, time, y, inputs, readings, touching, returning, rest, elastic)
        except NoSolutionError as error:
            raise self._unsolved(time, y, inputs, touching, NO_IMPULSES) from error
        gaps = range(len(touching))
        if is_jammed(model, found.impulses[gaps], readings.rates[gaps] * touching, gaps):
            raise self._unsolved(time, y, inputs, touching, NO_IMPULSES)
        self._apply(time, y, inputs, found)

    def _apply(self, time: float, y: Array, inputs: Array, found: Impact) -> None:
        """Change the speeds and the audit by an impact, and record it."""
        self._change_speeds(time, y, inputs, found)
        modes = self._model.modes(inputs)
        for gap in np.flatnonzero(found.impulses[: self._model.layout.gaps]).tolist():
            name, impulse = self._model.name_in(modes, gap), float(found.impulses[gap])
            self._record(ContactEvent(time, name, ContactChange.IMPACT, impulse, found.loss, found.factor))

    def _change_speeds(self, time: float, y: Array, inputs: Array, found: Impact) -> None:
        """Change the speeds and the audit by impulses."""
        before = self._energy(time, y, inputs) if self._driven or self.observer is not None else 0.0
        y[self._speeds] += found.u_change
        y[self._losses.start] += found.loss
        y[-1] += found.loss
        if self._driven:
            y[-2] += self._energy(time, y, inputs) - before + found.loss
        if self.observer is not None:
            self.observer.impact(time, before, self._energy(time, y, inputs))

    def _note_compiled(self) -> None:
        """Record the latest events of compiled code."""
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
        happened = without_round_off(self._new)
        self.events.extend(happened)
        self.count += len(happened)

    def _record_changes(self, time: float, old: Array, new: Array) -> None:
        layout, model = self._model.layout, self._model
        changed = old != new
        for gap in np.flatnonzero(changed[layout.closed]).tolist():
            now = bool(new[layout.closed][gap])
            change = ContactChange.CLOSED if now else ContactChange.OPENED
            self._record(ContactEvent(time, model.name_in(new if now else old, gap), change))
        first = layout.direction.start - layout.gaps
        sliding = [frozenset(model.sliding(modes)) for modes in (old, new)]
        turned = np.any(changed[first + model.friction_rows], axis=1)
        for index, (rows, load) in enumerate(model.frictions):
            if load is not None and not (new[load] and (turned[index] or changed[load])):
                continue
            slid, slides = (index in elements for elements in sliding)
            reverses = slid and slides and added(old[first + row] * new[first + row] for row in rows) < 0.0
            stuck = not slid and (load is None or old[load] != 0.0)
            name = model.friction_name(index) if load is None else model.name_in(new, load)
            if (slides and not slid) or reverses:
                self._record(ContactEvent(time, name, ContactChange.SLIDES))
            elif not slides and (slid or not stuck):
                self._record(ContactEvent(time, name, ContactChange.STICKS))
