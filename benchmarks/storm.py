"""A storm of invalid commands at a node that runs at 1 kHz: the effect on motion and period.

First without commands, then with thousands of invalid messages per second: wrong length, NaN, unknown names.

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
from mbd_sim.files.load import load_mechanism

RATE = 5000  # messages per second


def main() -> None:
    """Run the node without and with the storm, and print both."""
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
        values = dict(node.diagnostics)
        print(f"rejected {values['rejected']}, accepted {values['accepted']}, overruns {values['overruns']}")
        print(
            f"motion  {'untouched, bit for bit' if untouched(node) else 'CHANGED'} after {node.stamps[-1] / 1e9:.3f} s"
        )
    print(load())


def phase(node: Measured, seconds: float) -> str:
    """The periods of the arrivals here, and of stepping as the diagnostics report them each second."""
    first, began, periods = len(node.arrivals), time.perf_counter(), []
    while time.perf_counter() - began < seconds:
        time.sleep(1.0)
        periods.append(float(node.diagnostics.get("period p99 (us)", "nan")))
    arrivals = np.diff(node.arrivals[first:])
    usual, most = np.nanmedian(periods), np.nanmax(periods)
    return f"arrivals {percentiles(arrivals)}; stepping: p99 within a second {usual:.0f} µs, at most {most:.0f} µs"


def untouched(node: Measured) -> bool:
    """Whether the last state is that of the same run without any commands."""
    payload = node.last
    seconds, nanoseconds = struct.unpack_from("<iI", payload, 4)
    simulation = Simulation(load_mechanism("double_rod"))
    simulation.step(seconds * 1000 + nanoseconds // 1_000_000)
    return all(struct.pack("<d", value) in payload for value in (*simulation.q, *simulation.u))


def send(seconds: float) -> None:
    """Send invalid messages for some seconds, in a burst every millisecond."""
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
    print(f"sent    {sent} bad messages, {sent / (time.perf_counter() - began):.0f} per second")
    rclpy.shutdown()


if __name__ == "__main__":
    main()
