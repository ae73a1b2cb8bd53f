"""What a compiled mechanism says of its contacts."""

from __future__ import annotations

import numpy as np

from mbd_sim.dynamics.equations import Equations
from mbd_sim.dynamics.evaluation import evaluated
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.mechanism.source import Location
from mbd_sim.simulation.contact_records import ContactState
from mbd_sim.simulation.contact_terms import ContactModel
from mbd_sim.simulation.state_records import Losses


class ContactingModel:
    """The part of a `Model` that concerns one-sided elements and compliant contacts.

    `contact` is None without one-sided elements. `loss_range` is that of `Losses` in a state with them.
    """

    mechanism: Mechanism
    equations: Equations
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
    def placed_contacts(self) -> tuple[tuple[Location, int | None], ...]:
        """The elements of the contacts that have a place: those of `contact.placed`, then the compliant ones.

        With each is the index of the input that is 1 while it is closed; None for compliant contacts.
        """
        found = list[tuple[Location, int | None]]()
        if self.contact is not None:
            owners = [self.contact.owners[gap] for gap in self.contact.placed]
            found += zip(owners, self.contact.placed_inputs, strict=True)
        found += [(("contacts", contact.name), None) for contact in self.mechanism.contacts if not contact.rigid]
        return tuple(found)

    def contact_places(self, time: float, y: Array, inputs: Array) -> Array:
        """(n, 2, 3): the points in m of the `placed_contacts`, and their forces in N, in ground's frame."""
        placed, cushions = 0 if self.contact is None else len(self.contact.placed), self.equations.cushions
        out = np.empty((placed, 2, 3))
        if placed:
            self._read("contact_places", time, y, out, self.with_contact_forces(time, y, inputs))
        if cushions is None:
            return out
        return np.concatenate([out, evaluated(cushions, time, y, inputs).T.reshape(-1, 2, 3)])

    def contacts(self, time: float, y: Array, inputs: Array) -> dict[str, ContactState]:
        """Each one-sided element by name; see `ContactState`."""
        if self.contact is None:
            return {}
        places = self.contact_places(time, y, inputs)[: len(self.contact.placed)]
        return self.contact.states(time, y, inputs, places)

    def _read(self, name: str, time: float, y: Array, out: Array, inputs: Array | None) -> Array:
        raise NotImplementedError
