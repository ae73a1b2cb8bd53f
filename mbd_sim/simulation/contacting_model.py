"""What a compiled mechanism says of its contacts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.source import Location
from mbd_sim.simulation.readable_model import ReadableModel
from mbd_sim.simulation.state_records import Losses

if TYPE_CHECKING:
    from mbd_sim.dynamics.compliant_contacts import CushionFunctions
    from mbd_sim.mechanism.contacts import Contact
    from mbd_sim.simulation.contact_records import ContactState
    from mbd_sim.simulation.contact_terms import ContactModel


class ContactingModel(ReadableModel):
    """The part of a `Model` that concerns one-sided elements and compliant contacts.

    `contact` is None without one-sided elements. `loss_range` is that of `Losses` in a state with them.
    """

    contact: ContactModel | None
    loss_range: slice

    def with_contact_forces(self, time: float, y: Array, inputs: Array) -> Array:
        """The inputs with the forces of contacts, which functions that read forces take from there."""
        if self.contact is None:
            return inputs
        return self.contact.with_forces(time, y, inputs)

    def losses(self, y: Array) -> Losses:
        """The energies that one-sided elements have dissipated."""
        if self.contact is None:
            return Losses(0.0, 0.0)
        return Losses(*y[self.loss_range].tolist())

    @property
    def compliant_contacts(self) -> tuple[Contact, ...]:
        """Those contacts between shapes that are not rigid."""
        return tuple(contact for contact in self.mechanism.contacts if not contact.rigid)

    @property
    def _cushions(self) -> CushionFunctions | None:
        return self.equations.cushions if self.compliant_contacts else None

    @property
    def placed_contacts(self) -> tuple[tuple[Location, int | None], ...]:
        """The elements of the contacts that have a place: those of `contact.placed`, then the compliant ones.

        With each is the index of the input that is 1 while it is closed; None for compliant contacts.
        """
        found = list[tuple[Location, int | None]]()
        if self.contact is not None:
            owners = [self.contact.owners[gap] for gap in self.contact.placed]
            found += zip(owners, self.contact.placed_inputs, strict=True)
        found += [(("contacts", contact.name), None) for contact in self.compliant_contacts]
        return tuple(found)

    def contact_places(self, time: float, y: Array, inputs: Array) -> Array:
        """(n, 2, 3): the points in m of the `placed_contacts`, and their forces in N, in ground's frame."""
        from mbd_sim.dynamics.evaluation import evaluated

        placed, cushions = 0 if self.contact is None else len(self.contact.placed), self._cushions
        out = np.empty((placed, 2, 3))
        if placed:
            self._read("contact_places", time, y, out, self.with_contact_forces(time, y, inputs))
        if cushions is None:
            return out
        return np.concatenate([out, evaluated(cushions.places, time, y, inputs).T.reshape(-1, 2, 3)])

    def contacts(self, time: float, y: Array, inputs: Array) -> dict[str, ContactState]:
        """Each one-sided element by name, then each compliant contact; see `ContactState`."""
        places = self.contact_places(time, y, inputs)
        found: dict[str, ContactState] = {}
        if self.contact is not None:
            found = self.contact.states(time, y, inputs, places[: len(self.contact.placed)])
        return found | self._compliant(time, y, inputs, places)

    def _compliant(self, time: float, y: Array, inputs: Array, places: Array) -> dict[str, ContactState]:
        from mbd_sim.simulation.compliant_states import compliant_names, states_of_compliant_contacts

        if (cushions := self._cushions) is None:
            return {}
        own = places[len(places) - len(cushions.directions) :]
        states = states_of_compliant_contacts(cushions, time, y, inputs, own)
        return dict(zip(compliant_names(self.compliant_contacts), states, strict=True))

    def contact_entry_names(self) -> list[str]:
        """The names of the `contact_entries`, such as `floor`, `floor.friction_1`, `floor.friction_2`."""
        from mbd_sim.simulation.compliant_states import compliant_names
        from mbd_sim.simulation.contact_records import with_friction

        names = [] if self.contact is None else self.contact.entry_names()
        if (cushions := self._cushions) is not None:
            for name, directions in zip(compliant_names(self.compliant_contacts), cushions.directions, strict=True):
                names += with_friction(name, directions)
        return names

    def contact_entries(self, time: float, y: Array, inputs: Array) -> list[tuple[float, float, float]]:
        """For each contact its gap, rate and force; after it, for each direction of friction, sliding, slip and force.

        One-sided elements come first; friction in joints has no entry of its own besides those of its directions.
        """
        found = [] if self.contact is None else self.contact.entries(time, y, inputs)
        if self._cushions is not None:
            for state in self._compliant(time, y, inputs, self.contact_places(time, y, inputs)).values():
                found += [(state.gap, state.rate, state.normal), *state.friction_entries]
        return found
