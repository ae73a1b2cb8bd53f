"""Compliant contacts at one instant, from the numbers that their equations give."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from mbd_sim.dynamics.evaluation import evaluated
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.contacts import Contact
from mbd_sim.simulation.contact_records import ContactState

if TYPE_CHECKING:
    from mbd_sim.dynamics.compliant_contacts import CushionFunctions


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
    cushions: CushionFunctions, time: float, y: Array, inputs: Array, places: Array
) -> Iterator[ContactState]:
    """The state of each compliant contact; `places` (n, 2, 3) are their points and forces.

    The gap is negative by the depth. They are open where they exert no force, and never stick.
    """
    readings, first = evaluated(cushions.readings, time, y, inputs).ravel(), 0
    for count, place in zip(cushions.directions, places, strict=True):
        gap, rate, normal = readings[first : first + 3].tolist()
        friction, slip = readings[first + 3 : first + 3 + 2 * count].reshape(2, count)
        closed = "slides" if count else "closed"
        yield ContactState(closed if normal > 0.0 else "open", gap, rate, normal, friction, slip, *place)
        first += 3 + 2 * count
