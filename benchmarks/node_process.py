"""`sim_node` in a separate process, observed over its topics; shared by the benchmarks of the node."""

from __future__ import annotations

import contextlib
import os
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence

import numpy as np
import psutil
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.experimental import EventsExecutor
from sensor_msgs.msg import JointState

FOLDER = "/tmp/mbd_sim_benchmark"


class Measured:
    """A running node at 1 kHz: its process, arrival times and stamps of its joint states, and its diagnostics."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self.process = psutil.Process(process.pid)
        self.node = rclpy.create_node("measures")
        self.arrivals: list[float] = []
        self.stamps: list[int] = []
        self.payloads: list[bytes] = [b""] * 4096  # the newest ones, by number
        self.last = b""
        self.diagnostics: dict[str, str] = {}
        # Raw, because deserializing a message would cost more than the node spends on building it.
        self.node.create_subscription(JointState, "joint_states", self._on_joint_states, 1000, raw=True)
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)
        self.executor = EventsExecutor()
        self.executor.add_node(self.node)
        self._ending = False
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop receiving."""
        self._ending = True
        self._thread.join()

    def wait(self, messages: int = 500) -> None:
        """Wait until a number of states have arrived, so that start-up is over."""
        while len(self.stamps) < messages:
            time.sleep(0.05)

    def _spin(self) -> None:
        while not self._ending:
            self.executor.spin_once(timeout_sec=0.1)

    def _on_joint_states(self, payload: bytes) -> None:
        self.arrivals.append(time.perf_counter())
        seconds, nanoseconds = struct.unpack_from("<iI", payload, 4)
        self.stamps.append(seconds * 10**9 + nanoseconds)
        self.payloads[(len(self.stamps) - 1) % len(self.payloads)] = self.last = payload

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.diagnostics |= {value.key: value.value for value in status.values}


@contextlib.contextmanager
def running(parameters: Sequence[str] = (), domain: int = 96) -> Iterator[Measured]:
    """A node that publishes every step of 1 ms, observed from this process; `parameters` are `name:=value`."""
    os.environ |= {"ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    rclpy.init(args=[])
    command = [sys.executable, "-m", "mbd_sim.ros.node.sim_node", "--ros-args"]
    for parameter in ("publish_rate:=1000.0", f"record_dir:={FOLDER}", *parameters):
        command += ["-p", parameter]
    child = subprocess.Popen(command)
    measured = Measured(child)
    try:
        measured.wait()
        yield measured
    finally:
        child.terminate()
        child.wait()
        measured.close()
        rclpy.shutdown()


def percentiles(values: Sequence[float] | np.ndarray) -> str:
    """Median, 99 %, 99.9 % and maximum of durations in s, as text in ms."""
    ms = 1e3 * np.asarray(values)
    p50, p99, p999 = np.percentile(ms, [50.0, 99.0, 99.9])
    return f"p50 {p50:.3f}  p99 {p99:.3f}  p99.9 {p999:.3f}  max {ms.max():.3f} ms"


def load() -> str:
    """The load of the machine over the last minute."""
    return f"load of the machine over the last minute {os.getloadavg()[0]:.2f} on {os.cpu_count()} cores"
