"""A run between two steps: commands take effect, steps are taken, the state and live values are set. Without ROS.

It serves the stepping thread, which decides when to step and how far. What changes in the simulation becomes an event
in one way, whoever changes it: the output listens to the simulation, as a recorder in a script does.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from mbd_sim.base.errors import CommandError, DivergedError, listed
from mbd_sim.files.checks.bare_angles import TURN
from mbd_sim.ros.commands.command_buffer import CommandBuffer
from mbd_sim.ros.commands.joint_commands import CommandRanges
from mbd_sim.ros.commands.wrenches import WrenchBuffer
from mbd_sim.ros.stepping.output import SteppingOutput
from mbd_sim.simulation.model.live_values import PreparedValues
from mbd_sim.simulation.run.advice import OPEN_ACCOUNT, TOLERATED, open_share
from mbd_sim.simulation.run.changes import StateValues
from mbd_sim.simulation.run.events import EventKind
from mbd_sim.simulation.run.simulation import BaseSimulation

AUDIT_PERIOD = 1.0  # simulated s between looks at the energy account


class SteppedRun:
    """A simulation with its commands, its clock, and the output that says what has happened.

    `problem` is the last one that stopped the run, `advice` the last one on the step size; both "" without.
    `start_values` are those to which a reset returns; None: the start of the file.
    """

    def __init__(
        self,
        simulation: BaseSimulation,
        commands: CommandBuffer,
        wrenches: WrenchBuffer,
        start_values: StateValues | None = None,
        *,
        silent: bool = False,
    ) -> None:
        """A run at its start; `silent` is described in `SteppingOutput`."""
        self.simulation, self.commands, self.wrenches = simulation, commands, wrenches
        self.output = SteppingOutput(simulation, silent=silent)
        simulation.listen(self.output)
        self.clock = self.output.journal.clock
        self.start_values = start_values
        self._forget_problems()
        self._next_audit = 0  # the tick

    def advance(self, steps: int) -> None:
        """Apply commands and take steps.

        :raises DivergedError: the motion has diverged; `report_divergence` reports it.
        """
        self._apply_commands(self.clock.ticks * self.simulation.step_size)
        began = time.perf_counter()
        self.simulation.step(steps)
        self._check_accuracy()
        self.output.counters.stepping += time.perf_counter() - began

    def steps_to_command(self, at_most: int) -> int:
        """The steps to the next sample of a trajectory or wrench of a pull, or fewer."""
        steps = self.commands.steps_to_sample(self.clock.ticks, at_most)
        return self.wrenches.steps_to_pull(self.simulation.step_size, steps)

    def _apply_commands(self, now: float) -> None:
        """Apply what is due at a time in s of the run, by which commands expire."""
        simulation = self.simulation
        for due in self.commands.due(now):
            due.apply(simulation)
        current = simulation.inputs[simulation.command_map.range]
        if (values := self.commands.due_for_actuators(now, current)) is not None:
            simulation.apply_command_values(values)
        if expired := self.commands.take_expired_actuators():
            text = f"no more commands for {listed(expired)}: only positions are held"
            self.output.report(EventKind.WARNING, f"{text} (actuator_timeout, command_timeout)")
        for wrench in self.wrenches.due(now):
            wrench.apply(simulation)

    def report_divergence(self, error: DivergedError) -> None:
        """Report that the motion has diverged."""
        self.problem = self.output.report(EventKind.DIVERGED, str(error)).text

    def report_failure(self, error: Exception) -> None:
        """Report an error of the program, which pauses the run."""
        self.problem = self.output.report(EventKind.FAILED, repr(error)).text

    def reset(self, rewind_clock: bool, state: bool) -> str:
        """Reset the state to the start state, the clock to zero, or both; returns the problem, or ""."""
        zero_ns = self.clock.zero_ns
        if rewind_clock:
            self.clock.set(0)
        if not state:
            self.output.report(EventKind.CLOCK_RESET)
            return ""
        try:
            self.simulation.reset(*(self.start_values or ()))
        except ValueError as error:
            self.clock.zero_ns = zero_ns
            return f"the start state cannot be reached with the current live values: {error}"
        self._forget_problems()
        self.commands.clear()
        self.wrenches.clear()
        return ""

    def set_state(self, given: StateValues | Callable[[], StateValues], *, told: bool = True) -> str:
        """Set positions and speeds by name, given as such or by a function; returns the problem, or "".

        :param told: whether a note says what was set, besides the event of the new state.
        """
        try:
            given = given() if callable(given) else given
            self.simulation.set_state(*given)
        except CommandError as error:
            return str(error)
        self._forget_problems()
        if not told:
            return ""
        self.output.report(EventKind.NOTE, f"state set: {given}")
        positions, _ = given
        for name, value in positions.items():
            if abs(value) > TURN and self.simulation.mechanism.coordinate(name).rotation:
                text = f"{name} = {value:g} is in rad ({math.degrees(value):.4g}°), as all angles in messages are"
                self.output.report(EventKind.NOTE, text)
        return ""

    def live_change(self, prepared: PreparedValues) -> Callable[[], str]:
        """What changes live values, and the ranges of commands with them; it returns the problem, or "".

        It may be prepared in any thread.
        """
        ranges = CommandRanges(prepared.mechanism)
        return lambda: self._apply_live(prepared, ranges)

    def _apply_live(self, prepared: PreparedValues, ranges: CommandRanges) -> str:
        try:
            self.simulation.apply_live(prepared)
        except CommandError as error:
            return str(error)
        self.commands.keep_within(ranges, prepared.mechanism.bases)
        return ""

    def _forget_problems(self) -> None:
        self.problem = self.advice = ""
        self._error_threshold, self._share_threshold = TOLERATED, OPEN_ACCOUNT
        self._said_passing = self._checked_pressing = False

    def _check_accuracy(self) -> None:
        """Warn once of a step that is too large or an open energy account, and again when it has grown tenfold.

        Warn once of contacts that a step may miss, or in which they press too little.

        The account is left alone where the estimated error of a step says why it is open.
        """
        simulation, grown = self.simulation, False
        if (estimate := simulation.error_estimate) > self._error_threshold:
            self._error_threshold, grown = 10.0 * estimate, True
        elif estimate <= TOLERATED and self.clock.ticks >= self._next_audit:
            self._next_audit = self.clock.ticks + round(AUDIT_PERIOD / simulation.step_size)
            energies, start_energy = simulation.energies, simulation.start_energy
            share = open_share(simulation.model, energies, start_energy, simulation.step_size)
            if share > self._share_threshold:
                self._share_threshold, grown = 10.0 * share, True
            if not self._said_passing and simulation.passing_advice:
                self._said_passing = grown = True
            if not self._checked_pressing:
                self._checked_pressing = True
                grown = grown or simulation.pressing_advice is not None
        if grown:
            self.advice = simulation.step_advice or ""
            self.output.report(EventKind.WARNING, self.advice)
