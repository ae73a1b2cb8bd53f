"""Contacts as plain records: what happens at them, and what can be read from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.short_repr import record

ROUND_OFF = 1e-12  # of the largest impulse of an impact
REMEDY = "Take smaller steps, or choose time stepping with method moreau."


class ContactChange(StrEnum):
    """What happened at a contact."""

    CLOSED = "closed"
    OPENED = "opened"
    STICKS = "sticks"
    SLIDES = "slides"
    IMPACT = "impact"
    BOUND = "too many events"
    UNSOLVED = "not solved"


@dataclass(frozen=True, slots=True)
class ContactEvent:
    """A change at the element `name` at `time` in s.

    Of an impact, `impulse` is that along the normal in N·s or N·m·s, and `loss` the energy in J that the whole impact
    dissipated; of a step that is not solved it is the relative residual. `factor` below 1 says that restitution was
    reduced by it, because otherwise energy would have grown; 0 also that there are no impulses with which the mechanism
    could rebound.
    """

    time: float
    name: str
    change: ContactChange
    impulse: float = 0.0
    loss: float = 0.0
    factor: float = 1.0

    @property
    def text(self) -> str:
        """The event for people, on one line."""
        if self.change is ContactChange.BOUND:
            head = f"contacts: {self.change} within the step at {self.time:.6f} s"
            return f"{head}; the rest of the step is taken without further events. {REMEDY}"
        if self.change is ContactChange.UNSOLVED:
            head = f"contacts: the laws are not satisfied in the step that ends at {self.time:.6f} s"
            return (
                f"{head}: the impulses are {self.loss:.1g} of their size off. Take smaller steps, or reduce friction."
            )
        text = f"{self.name}: {self.change} at {self.time:.6f} s"
        if self.change is ContactChange.IMPACT:
            text += f", impulse {self.impulse:.4g}, loss {self.loss + 0.0:.4g} J"
            if self.factor == 0.0:
                text += "; without restitution: with it no impulses are possible, or energy would grow"
            elif self.factor < 1.0:
                text += f"; restitution reduced to {self.factor:.3g} of its value, so that energy does not grow"
        return text


def without_round_off(events: Sequence[ContactEvent]) -> list[ContactEvent]:
    """The events, without impacts whose impulse is the round-off of others at the same instant.

    A body that rests on a stop takes part in an impact elsewhere, with an impulse that would be zero if numbers were
    exact: nothing has happened there.
    """
    largest = dict[float, float]()
    for event in events:
        if event.change is ContactChange.IMPACT:
            largest[event.time] = max(largest.get(event.time, 0.0), abs(event.impulse))
    return [
        event
        for event in events
        if event.change is not ContactChange.IMPACT or abs(event.impulse) > ROUND_OFF * largest[event.time]
    ]


class ContactObserver(Protocol):
    """Sees what happens at contacts while steps are computed, also in those that then fail; it changes nothing."""

    def impact(self, time: float, before: float, after: float) -> None:
        """An impact at `time` in s, with the total energies in J before and after it."""

    def event(self, event: ContactEvent) -> None:
        """A change at a contact."""


@record
class ContactState:
    """A contact at one instant.

    `gap` in m or rad, and its `rate`; `normal` force λ ≥ 0 in N or N·m; `friction` and `slip` (k,) along the k = 0, 1
    or 2 directions of friction, in N or N·m and m/s or rad/s. `state` is "open", "sticks", "slides", or "closed" where
    there is no friction. Friction without a gap has the gap 0 and no normal force. The gap of a compliant contact is
    negative by its depth; it is open where it exerts no force, and does not stick. Of an open slot, at which nothing
    touches, the gap is a lower bound of the distance of both bodies.

    `point` (3,) in m is where it touches, `force` (3,) in N what it exerts on the first part, friction included, and
    `direction` (3,) the unit normal along which `normal` acts on that part, all in ground's frame. The first part is
    that of the constrained point, of the wheel, or of the shape that is named first. Of a rope or strut they are those
    of its last end, or of the first where the last is on ground. They are None for open slots, and for stops, plays,
    clutches and friction in joints.

    Where many bodies touch, an entry belongs to different pairs in turn: `bodies` are the names of the shapes of that
    which it belongs to, the first part first; None while it is open, and for other contacts. The gap of an open one
    is that of the nearest pair.
    """

    state: str
    gap: float
    rate: float
    normal: float
    friction: Array
    slip: Array
    point: Array | None = None
    force: Array | None = None
    direction: Array | None = None
    bodies: tuple[str, str] | None = None

    @property
    def friction_entries(self) -> list[tuple[float, float, float]]:
        """For each direction of friction: 1 while it slides, the slip and the force."""
        slides = float(self.state == "slides")
        return [(slides, *pair) for pair in zip(self.slip.tolist(), self.friction.tolist(), strict=True)]


def with_friction(name: str, directions: int) -> list[str]:
    """The names of the entries of a contact: its own, and one for each direction of friction."""
    return [name, *(f"{name}.friction_{number}" for number in range(1, directions + 1))]
