"""The search for the first event within a step of a mechanism with one-sided rows.

The search tries the motion from one state on. The instant at which a guard becomes zero within a step is found by a
bracketing root finder on the one-step map.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.roots import first_zero
from mbd_sim.compiler.steps.guarded import STIFF, TURNING
from mbd_sim.simulation.contact.compiled_contacts import CompiledContacts
from mbd_sim.simulation.contact.complementarity import solve
from mbd_sim.simulation.contact.one_sided_model import OneSidedModel, OneSidedReadings, address


class TrialMotion:
    """The motion from one state on, with all that was computed of it."""

    def __init__(
        self, model: OneSidedModel, y: Array, inputs: Array, t: float, known: Mapping[float, Array] | None = None
    ) -> None:
        """:param known: states after some lengths in s."""
        self._model, self._y, self._inputs, self._t = model, y, inputs, t
        self.start = y, inputs, t
        self._inputs_address = address(inputs)
        self._states: dict[float, Array] = {0.0: y.copy(), **(known or {})}
        self._readings: dict[float, OneSidedReadings] = {}
        self._poses: dict[float, Array] = {}

    def state(self, length: float) -> Array:
        """The state after a length in s."""
        found = self._states.get(length)
        if found is None:
            found = self._y.copy()
            if self._model.kernel.part_step(address(found), self._inputs_address, self._t, length) < 0:
                raise FloatingPointError
            self._states[length] = found
        return found

    def readings(self, length: float) -> OneSidedReadings:
        """The readings after a length in s."""
        found = self._readings.get(length)
        if found is None:
            found = self._model.readings_at(self._t + length, address(self.state(length)), self._inputs_address)
            self._readings[length] = found
        return found

    def gaps(self, length: float) -> Array:
        """The gaps (gaps,) after a length in s."""
        return self.readings(length).gaps

    def poses(self, length: float) -> Array:
        """The poses of the parts after a length in s, in mechanisms with slots."""
        found = self._poses.get(length)
        if found is None:
            assert self._model.features is not None
            found = self._model.features.poses(self._t + length, address(self.state(length)), self._inputs_address)
            self._poses[length] = found
        return found


STOPPED = 1e-8  # of the natural speed, up to which slip along two directions counts as zero: it turns ever faster
STOPPING = 4.0  # of such a slip velocity, by which it may change within a step
STRAIGHT = 1e-10  # part of a change of slip across it, up to which it keeps its direction
NOISE = 1e-15  # of the natural speed, in slip
SHORTER = 0.8  # of the length after which a slip velocity has changed by `TURNING`
SHORTENING = 0.25  # of a length, at most; the motion beyond a stop says little
STEADY = 16.0  # stable steps, beyond which directions of sliding are sought that hold for longer ones
BRIEF = 1e-3  # of a stable step, in which the change of a slip is measured
FIXED = 1.0 + 1e-12  # length of a direction of sliding that does not turn
ANGLE = 1e-5  # rad, for the derivatives by angles
NEWTON_STEPS = 8
SHORTEST = 1e-15  # of the natural time, and of the time


@dataclass(frozen=True, eq=False)
class Stage:
    """The state `y` after a `length` in s; where that `is_event`, it is an event.

    `stopped` are the friction elements with two directions whose sliding ends there. `creeps`: one of them slides so
    slowly at the end that its slip counts as zero.
    """

    length: float
    is_event: bool
    y: Array
    stopped: frozenset[int] = frozenset()
    creeps: bool = False


class EventSearch:
    """Takes parts of steps up to the first event, or as far as slip along two directions does not turn much.

    The directions of sliding among the `inputs` follow the slip.
    A guard counts as negative below -`tolerance`.
    """

    def __init__(self, model: OneSidedModel, contacts: CompiledContacts, tolerance: float) -> None:
        self._model, self._contacts, self._tolerance = model, contacts, tolerance
        self._stopped, self._noise = STOPPED * model.units.speed, NOISE * model.units.speed
        self._place = {index: place for place, index in enumerate(model.pairs)}

    def stage(
        self, y: Array, inputs: Array, t: float, length: float, first_length: float, ignored: NDArray[np.int64]
    ) -> Stage:
        """The next part of a step that begins at t and is at most this long; guards that are 1 in `ignored` make none.

        :param first_length: what to try first, unless slips turn much faster than they change.

        :raises FloatingPointError: the state does not stay finite.
        """
        sliding = [index for index in self._model.sliding(self._model.modes(inputs)) if index in self._place]
        if not sliding and self._model.features is None:
            end = y.copy()
            return Stage(*self._contacts.stage(end, inputs, t, length, ignored), y=end)
        self._turn(self._model.readings(t, y, inputs), inputs, sliding)
        motion = TrialMotion(self._model, y, inputs, t)
        before = motion.readings(0.0)
        turning = self._turning(motion, before, sliding, length)
        straight = self._straight(y, inputs, t, length, turning)
        steady, longest = self._steady(motion, before, turning, length) if straight is None else ([], length)
        if straight is not None:
            motion = straight
        elif steady:
            length = longest
            motion = self._along_fixed(y, inputs, t, length, steady)
        elif turning:
            length = self._resolved_length(motion, before, inputs, sliding, min(length, first_length), t)
        start, before, after = before, motion.readings(0.0), motion.readings(length)
        if not np.all(np.isfinite(after.guards)):
            raise FloatingPointError
        first, stopped = None, frozenset[int]()
        for index in sliding:  # the motion beyond a stop means nothing
            if (stop := self._stop(motion, index, before, length)) is not None:
                first, stopped, length = stop, frozenset({index}), stop
        after = motion.readings(length)
        left_out = ignored.copy()
        left_out[[self._model.layout.gaps + index for index in sliding]] = 1
        first, cause = self._contacts.first_event(motion.start, length, first, left_out)
        if first == 0.0 and steady:
            negative = np.flatnonzero((after.guards < -self._tolerance) & (left_out == 0))
            if np.any(start.guards[negative[negative >= cause]] > self._tolerance):
                # only with the directions at the end: of a shorter part these are nearer to those at the start
                return self.stage(y, inputs, t, SHORTENING * length, first_length, ignored)
        if self._model.features is not None:
            known = self._model.features.clearances()
            first = self._model.features.first_change(motion, inputs, known, first, length)
        if first is None:
            return Stage(length, False, motion.state(length), creeps=self._creeps(after, sliding))
        return Stage(first, True, motion.state(first), stopped if first == length else frozenset())

    def _turning(self, motion: TrialMotion, before: OneSidedReadings, sliding: list[int], length: float) -> list[int]:
        """The elements whose slip changes, or could turn, by much within a length; also those that begin to slide."""
        found, after = [], motion.readings(length)
        for index in sliding:
            slip, then, place = self._slip(before, index), self._slip(after, index), self._place[index]
            change, speed = math.hypot(then[0] - slip[0], then[1] - slip[1]), _speed(slip)
            rate = max(float(before.turning[place]), float(after.turning[place]))
            if change > TURNING * speed or (speed > self._model.slow and length * rate > STIFF):
                found.append(index)
        return found

    def _straight(self, y: Array, inputs: Array, t: float, length: float, turning: list[int]) -> TrialMotion | None:
        """The motion with constant directions of friction, if the slips keep these directions."""
        if not turning:
            return None
        directions = [self._direction(index, inputs) for index in turning]
        motion = self._fixed(y, inputs, t, turning, directions)
        for index, direction in zip(turning, directions, strict=True):
            was, now = (self._slip(motion.readings(s), index) for s in (0.0, length))
            if not _is_straight(direction, was, now, self._noise):
                return None
        return motion

    def _resolved_length(
        self, motion: TrialMotion, before: OneSidedReadings, inputs: Array, sliding: list[int], length: float, t: float
    ) -> float:
        """The length of a part of a step in which no slip turns much."""
        shortest = SHORTEST * max(1.0 / self._model.units.rate, abs(t))
        while length > shortest:
            shorter = self._resolved(before, motion.readings(length), sliding, length)
            if shorter >= length:
                break
            length = max(shorter, shortest)
        return length

    def _steady(
        self, motion: TrialMotion, before: OneSidedReadings, turning: list[int], length: float
    ) -> tuple[list[int], float]:
        """The elements whose friction turns their slip much faster than it changes, and how long it does."""
        moving = [index for index in turning if _speed(self._slip(before, index)) > self._model.slow]
        rates = {index: float(before.turning[self._place[index]]) / STIFF for index in moving}
        fastest = max(rates.values(), default=0.0)
        if length * fastest <= STEADY:
            return [], length
        brief = BRIEF / fastest
        soon = motion.readings(brief)
        for index in moving:
            slip, then = self._slip(before, index), self._slip(soon, index)
            change = math.hypot(then[0] - slip[0], then[1] - slip[1]) / brief
            if change > 0.0:
                length = min(length, SHORTER * TURNING * _speed(slip) / change)
        return [index for index in moving if length * rates[index] > 1.0] if length * fastest > STEADY else [], length

    def _fixed(
        self, y: Array, inputs: Array, t: float, elements: list[int], directions: list[list[float]]
    ) -> TrialMotion:
        """The motion with these constant directions of friction."""
        given = inputs.copy()
        layout, modes = self._model.layout, self._model.modes(given)
        first = layout.direction.start - layout.gaps
        for index, direction in zip(elements, directions, strict=True):
            for row, part in zip(self._model.frictions[index][0], direction, strict=True):
                modes[first + row] = FIXED * part
        return TrialMotion(self._model, y, given, t)

    def _along_fixed(self, y: Array, inputs: Array, t: float, length: float, elements: list[int]) -> TrialMotion:
        """The motion with constant directions of friction, which are those that the slips have at the end.

        That is stable however fast friction turns the slips; these are then so slow that it is accurate as well.
        """
        angles = np.array([math.atan2(*reversed(self._direction(index, inputs))) for index in elements])

        def across(trial: Array) -> tuple[Array, TrialMotion]:
            directions = [[math.cos(angle), math.sin(angle)] for angle in trial.tolist()]
            motion = self._fixed(y, inputs, t, elements, directions)
            slips = [self._slip(motion.readings(length), index) for index in elements]
            pairs = zip(slips, directions, strict=True)
            return np.array([slip[1] * along[0] - slip[0] * along[1] for slip, along in pairs]), motion

        found, motion = across(angles)
        for _ in range(NEWTON_STEPS):
            jacobian = np.empty((len(elements), len(elements)))
            for column in range(len(elements)):
                moved = angles.copy()
                moved[column] += ANGLE
                jacobian[:, column] = (across(moved)[0] - found) / ANGLE
            angles = angles - solve(jacobian, found)
            last, (found, motion) = found, across(angles)
            if not np.max(np.abs(found)) < 0.5 * np.max(np.abs(last)):
                break
        return motion

    def _slip(self, readings: OneSidedReadings, index: int) -> list[float]:
        rows = self._model.frictions[index][0]
        return [float(readings.rates[row]) for row in rows]

    def _creeps(self, readings: OneSidedReadings, sliding: list[int]) -> bool:
        return any(self._model.slow < _speed(self._slip(readings, index)) <= self._stopped for index in sliding)

    def _turn(self, readings: OneSidedReadings, inputs: Array, sliding: list[int]) -> None:
        """Store the present directions of sliding."""
        layout, modes = self._model.layout, self._model.modes(inputs)
        first = layout.direction.start - layout.gaps
        for index in sliding:
            rows = self._model.frictions[index][0]
            slip = readings.rates[list(rows)].tolist()
            speed = math.hypot(*slip)
            if speed > self._model.slow:
                for row, part in zip(rows, slip, strict=True):
                    modes[first + row] = part / speed

    def _direction(self, index: int, inputs: Array) -> list[float]:
        """The stored direction of sliding."""
        layout, modes = self._model.layout, self._model.modes(inputs)
        first = layout.direction.start - layout.gaps
        return [float(modes[first + row]) for row in self._model.frictions[index][0]]

    def _resolved(self, before: OneSidedReadings, after: OneSidedReadings, sliding: list[int], length: float) -> float:
        """A length within which no slip turns much."""
        share = 1.0
        for index in sliding:
            was, now, place = self._slip(before, index), self._slip(after, index), self._place[index]
            speed, change = _speed(was), math.hypot(now[0] - was[0], now[1] - was[1])
            if speed <= self._model.slow:  # sliding begins; no method is accurate in that, but for a short while
                if change > self._stopped:
                    share = min(share, SHORTER * self._stopped / change)
                continue
            rate = max(float(before.turning[place]), float(after.turning[place])) if speed > self._stopped else 0.0
            excess = max(change / ((TURNING if speed > self._stopped else STOPPING) * speed), length * rate / STIFF)
            if excess > 1.0:
                share = min(share, max(SHORTER / excess, SHORTENING))
        return share * length

    def _stop(self, motion: TrialMotion, index: int, before: OneSidedReadings, length: float) -> float | None:
        """Where a slip along two directions stops, or None."""
        rows = list(self._model.frictions[index][0])
        was = before.rates[rows].tolist()
        speed = math.hypot(*was)
        if speed <= self._model.slow:
            return None
        along = [part / speed for part in was]

        def forward(at: OneSidedReadings) -> float:
            slip = at.rates[rows].tolist()
            return float(along[0] * slip[0] + along[1] * slip[1])

        if length == 0.0 or (last := forward(motion.readings(length))) >= 0.0:
            return None
        return first_zero(lambda s: forward(motion.readings(s)), length, speed, last, 0.0)


def _speed(slip: list[float]) -> float:
    return math.hypot(*slip)


def _is_straight(direction: list[float], was: list[float], now: list[float], noise: float) -> bool:
    """Whether a slip has the direction before and after it has changed, or has reversed it."""
    change = math.hypot(now[0] - was[0], now[1] - was[1])
    across = max(abs(direction[0] * slip[1] - direction[1] * slip[0]) for slip in (was, now))
    return across <= STRAIGHT * change + noise
