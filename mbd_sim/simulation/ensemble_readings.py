"""What can be read from the members of an ensemble at their present states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from mbd_sim.errors import counted
from mbd_sim.geometry.pose import Array
from mbd_sim.simulation.contact_events import ContactStepper
from mbd_sim.simulation.contact_records import ContactObserver
from mbd_sim.simulation.ensemble_state import EnsembleState
from mbd_sim.simulation.ensemble_variants import Variants
from mbd_sim.simulation.part_motion import motion_of
from mbd_sim.simulation.state_records import Losses, Reaction


class EnsembleMotion(NamedTuple):
    """The motion of a frame in each member, in ground's axes: see `PartMotion`.

    All are (k, 3), in m, m/s, rad/s, m/s² and rad/s², but the `rotation` matrices (k, 3, 3).
    """

    position: Array
    rotation: Array
    velocity: Array
    angular_velocity: Array
    acceleration: Array
    angular_acceleration: Array


class EnsembleDrive(NamedTuple):
    """A driven coordinate (k,) in m or rad, its velocity, and the force of its drive in N or N·m: see `DriveState`."""

    position: Array
    velocity: Array
    force: Array


class EnsembleReadings(EnsembleState):
    """The readings of an `Ensemble`; they change nothing. Each evaluates one member after the other."""

    _variants: Variants
    _contacts: Sequence[ContactStepper]

    def motion(self, frame: str) -> EnsembleMotion:
        """The motion of a part, or of one of its points, as `part.point`: see `Simulation.motion`.

        :raises InputError: there is no such part or point.
        """
        found = [
            motion_of(self.model, self._variants.mechanism_of(member), frame, self.time, y, inputs)
            for member, (y, inputs) in enumerate(zip(self.state, self._inputs, strict=True))
        ]
        poses, *vectors = zip(*found, strict=True)
        positions, rotations = [pose.position for pose in poses], [pose.rotation for pose in poses]
        return EnsembleMotion(*map(np.array, (positions, rotations, *vectors)))

    def drives(self) -> Mapping[str, EnsembleDrive]:
        """The position, velocity and force of each driven coordinate."""
        columns = np.array(
            [self.model.drives(self.time, y, inputs) for y, inputs in zip(self.state, self._inputs, strict=True)]
        )
        return {name: EnsembleDrive(*columns[..., index].T) for index, name in enumerate(self.model.driven_names)}

    def reactions(self) -> Mapping[str, Reaction]:
        """The force (k, 3) in N and the moment (k, 3) in N·m that each joint transmits: see `Simulation.reactions`."""
        found = [self.model.reactions(self.time, y, inputs) for y, inputs in zip(self.state, self._inputs, strict=True)]
        return {
            name: Reaction(
                np.array([member[name].force for member in found]), np.array([member[name].moment for member in found])
            )
            for name in found[0]
        }

    def losses(self) -> Losses:
        """The energies (k,) in J that impacts and dry friction have dissipated; zero without one-sided elements."""
        found = [self.model.losses(y) for y in self.state]
        return Losses(*np.array(found).T)

    def observe_contacts(self, observers: Sequence[ContactObserver]) -> None:
        """Tell each member's observer of the events at its contacts from now on; without contacts there are none.

        :raises ValueError: the number of observers is not that of the members.
        """
        if len(observers) != len(self):
            counts = f"{counted(len(observers), 'observer')} for {counted(len(self), 'member')}"
            raise ValueError(f"{counts}. Give one for each.")
        for contact, observer in zip(self._contacts, observers, strict=False):
            contact.observer = observer
