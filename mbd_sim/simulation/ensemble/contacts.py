"""Members of an ensemble with one-sided elements: each goes through its own events, as a single simulation does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.errors import CommandError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.compiler.ensemble_kernel import Advance
from mbd_sim.simulation.contact.events import EventError, OneSidedStepper
from mbd_sim.simulation.ensemble.variants import Variants
from mbd_sim.simulation.kernel.contact_stepper import one_sided_stepper
from mbd_sim.simulation.model.model import Model
from mbd_sim.simulation.run.changes import require_outside


def member_contacts(model: Model, variants: Variants, count: int) -> tuple[OneSidedStepper, ...]:
    """The stepper of each of `count` members, or none at all where everything is two-sided."""
    if model.one_sided is None:
        return ()
    return tuple(one_sided_stepper(model, variants.mechanism_of(member)) for member in range(count))


def settle_members(
    model: Model, contacts: Sequence[OneSidedStepper], members: NDArray[np.intp], states: Array, inputs: Array
) -> None:
    """Find the modes of some members at time zero, in place, with impacts where contacts approach.

    :param contacts: of all members.
    :param states: (k, n), and `inputs` (k, m), of these members.
    :raises CommandError: a member is inside an obstacle.
    :raises EventError: contacts without a solution; both errors name the member.
    """
    for member, y, row in zip(members.tolist() if contacts else (), states, inputs, strict=False):
        contacts[member].events.clear()
        try:
            require_outside(model, 0.0, y, row)
            contacts[member].settle(0.0, y, row)
        except (CommandError, EventError) as error:
            raise type(error)(f"member {member}: {error}") from error


def advance_through_events(contacts: Sequence[OneSidedStepper]) -> Advance:
    """Advance each member, in a group by itself; one whose contacts have no solution is no longer alive."""

    def advance(arrays: Mapping[str, Array], first: int, h: float, steps: int, groups: range) -> None:
        for group in groups:
            y, inputs, estimate, alive = (arrays[name][group, :, 0] for name in ("y", "inputs", "estimates", "alive"))
            if alive[0]:
                try:
                    alive[0] = float(contacts[group].advance(y, inputs, np.array([first]), h, steps, estimate))
                except EventError:
                    alive[0] = 0.0

    return advance
