"""Latency from a torque on a topic to the first state that it affects, at 1 kHz stepping and publishing.

Torques are sent at random times; each is timed until a joint state arrives here with that effort.

    python -m benchmarks.latency --seconds 60
"""

from __future__ import annotations

import argparse
import random
import struct
import time

import numpy as np
from std_msgs.msg import Float64MultiArray

from benchmarks.node_process import Measured, load, percentiles, running


def main() -> None:
    """Run the node, send torques, and print the distribution of the latency."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("parameters", nargs="*", help="parameters of the node, name:=value")
    options = parser.parse_args()
    with running(["command_timeout:=0.0", *options.parameters], domain=97) as node:
        print(f"torque -> state    {percentiles(latencies(node, options.seconds))}")
    print(load())


def latencies(node: Measured, seconds: float) -> np.ndarray:
    """Seconds from publishing a torque to the arrival of the first state with it, at about 100 torques per second."""
    commands = node.node.create_publisher(Float64MultiArray, "/sim_node/commands", 10)
    while not commands.get_subscription_count():
        time.sleep(0.05)
    found = []
    until = time.perf_counter() + seconds
    number = 0
    while time.perf_counter() < until:
        number += 1
        torque = 1e-3 * (1.0 + number % 7) + 1e-9 * number
        seen = len(node.arrivals)
        sent = time.perf_counter()
        commands.publish(Float64MultiArray(data=[torque, 0.0]))
        mark = struct.pack("<d", torque)
        while time.perf_counter() - sent < 1.0 and mark not in node.last:
            time.sleep(2e-4)
        # `last` may be a state or two later: find the first state with the torque.
        kept = len(node.payloads)
        first = next((i for i in range(seen, len(node.arrivals)) if mark in node.payloads[i % kept]), None)
        if first is not None:
            found.append(node.arrivals[first] - sent)
        time.sleep(random.uniform(0.005, 0.010))
    return np.array(found)


if __name__ == "__main__":
    main()
