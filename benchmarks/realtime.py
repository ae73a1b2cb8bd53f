"""`sim_node` at 1 kHz in real time: steps lost, lateness, CPU and memory over a minute. Nothing is asserted."""

from __future__ import annotations

import argparse
import itertools
import os
import subprocess
import sys
import time

import psutil
import rclpy
from sensor_msgs.msg import JointState


def main() -> None:
    """Run the node, listen from this process, and print what happened."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("parameters", nargs="*", help="parameters of the node, name:=value")
    options = parser.parse_args()
    os.environ |= {"ROS_DOMAIN_ID": "96", "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    rclpy.init()
    node = rclpy.create_node("measures")
    stamps: list[tuple[float, int]] = []

    def heard(message: JointState) -> None:
        stamps.append((time.perf_counter(), message.header.stamp.sec * 10**9 + message.header.stamp.nanosec))

    node.create_subscription(JointState, "joint_states", heard, 1000)
    command = [sys.executable, "-m", "mbd_sim.ros.sim_node", "--ros-args", "-p", "record_dir:=/tmp/mbd_sim_benchmark"]
    for parameter in options.parameters:
        command += ["-p", parameter]
    child = subprocess.Popen(command)
    process = psutil.Process(child.pid)
    while len(stamps) < 100:
        rclpy.spin_once(node, timeout_sec=0.1)
    began, cpu, memory = time.perf_counter(), process.cpu_times(), process.memory_info().rss
    first = stamps[-1]
    memories = []
    while time.perf_counter() - began < options.seconds:
        rclpy.spin_once(node, timeout_sec=0.1)
        if len(stamps) % 500 == 0:
            memories.append(process.memory_info().rss)
    last, used = stamps[-1], process.cpu_times()
    wall, simulated = last[0] - first[0], (last[1] - first[1]) * 1e-9
    gaps = {b[1] - a[1] for a, b in itertools.pairwise(stamps)}
    seconds = time.perf_counter() - began
    print(f"real-time factor    {simulated / wall:.5f} over {wall:.1f} s")
    print(f"lost                {(wall - simulated) * 1e3:+.2f} ms of simulated time; gaps between stamps {gaps} ns")
    print(f"CPU                 {100 * (used.user + used.system - cpu.user - cpu.system) / seconds:.1f} % of one core")
    print(f"memory              {memory / 1e6:.1f} MB at first, {memories[-1] / 1e6:.1f} MB at last")
    child.terminate()
    child.wait()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
