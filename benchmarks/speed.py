"""What things cost on this machine: importing, setting up, stepping. Medians of several runs; nothing is asserted."""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

ROUNDS = 7
HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))


def median(measure: Callable[[], float]) -> float:
    """The median of several runs of `measure`, in s."""
    return statistics.median(measure() for _ in range(ROUNDS))


def in_new_process(code: str) -> float:
    """The seconds that a fresh interpreter prints."""
    printed = subprocess.run([sys.executable, "-c", code], cwd=HERE, check=True, capture_output=True, text=True).stdout
    return float(printed)


def timed(statement: str, before: str = "pass") -> str:
    """Code that prints how long a statement takes."""
    return f"{before}\nimport time; t = time.perf_counter()\n{statement}\nprint(time.perf_counter() - t)"


def first_joint_state() -> float:
    """From starting `sim_node` to its first joint state in another process, in s."""
    return in_new_process(
        "import os, subprocess, sys, time\n"
        "os.environ |= {'ROS_DOMAIN_ID': '97', 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}\n"
        "import rclpy; from sensor_msgs.msg import JointState\n"
        "rclpy.init(); node = rclpy.create_node('waits'); heard = []\n"
        "node.create_subscription(JointState, 'joint_states', heard.append, 10)\n"
        "t = time.perf_counter()\n"
        "command = [sys.executable, '-m', 'mbd_sim.ros.sim_node', '--ros-args', '-p', 'record:=false']\n"
        "child = subprocess.Popen(command, stderr=subprocess.DEVNULL)\n"
        "while not heard: rclpy.spin_once(node, timeout_sec=0.01)\n"
        "print(time.perf_counter() - t); child.terminate(); child.wait()\n"
    )


def stepping(count: int, method: str) -> tuple[float, float, float]:
    """µs per step inside the kernel and per `step(1)` from Python, and the energy residual in J after 10 s."""
    from chains import rods

    from mbd_sim import Simulation

    sim = Simulation.from_text(rods(count), method=method)
    steps = max(2000, 200_000 // count**2)
    sim.step(10_000)
    residual = sim.energies.residual

    def many() -> float:
        sim.reset()
        began = time.perf_counter()
        sim.step(steps)
        return (time.perf_counter() - began) / steps

    def single() -> float:
        sim.reset()
        step = sim.step
        began = time.perf_counter()
        for _ in range(steps):
            step(1)
        return (time.perf_counter() - began) / steps

    return median(many) * 1e6, median(single) * 1e6, residual


def main() -> None:
    """Print the tables."""
    setup = "from mbd_sim import Simulation; from chains import rods"
    rows = [
        ("import mbd_sim", median(lambda: in_new_process(timed("import mbd_sim")))),
        ("from mbd_sim import Simulation", median(lambda: in_new_process(timed("from mbd_sim import Simulation")))),
        *(
            (
                f"{count} rods: YAML to first step",
                median(lambda count=count: in_new_process(timed(f"Simulation.from_text(rods({count})).step()", setup))),
            )
            for count in (2, 7, 30)
        ),
        ("double_rod by name to first step", median(
            lambda: in_new_process(timed("Simulation.from_file('double_rod').step()", "from mbd_sim import Simulation"))
        )),
        ("sim_node to first joint state", median(first_joint_state)),
    ]  # fmt: skip
    print(f"{'':36s} {'s':>8s}")
    for name, seconds in rows:
        print(f"{name:36s} {seconds:8.3f}")
    print(f"\n{'µs':10s} {'method':8s} {'in kernel':>10s} {'step(1)':>10s} {'residual J, 10 s':>18s}")
    for count in (1, 2, 7, 30):
        for method in ("rk4", "dop853"):
            inside, single, residual = stepping(count, method)
            print(f"{f'{count} rods':10s} {method:8s} {inside:10.3f} {single:10.3f} {residual:18.1e}")


if __name__ == "__main__":
    main()
