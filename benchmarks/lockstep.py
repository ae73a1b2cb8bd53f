"""Lockstep between two processes: calls per second and time per call, at 1, 10 and 100 steps per call.

`python -m benchmarks.lockstep [mechanism] [calls]`, in the environment of the tests. A command that triggers its steps,
until the resulting state has been read (`mbd_sim.ros.node.lockstep`); the service `~/step`, until its reply, without a
command or a state; each beside the same exchange with a node that computes nothing (`benchmarks/bare_echo.py`), which
bounds it. Ours and the bare ones alternate in rounds of 100 calls. Last, the same loop on a `Simulation` in one
process, without ROS.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
import rclpy
from rclpy.experimental import EventsExecutor
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger

from mbd_sim import Simulation
from mbd_sim.ros.node.lockstep import Lockstep

STEPS = (1, 10, 100)
ROUND = 100  # calls of one kind, before those of the next


class BareClient:
    """Calls the node of `bare_echo` as `Lockstep` calls a simulator."""

    def __init__(self, size: int) -> None:
        if not rclpy.ok():
            rclpy.init()
        self._node = rclpy.create_node("bare_client")
        self._executor, self._newest = EventsExecutor(), 0
        self._executor.add_node(self._node)
        self._publisher = self._node.create_publisher(Float64MultiArray, "bare/commands", 10)
        self._node.create_subscription(JointState, "bare/joint_states", self._on_state, 10)
        self._client = self._node.create_client(Trigger, "bare/step")
        self._data = [0.1] * size
        while not (self._publisher.get_subscription_count() and self._client.service_is_ready()):
            self._executor.spin_once(timeout_sec=0.05)
        time.sleep(0.5)  # until the node has found this subscription

    def _on_state(self, state: JointState) -> None:
        self._newest = state.header.stamp.sec

    def command(self) -> None:
        """Send a command and wait for the state."""
        last = self._newest
        self._publisher.publish(Float64MultiArray(data=self._data))
        while self._newest == last:
            self._executor.spin_once(timeout_sec=0.05)

    def service(self) -> None:
        """Call the service and wait for its reply."""
        future = self._client.call_async(Trigger.Request())
        while not future.done():
            self._executor.spin_once(timeout_sec=0.05)

    def close(self) -> None:
        """Disconnect."""
        self._executor.shutdown()
        self._node.destroy_node()


def measured(calls: Mapping[str, Callable[[], object]], count: int) -> dict[str, np.ndarray]:
    """Seconds of each call (count,) by name, in alternating rounds after 50 calls that do not count."""
    for call in calls.values():
        for _ in range(50):
            call()
    took: dict[str, list[float]] = {name: [] for name in calls}
    while any(len(times) < count for times in took.values()):
        for name, call in calls.items():
            for _ in range(ROUND):
                began = time.perf_counter()
                call()
                took[name].append(time.perf_counter() - began)
    return {name: np.array(times) for name, times in took.items()}


def row(name: str, steps: int | str, took: np.ndarray, bound: np.ndarray | None = None) -> str:
    """Calls per second, median and 99th percentile in µs, and the ratio of the median to that of the bound."""
    median, late = 1e6 * np.quantile(took, [0.5, 0.99])
    ratio = "" if bound is None else f"{np.median(took) / np.median(bound):.2f}"
    return f"| {name} | {steps} | {1.0 / np.mean(took):,.0f} | {median:,.1f} | {late:,.1f} | {ratio} |"


def started(*words: str) -> subprocess.Popen[bytes]:
    """A Python program in a process of its own."""
    return subprocess.Popen([sys.executable, "-m", *words], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def over_dds(mechanism: str, count: int) -> None:
    """Print the rows of the exchanges over DDS."""
    node = started("mbd_sim.ros.node.sim_node", "--ros-args", "-p", f"mechanism:={mechanism}", "-p", "record:=false")
    echo = started("benchmarks.bare_echo")
    try:
        for steps in STEPS:
            with Lockstep(steps=steps, timeout=30.0) as lockstep:
                efforts, bare = 0.1 * np.ones(len(lockstep.names)), BareClient(len(lockstep.names))
                calls: dict[str, Callable[[], Any]] = {
                    "command with steps": partial(lockstep.step, efforts),
                    "bare command and state": bare.command,
                    "`~/step`": partial(lockstep._call, Trigger, "step"),
                    "bare service": bare.service,
                }
                took = measured(calls, count)
                bare.close()
            for name, of in (("command with steps", "bare command and state"), ("`~/step`", "bare service")):
                print(row(name, steps, took[name], took[of]))
                print(row(of, "–", took[of]), flush=True)
    finally:
        for process in (node, echo):
            process.send_signal(signal.SIGINT)
            process.wait(20)


def main(mechanism: str = "double_pendulum", count: int = 2000) -> None:
    """Print the table."""
    print(f"{mechanism}, {count} calls each, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}\n")
    print("| variant | steps per call | calls/s | p50, µs | p99, µs | p50 ours/bare |\n|---|---|--:|--:|--:|--:|")
    over_dds(mechanism, count)
    for steps in STEPS:
        sim = Simulation.from_file(mechanism)
        efforts = 0.1 * np.ones(sim.u.size)

        def call(sim: Simulation = sim, efforts: np.ndarray = efforts, steps: int = steps) -> None:
            sim.set_efforts(efforts)
            sim.step(steps)

        print(row("without ROS", steps, measured({"": call}, count)[""]))


if __name__ == "__main__":
    main(*sys.argv[1:2], *(int(count) for count in sys.argv[2:3]))
