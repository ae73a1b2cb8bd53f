"""What can be read at the contacts of a model at one instant.

The states of compliant contacts come from the numbers that their equations give.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.short_repr import short_repr
from mbd_sim.dynamics.math.expressions import evaluated
from mbd_sim.mechanism.elements.contacts import Contact
from mbd_sim.mechanism.values.source import Location
from mbd_sim.simulation.contact.records import ContactState, with_friction

if TYPE_CHECKING:
    from mbd_sim.dynamics.contact.compliant import ComplianceFunctions
    from mbd_sim.simulation.contact.one_sided_model import OneSidedModel


class ContactReadings:
    """What can be read at the contacts of a model: at its one-sided elements, and then at its compliant contacts."""

    __repr__ = short_repr

    def __init__(
        self,
        one_sided: OneSidedModel | None,
        compliant: Sequence[Contact],
        compliances: ComplianceFunctions | None,
        read_places: Callable[[float, Array, Array, Array], Array],
    ) -> None:
        """`compliances` are the functions of the compliant contacts.

        :param read_places: the points, forces and normals of the one-sided elements that have a place, into (n, 3, 3);
            but of slots that pairs share, which are the last ones.
        """
        self._one_sided, self._compliant, self._compliances = one_sided, compliant, compliances
        self._read_places = read_places
        self._placed = 0 if one_sided is None else len(one_sided.placed)

    @property
    def placed(self) -> tuple[tuple[Location, int | None], ...]:
        """The elements of the contacts that have a place: those of `one_sided.placed`, then the compliant ones.

        With each is the index of the input that is 1 while it is closed; None for compliant contacts.
        """
        found = list[tuple[Location, int | None]]()
        if self._one_sided is not None:
            owners = [self._one_sided.owners[gap] for gap in self._one_sided.placed]
            found += zip(owners, self._one_sided.placed_inputs, strict=True)
        found += [(("contacts", contact.name), None) for contact in self._compliant]
        return tuple(found)

    def placed_names(self) -> list[str]:
        """The names of the `placed` contacts, as in `states`."""
        names = [] if self._one_sided is None else [self._one_sided.names[gap] for gap in self._one_sided.placed]
        return names + compliant_names(self._compliant)

    def places(self, time: float, y: Array, inputs: Array) -> Array:
        """(n, 3, 3): the points in m of the `placed` contacts, their forces in N, and normals, in ground's frame."""
        out, pooled = np.empty((self._placed, 3, 3)), 0 if self._one_sided is None else self._one_sided.layout.pooled
        if own := self._placed - pooled:
            self._read_places(time, y, inputs, out[:own])
        if self._one_sided is not None and pooled:
            out[own:] = self._one_sided.places_of_pools(time, y, inputs)
        if self._compliances is None:
            return out
        return np.concatenate([out, evaluated(self._compliances.places, time, y, inputs).T.reshape(-1, 3, 3)])

    def states(self, time: float, y: Array, inputs: Array) -> dict[str, ContactState]:
        """The state of each contact by name."""
        places = self.places(time, y, inputs)
        found: dict[str, ContactState] = {}
        if self._one_sided is not None:
            found = self._one_sided.states(time, y, inputs, places[: self._placed])
        return found | self._compliant_states(time, y, inputs, places)

    def _compliant_states(self, time: float, y: Array, inputs: Array, places: Array) -> dict[str, ContactState]:
        if self._compliances is None:
            return {}
        states = states_of_compliant_contacts(self._compliances, time, y, inputs, places[self._placed :])
        return dict(zip(compliant_names(self._compliant), states, strict=True))

    def entry_names(self) -> list[str]:
        """The names of the `entries`, such as `floor`, `floor.friction_1`, `floor.friction_2`."""
        names = [] if self._one_sided is None else self._one_sided.entry_names()
        if self._compliances is not None:
            for name, directions in zip(compliant_names(self._compliant), self._compliances.directions, strict=True):
                names += with_friction(name, directions)
        return names

    def entries(self, time: float, y: Array, inputs: Array) -> list[tuple[float, float, float]]:
        """For each contact its gap, rate and force; after it, for each direction of friction, sliding, slip and force.

        Friction in joints has no entry of its own besides those of its directions.
        """
        found = [] if self._one_sided is None else self._one_sided.entries(time, y, inputs)
        if self._compliances is not None:
            for state in self._compliant_states(time, y, inputs, self.places(time, y, inputs)).values():
                found += [(state.gap, state.rate, state.normal), *state.friction_entries]
        return found


def compliant_names(contacts: Sequence[Contact]) -> list[str]:
    """The name of each compliant contact: with both bodies where several belong to one entry of the file."""
    names = [contact.name for contact in contacts]
    return [
        f"{contact.name}.{contact.quantity.replace(' ', '_').replace(',', '')}"
        if names.count(contact.name) > 1
        else contact.name
        for contact in contacts
    ]


def states_of_compliant_contacts(
    compliances: ComplianceFunctions, time: float, y: Array, inputs: Array, places: Array
) -> Iterator[ContactState]:
    """The state of each compliant contact; `places` (n, 3, 3) are their points, forces and normals.

    The gap is negative by the depth. They are open where they exert no force, and never stick.
    """
    readings, first = evaluated(compliances.readings, time, y, inputs).ravel(), 0
    for count, place in zip(compliances.directions, places, strict=True):
        gap, rate, normal = readings[first : first + 3].tolist()
        friction, slip = readings[first + 3 : first + 3 + 2 * count].reshape(2, count)
        closed = "slides" if count else "closed"
        yield ContactState(closed if normal > 0.0 else "open", gap, rate, normal, friction, slip, *place)
        first += 3 + 2 * count
