"""A run in steps: what it says about them."""

from mbd_sim import Simulation
from mbd_sim.ros.commands.command_buffer import CommandBuffer
from mbd_sim.ros.commands.wrenches import WrenchBuffer
from mbd_sim.ros.stepping.run import SteppedRun
from mbd_sim.simulation.run.events import Event, EventKind


def test_a_contact_that_steps_may_miss_is_reported_once_when_the_account_is_examined():
    """A rod that speeds up to turns of more than 0.5 rad per step, beside a plane that its tip does not reach."""
    simulation = Simulation.from_text(
        """
mechanism: fan
gravity: [0, 0, 0]
parts: {rod: {mass: 1, inertia: [1, 1, 1], points: {tip: [0.1, 0, 0]}}}
ground: {points: {floor: [0, 0, -1]}}
joints: {pin: {type: revolute, between: [ground, rod], axis: [0, 1, 0]}}
forces: {motor: {type: effort, coordinate: pin, effort: 400}}
constraints: {floor: {type: on_plane, point: rod.tip, plane: ground.floor, bound: at_least}}
"""
    )
    run = SteppedRun(
        simulation, CommandBuffer(simulation.effort_map, 0.0), WrenchBuffer(simulation.wrench_map, (), 0.0)
    )
    warned = []
    assert simulation.passing_advice is None
    for _ in range(5):
        run.advance(round(1.0 / simulation.step_size))
        items = [run.output.queue.get() for _ in range(run.output.queue.qsize())]
        warned.append(sum(isinstance(item, Event) and item.kind is EventKind.WARNING for item in items))
    assert sum(warned) == 1 and "parts at 'floor' turn by" in run.advice
