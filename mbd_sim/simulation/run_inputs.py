"""What acts on a simulation from the next step on: efforts, wrenches, commands of actuators, and live values."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

from mbd_sim import compiler
from mbd_sim.geometry.pose import Array
from mbd_sim.simulation.actuator_commands import Command, CommandMap
from mbd_sim.simulation.efforts import EffortMap
from mbd_sim.simulation.live_values import PreparedValues, require_closed
from mbd_sim.simulation.read_only import ReadOnlyView
from mbd_sim.simulation.readings import Readings
from mbd_sim.simulation.run_reports import RunReports
from mbd_sim.simulation.wrenches import WrenchMap


class RunInputs(Readings, RunReports):
    """The part of a `Simulation` that writes the inputs of its kernel."""

    effort_map: EffortMap
    command_map: CommandMap
    wrench_map: WrenchMap
    _efforts: Array

    def set_efforts(self, efforts: Mapping[str, float] | Sequence[float] | Array) -> None:
        """Set the efforts (N or N·m) from the next step on, all in order or some by name, clamped to the effort limits.

        :raises CommandError: wrong length, an unknown name, or a value that is not finite; nothing is changed then.
        """
        self._write_efforts(efforts)

    @cached_property
    def _write_efforts(self) -> Callable[..., None]:
        """Compiled code that does without a listener what `_change_efforts` does, and calls that if it cannot.

        From its first call on, the code also replaces the method that is called on the simulation.
        """
        shared = self._efforts, self.effort_map.limits, self._unobserved
        if type(self).set_efforts is RunInputs.set_efforts:  # a subclass with its own `set_efforts` keeps it
            method, signature = self.set_efforts, "set_efforts(efforts)"
            vars(self)["set_efforts"] = compiler.bounded_writer(*shared, method, signature, ReadOnlyView)
        return compiler.bounded_writer(*shared, self._change_efforts, "write(efforts)", ReadOnlyView)

    def _change_efforts(self, efforts: Mapping[str, float] | Sequence[float] | Array) -> None:
        new = self.effort_map.clamped(self.effort_map.merged(self._efforts, efforts))
        repeated = self._is_repeated(self._efforts, new)
        self._efforts[:] = new
        if not repeated:
            self._report_efforts(new)

    def set_wrench(
        self,
        part: str,
        force: Sequence[float] | Array = (0.0, 0.0, 0.0),
        couple: Sequence[float] | Array = (0.0, 0.0, 0.0),
        *,
        at: str | Sequence[float] | Array | None = None,
        axes: str = "ground",
    ) -> None:
        """Apply a force (N) and a couple (N·m) to a part from the next step on; they replace the previous ones.

        :param at: where the force acts: the name of a point of the part, or (3,) in m in its frame; by default the
            center of mass.
        :param axes: of both vectors: "ground", or "part" for axes that turn with the part.
        :raises CommandError: the part is not among the `wrenches` of the simulation, a point or axes that do not
            exist, or a vector that is not three finite numbers; nothing is changed then.
        """
        numbers = self.wrench_map.numbers(part, force, couple, at, axes)
        inputs = self._memory.inputs[self.wrench_map.slices[part]]
        repeated = self._is_repeated(inputs, numbers)
        inputs[:] = numbers
        if not repeated:
            self._report_wrench(part, numbers)

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

    @property
    def live(self) -> Mapping[str, float]:
        """The live values by key, in SI units."""
        return dict(self._live.current)

    def set_live(self, changes: Mapping[str, float | str]) -> None:
        """Change live values from the next step on. The energy audit does not include the resulting change of energy.

        Live values that have not been given themselves follow the others, as their formulas in the file say.

        :param changes: numbers in SI units, or texts with units such as `"30 deg"`, by their keys.

        :raises CommandError: an unknown key, a value that does not fit, or one that would open loops; nothing is
            changed then.
        """
        self.apply_live(self.prepare_live(changes))

    def prepare_live(self, changes: Mapping[str, float | str]) -> PreparedValues:
        """The first, slow half of `set_live`: validate changes. It changes nothing and may run in any thread.

        :raises CommandError: an unknown key, or a value that does not fit.
        """
        return self._live.prepare(changes)

    def apply_live(self, prepared: PreparedValues) -> None:
        """The second, fast half of `set_live`; no other change may have been applied since `prepare_live`.

        Efforts beyond changed limits are clamped.

        :raises CommandError: the change would open loops in the present state; nothing is changed then.
        """
        inputs, y = self._memory.inputs.copy(), self.y.copy()
        inputs[self.model.input_layout.values] = prepared.inputs
        gap = self.model.violation(self.time, self.y, inputs).position
        require_closed(prepared.changes, gap, self.violation.position)
        before = self.energies.total
        self.model.keep_accounts(self.time, self.y, y, self._memory.inputs, inputs)
        self._memory.inputs[:], self._memory.y[:] = inputs, y
        self._live.apply(prepared)
        self.start_energy += self.energies.total - before
        self._memory.settle()
        self._report_live_values(prepared.changes)
        self._live.limit(self.effort_map)
        self.set_efforts(self._efforts.copy())
