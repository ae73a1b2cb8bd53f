"""What a compiled mechanism says of its actuators."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.simulation.readable_model import ReadableModel

if TYPE_CHECKING:
    from mbd_sim.simulation.actuator_states import AnyActuatorState


class ActuatedModel(ReadableModel):
    """The part of a `Model` that concerns actuators."""

    coordinate_names: tuple[str, ...]

    def hold_start(self, y: Array, inputs: Array, mechanism: Mechanism | None = None) -> None:
        """Set states and commands of actuators in place to those before the first command at the positions in y.

        :param mechanism: a variant of that of the model with other start commands.
        """
        if self.mechanism.commanded:
            self.equations.hold(mechanism or self.mechanism, y, inputs)

    def actuators(self, time: float, y: Array, inputs: Array) -> dict[str, AnyActuatorState]:
        """Each actuator by name; see `ActuatorState` and `CylinderState`."""
        from mbd_sim.simulation.actuator_states import states_of_actuators

        if not self.mechanism.actuators or (functions := self.equations.actuators) is None:
            return {}
        columns = self._actuator_readings(time, y, inputs)
        return states_of_actuators(self.mechanism.actuators, functions.layout, columns, y, inputs)

    def actuator_efforts(self, time: float, y: Array, inputs: Array) -> Array:
        """The efforts (nv,) of actuators on the coordinates, in N and N·m."""
        from mbd_sim.simulation.actuator_states import efforts_on

        return efforts_on(self.mechanism.actuators, self._actuator_readings(time, y, inputs), self.coordinate_names)

    def keep_accounts(
        self, time: float, before: Array, y: Array, inputs: Array, new_inputs: Array | None = None
    ) -> None:
        """Leave the energy that chambers gain from a change of the state or of live values out of their accounts.

        :param before: the state before, y that after the change, which is corrected in place.
        :param new_inputs: those after the change, by default the same `inputs`.
        """
        if self.mechanism.actuators and (functions := self.equations.actuators) is not None:
            old = functions.stored(time, before, inputs)
            new = functions.stored(time, y, inputs if new_inputs is None else new_inputs)
            for index, stored in new.items():
                y[index] += stored - old[index]

    def _actuator_readings(self, time: float, y: Array, inputs: Array) -> Array:
        assert self.equations.actuators is not None
        rows = self.equations.actuators.readings.size1_out(0)
        return self._read("actuators", time, y, np.empty((len(self.mechanism.actuators), rows)), inputs)
