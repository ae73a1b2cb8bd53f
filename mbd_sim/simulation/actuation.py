"""The part of a simulation that commands actuators and reads them."""

from __future__ import annotations

from collections.abc import Mapping

from mbd_sim.geometry.pose import Array
from mbd_sim.simulation.actuator_commands import Command, CommandMap
from mbd_sim.simulation.actuator_states import ActuatorState
from mbd_sim.simulation.compiled_model import Model
from mbd_sim.simulation.kernel_memory import KernelMemory


class Actuation:
    """Commands and readings of the actuators of a `Simulation`."""

    model: Model
    command_map: CommandMap
    _memory: KernelMemory

    def set_commands(self, commands: Mapping[str, Command]) -> None:
        """Command actuators by name from the next step on; the others keep their commands.

        A number acts on the first channel of an actuator: the position or velocity of a servo, or what commands its
        motor. `{"drive": {"position": 1.0, "velocity": 0.5}}` names channels. Units: rad or m, rad/s or m/s, N·m or N,
        V, A. Limits are kept by the actuators themselves.

        >>> sim.set_commands({"drive": 24.0, "lift": {"position": 0.1}})  # doctest: +SKIP

        :raises CommandError: an unknown actuator or channel, or a value that is not finite; nothing is changed then.
        """
        current = self._memory.inputs[self.command_map.range]
        self.apply_command_values(self.command_map.merged(current, commands))

    def apply_command_values(self, values: Array) -> None:
        """Command all channels (n,) in the order of `command_map.names`, with finite numbers, from the next step on."""
        current = self._memory.inputs[self.command_map.range]
        repeated = self._is_repeated(current, values)
        current[:] = values
        if not repeated:
            self._report_commands(values)

    def begin_at(self, positions: Mapping[str, float], velocities: Mapping[str, float]) -> None:
        """Set positions and velocities by name as `set_state` does, and let actuators begin anew, as after a reset.

        :raises CommandError: see `set_state`.
        """
        self.set_state(positions, velocities)
        if self.command_map.names:
            y, inputs = self._memory.y.copy(), self._memory.inputs.copy()
            self.model.hold_start(y, inputs)
            self._memory.load(y, inputs, self._memory.steps, self._memory.error_estimate)
            self._report_new_state()

    def actuators(self) -> Mapping[str, ActuatorState]:
        """Each actuator by name: commands, effort, voltage, current, powers, losses and energies."""
        memory = self._memory
        inputs = self.model.with_contact_forces(self.time, memory.y, memory.inputs)
        return self.model.actuators(self.time, memory.y, inputs)

    @property
    def time(self) -> float:
        """Simulated time in s."""
        raise NotImplementedError

    def set_state(self, positions: Mapping[str, float], velocities: Mapping[str, float]) -> None:
        """Set positions and velocities by name."""
        raise NotImplementedError

    def _report_new_state(self) -> None:
        raise NotImplementedError

    def _is_repeated(self, inputs: Array, command: Array) -> bool:
        raise NotImplementedError

    def _report_commands(self, values: Array) -> None:
        raise NotImplementedError
