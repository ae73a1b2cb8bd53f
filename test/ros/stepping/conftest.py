"""A stepping thread without ROS, which is stopped at the end of a test."""

import pytest

from mbd_sim import Simulation
from mbd_sim.ros.commands.command_buffer import CommandBuffer
from mbd_sim.ros.stepping.clock import Rates
from mbd_sim.ros.stepping.thread import SteppingThread


@pytest.fixture
def make():
    stepping_threads = []

    def build(step=None, *, wrenches=(), live=(), **rates):
        paused, followed = rates.pop("paused", False), rates.pop("followed", None)
        simulation = Simulation.from_file("rod_pendulum", method="rk4", step=step, wrenches=wrenches, live=live)
        stepping_thread = SteppingThread(
            simulation, CommandBuffer(simulation.effort_map, 0.0), Rates(**rates), paused=paused, followed=followed
        )
        stepping_threads.append(stepping_thread)
        return stepping_thread

    yield build
    for stepping_thread in stepping_threads:
        if stepping_thread._thread.is_alive():
            stepping_thread.stop()
