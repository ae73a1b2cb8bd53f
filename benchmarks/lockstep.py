"""Lockstep between two processes: calls per second and time per call, at 1, 10 and 100 steps per call.

`python benchmarks/lockstep.py [mechanism] [calls]`, in the environment of the tests. Three variants: a command that
triggers its steps, until the resulting state has been read (`mbd_sim.ros.lockstep`); the service `~/step`, until
its reply, without a command or a state; and the same loop on a `Simulation` in one process, without ROS.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial

import numpy as np
from std_srvs.srv import Trigger

from mbd_sim import Simulation
from mbd_sim.ros.lockstep import Lockstep

STEPS = (1, 10, 100)


def measured(call: Callable[[], object], calls: int) -> str:
    """Calls per second, median and 99th percentile in µs, as the cells of a table."""
    took = np.empty(calls)
    for _ in range(50):
        call()
    for index in range(calls):
        began = time.perf_counter()
        call()
        took[index] = time.perf_counter() - began
    median, late = 1e6 * np.quantile(took, [0.5, 0.99])
    return f"{1.0 / np.mean(took):,.0f} | {median:,.1f} | {late:,.1f}"


def main(mechanism: str = "double_pendulum", calls: int = 2000) -> None:
    """Print the table."""
    print(f"{mechanism}, {calls} calls each, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}\n")
    print("| variant | steps per call | calls/s | p50, µs | p99, µs |\n|---|---|---|---|---|")
    command = [sys.executable, "-m", "mbd_sim.ros.sim_node", "--ros-args", "-p", f"mechanism:={mechanism}"]
    node = subprocess.Popen([*command, "-p", "record:=false"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        for steps in STEPS:
            with Lockstep(steps=steps, timeout=30.0) as lockstep:
                efforts = 0.1 * np.ones(len(lockstep.names))
                by_command = measured(partial(lockstep.step, efforts), calls)
                by_service = measured(partial(lockstep._call, Trigger, "step"), calls)
                print(
                    f"| command with steps | {steps} | {by_command} |\n| `~/step` | {steps} | {by_service} |",
                    flush=True,
                )
    finally:
        node.send_signal(signal.SIGINT)
        node.wait(20)
    for steps in STEPS:
        sim = Simulation.from_file(mechanism)
        efforts = 0.1 * np.ones(sim.u.size)

        def call(sim: Simulation = sim, efforts: np.ndarray = efforts, steps: int = steps) -> None:
            sim.set_efforts(efforts)
            sim.step(steps)

        print(f"| without ROS | {steps} | {measured(call, calls)} |")


if __name__ == "__main__":
    main(*sys.argv[1:2], *(int(count) for count in sys.argv[2:3]))
