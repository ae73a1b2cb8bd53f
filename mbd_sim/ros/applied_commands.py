"""Efforts, commands of actuators and wrenches that take effect between two steps, and the events that say so."""

from __future__ import annotations

from mbd_sim.errors import listed
from mbd_sim.ros.command_buffer import CommandBuffer
from mbd_sim.ros.stepping_output import SteppingOutput
from mbd_sim.ros.wrench_buffer import WrenchBuffer
from mbd_sim.simulation.events import AppliedCommands, AppliedEfforts, AppliedWrench, EventKind
from mbd_sim.simulation.simulation import Simulation


def apply_commands(
    simulation: Simulation, commands: CommandBuffer, wrenches: WrenchBuffer, time: float, output: SteppingOutput
) -> None:
    """Apply what is due; report expired commands, and those that change a bit of the inputs of the equations.

    A command that repeats the inputs has no effect, so that a recording without it is recomputed bit for bit.

    :param time: simulated s by which commands expire.
    """
    for due in commands.due(time):
        before = simulation.efforts.tobytes()
        simulation.set_efforts(due.efforts)
        if due.kind is EventKind.EXPIRED or simulation.efforts.tobytes() != before:
            output.report(due.kind, AppliedEfforts(due.efforts, due.expired))
    current = simulation.inputs[simulation.command_map.range]
    values = commands.due_for_actuators(time, current)
    if values is not None and values.tobytes() != current.tobytes():
        simulation.apply_command_values(values)
        output.report(EventKind.COMMAND, AppliedCommands(values))
    if expired := commands.take_expired_actuators():
        text = f"no more commands for {listed(expired)}: only positions are held (actuator_timeout, command_timeout)"
        output.report(EventKind.WARNING, text)
    for due_wrench in wrenches.due(time):
        part = due_wrench.wrench.part
        inputs = simulation.inputs[wrenches.input_range(part)]
        before = inputs.tobytes()
        due_wrench.wrench.apply(simulation)
        if due_wrench.kind is EventKind.EXPIRED or inputs.tobytes() != before:
            output.report(due_wrench.kind, AppliedWrench(part, inputs.copy()))
