"""Start-up time of `mbd_sim`: importing it, and starting its node. Medians over several new processes."""

from __future__ import annotations

import statistics
import subprocess
import sys
from pathlib import Path

ROUNDS = 7
FIRST_JOINT_STATE = """
import os, subprocess, sys, time
os.environ |= {'ROS_DOMAIN_ID': '97', 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
import rclpy
from sensor_msgs.msg import JointState
rclpy.init()
node, received = rclpy.create_node('waits'), []
node.create_subscription(JointState, 'joint_states', received.append, 10)
began = time.perf_counter()
command = [sys.executable, '-m', 'mbd_sim.ros.sim_node', '--ros-args', '-p', 'record:=false']
child = subprocess.Popen(command, stderr=subprocess.DEVNULL)
while not received:
    rclpy.spin_once(node, timeout_sec=0.01)
print(time.perf_counter() - began)
child.terminate()
child.wait()
"""


def timed(statement: str, before: str = "pass") -> str:
    """Code that prints how long a statement takes."""
    return f"{before}\nimport time; t = time.perf_counter()\n{statement}\nprint(time.perf_counter() - t)"


def median(code: str) -> float:
    """The median of the seconds that fresh interpreters print."""
    here = Path(__file__).resolve().parent.parent

    def seconds() -> float:
        command = [sys.executable, "-c", code]
        return float(subprocess.run(command, cwd=here, check=True, capture_output=True, text=True).stdout)

    return statistics.median(seconds() for _ in range(ROUNDS))


def main() -> None:
    """Print the times."""
    first_step = timed("Simulation.from_file('double_rod').step()", "from mbd_sim import Simulation")
    for name, code in (
        ("import mbd_sim", timed("import mbd_sim")),
        ("from mbd_sim import Simulation", timed("from mbd_sim import Simulation")),
        ("double_rod by name to first step", first_step),
        ("sim_node to first joint state", FIRST_JOINT_STATE),
    ):
        print(f"{name:36s} {median(code):8.3f} s")


if __name__ == "__main__":
    main()
