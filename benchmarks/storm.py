"""A storm of bad commands at a node that runs at 1 kHz: is the motion untouched, and the period kept? Asserts nothing.

Quiet first, then as long with thousands of bad messages a second: wrong length, NaN, unknown names.

    python -m benchmarks.storm --seconds 60
"""

from __future__ import annotations

import argparse
import itertools
import math
import multiprocessing
import os
import struct
import time

import numpy as np
import rclpy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from benchmarks.node_process import Measured, load, percentiles, running
from mbd_sim import Simulation
from mbd_sim.load import load_mechanism

RATE = 5000  # messages a second


def main() -> None:
    """Run the node quietly and in the storm, and print both."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    options = parser.parse_args()
    with running(["wrenches:=''", "live:=''"], domain=98) as node:
        quiet = phase(node, options.seconds)
        print(f"quiet   {quiet}")
        storm = multiprocessing.get_context("spawn").Process(target=send, args=(options.seconds + 3.0,))
        storm.start()
        before = int(node.diagnostics.get("rejected", "0"))
        while int(node.diagnostics.get("rejected", "0")) < before + RATE // 2:
            time.sleep(0.1)
        print(f"storm   {phase(node, options.seconds)}")
        storm.join()
        time.sleep(1.5)
        told = dict(node.diagnostics)
        print(f"rejected {told['rejected']}, accepted {told['accepted']}, overruns {told['overruns']}")
        print(
            f"motion  {'untouched, bit for bit' if untouched(node) else 'CHANGED'} after {node.stamps[-1] / 1e9:.3f} s"
        )
    print(load())


def phase(node: Measured, seconds: float) -> str:
    """The periods of the arrivals here, and of stepping as the node tells second by second, over some seconds."""
    first, began, periods = len(node.arrivals), time.perf_counter(), []
    while time.perf_counter() - began < seconds:
        time.sleep(1.0)
        periods.append(float(node.diagnostics.get("period p99 (us)", "nan")))
    arrivals = np.diff(node.arrivals[first:])
    usual, most = np.nanmedian(periods), np.nanmax(periods)
    return f"arrivals {percentiles(arrivals)}; stepping: p99 of a second {usual:.0f} µs, {most:.0f} at most"


def untouched(node: Measured) -> bool:
    """Whether the last state is that of the same run without any commands."""
    payload = node.last
    seconds, nanoseconds = struct.unpack_from("<iI", payload, 4)
    simulation = Simulation(load_mechanism("double_rod"))
    simulation.step(seconds * 1000 + nanoseconds // 1_000_000)
    return all(struct.pack("<d", value) in payload for value in (*simulation.q, *simulation.u))


def send(seconds: float) -> None:
    """Bad messages for some seconds, in bursts of a millisecond."""
    os.environ |= {"ROS_DOMAIN_ID": "98", "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    rclpy.init(args=[])
    node = rclpy.create_node("storm")
    by_order = node.create_publisher(Float64MultiArray, "/sim_node/commands", 10)
    by_name = node.create_publisher(JointState, "/joint_commands", 10)
    bad = itertools.cycle(
        [
            lambda: by_order.publish(Float64MultiArray(data=[1.0])),
            lambda: by_order.publish(Float64MultiArray(data=[math.nan, 1.0])),
            lambda: by_name.publish(JointState(name=["elbw"], effort=[5.0])),
            lambda: by_name.publish(JointState(name=["elbow"], effort=[math.inf])),
            lambda: by_order.publish(Float64MultiArray(data=[1.0] * 50)),
        ]
    )
    while not (by_order.get_subscription_count() and by_name.get_subscription_count()):
        time.sleep(0.05)
    began = due = time.perf_counter()
    sent = 0
    while due - began < seconds:
        for _ in range(RATE // 1000):
            next(bad)()
            sent += 1
        due += 1e-3
        time.sleep(max(0.0, due - time.perf_counter()))
    print(f"sent    {sent} bad messages, {sent / (time.perf_counter() - began):.0f} a second")
    rclpy.shutdown()


if __name__ == "__main__":
    main()
