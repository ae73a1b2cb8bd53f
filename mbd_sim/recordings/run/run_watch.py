"""Watches a run for an event after which a ring of its last seconds is written: an impact, or a condition."""

from __future__ import annotations

from mbd_sim.base.errors import InputError
from mbd_sim.base.short_repr import short_repr
from mbd_sim.mechanism.values.expression import evaluate, names_in, require_valid
from mbd_sim.simulation.contact.records import ContactChange
from mbd_sim.simulation.model.state_records import Energies
from mbd_sim.simulation.run.events import EventKind, Payload
from mbd_sim.simulation.run.simulation import BaseSimulation

IMPACT = "impact"
CHECKS = 1000.0  # of a threshold, in each second of simulated time, at most one in each step


class Threshold:
    """A condition such as `abs(elbow.velocity) > 3`, of coordinates, their velocities, energies and the time `t`."""

    __repr__ = short_repr

    def __init__(self, simulation: BaseSimulation, text: str) -> None:
        """Check the expression; it holds where it is neither 0 nor false.

        :raises InputError: it is no expression, or has an unknown name.
        """
        self.text, self._simulation = text, simulation
        self._coordinates = {name: index for index, name in enumerate(simulation.coordinate_names)}
        known = ["t", *self._coordinates, *(f"{name}.velocity" for name in self._coordinates)]
        known += [f"energy.{name}" for name in Energies._fields]
        require_valid(self._condition, known, {})
        self._names = names_in(self._condition)

    @property
    def _condition(self) -> str:
        return f"where({self.text}, 1, 0)"

    def holds(self) -> bool:
        """Whether it holds in the present state."""
        simulation = self._simulation
        positions, speeds = simulation.model.coordinates(simulation.state), simulation.u
        values = {"t": simulation.time}
        for name, index in self._coordinates.items():
            values[name], values[f"{name}.velocity"] = float(positions[index]), float(speeds[index])
        if any(name.startswith("energy.") for name in self._names):
            values |= {f"energy.{name}": float(value) for name, value in simulation.energies._asdict().items()}
        return evaluate(self._condition, values) != 0.0


class RunWatch:
    """Looks between steps for an event, and says when it and the time after it have passed.

    The next event counts `rest` seconds later, and a condition only if it has not held in between. `cause` is the last
    event. With an empty `when` there is none.
    """

    __repr__ = short_repr

    def __init__(self, simulation: BaseSimulation, when: str, after: float = 0.0, *, rest: float = 0.0) -> None:
        """Check what to look for.

        :param when: `impact`, or a condition, see `Threshold`.
        :param after: simulated seconds from the event.
        :raises InputError: the condition or the time is not possible.
        """
        if not after >= 0.0:
            raise InputError(f"{after:g} s after an event is not possible", "Give a positive time.")
        self.cause, self._simulation = "", simulation
        self._on_impact = when == IMPACT
        self._threshold = Threshold(simulation, when) if when and not self._on_impact else None
        step = simulation.step_size
        self._check_steps = max(round(1.0 / CHECKS / step), 1)
        self._after_steps, self._rest_steps = round(after / step), round(rest / step)
        self._left: int | None = None  # steps until the time after an event has passed
        self._resting = 0  # steps in which no event counts
        self._held = False  # whether the condition has held since the last event

    @property
    def looks(self) -> bool:
        """Whether there is anything to look for."""
        return self._on_impact or self._threshold is not None

    @property
    def has_event(self) -> bool:
        """Whether an event has occurred whose time has not passed yet."""
        return self._left is not None

    def most_steps(self, steps: int) -> int:
        """These steps, or fewer, to take until it must look again."""
        if self._left is not None:
            return min(steps, max(self._left, 1))
        return min(steps, self._check_steps) if self.looks else steps

    def notice(self, kind: EventKind, payload: Payload) -> None:
        """Take an event of the run."""
        if kind is EventKind.CONTACT and self._on_impact and _is_impact(str(payload)):
            self._triggered(str(payload))

    def passed(self, steps: int) -> bool:
        """Whether an event and the time after it have passed, now that some more steps have been taken."""
        if self._left is not None:
            self._left -= steps
        else:
            self._resting = max(self._resting - steps, 0)
            if self._threshold is not None:
                held, self._held = self._held, self._threshold.holds()
                if self._held and not held:
                    self._triggered(f"{self._threshold.text} at t = {self._simulation.time:.9g} s")
        if self._left is None or self._left > 0:
            return False
        self._left, self._resting = None, self._rest_steps
        return True

    def _triggered(self, cause: str) -> None:
        if self._left is None and not self._resting:
            self.cause, self._left = cause, self._after_steps


def _is_impact(text: str) -> bool:
    return f": {ContactChange.IMPACT} at " in text
