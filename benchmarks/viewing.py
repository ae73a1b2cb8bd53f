"""The cost of Rerun for a node at 1 kHz: processor time and lateness of its stepping thread, without and with it.

python -m benchmarks.viewing --seconds 5 --turns 4
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from statistics import median
from typing import Any

CASES = {"none": 0.0, "60 Hz": 60.0, "1000 Hz": 1000.0}
SHOWN = {
    "cpu": "µs CPU per step",
    "stepping": "µs stepping",
    "p50": "late p50 µs",
    "p99": "late p99 µs",
    "period": "p99 µs",
}
DOMAIN = "87"


def main() -> None:
    """Run the cases in alternation, each in a separate process, and print the medians."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--turns", type=int, default=4)
    parser.add_argument("--case", choices=CASES, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.case:
        print(json.dumps(turn(CASES[options.case], options.seconds)), flush=True)
        os._exit(0)  # nothing to wait for: the node has been stopped
    environment = os.environ | {"ROS_DOMAIN_ID": DOMAIN, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    found: dict[str, list[dict[str, float]]] = {case: [] for case in CASES}
    for _ in range(options.turns):
        for case, rows in found.items():
            command = [sys.executable, "-m", "benchmarks.viewing", "--case", case, "--seconds", str(options.seconds)]
            done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, check=True)
            rows.append(json.loads(done.stdout.splitlines()[-1]))
    print("Rerun to a file  " + "  ".join(f"{name:>14s}" for name in SHOWN.values()) + "  dropped")
    for case, rows in found.items():
        values = "  ".join(f"{median(row[key] for row in rows):14.1f}" for key in SHOWN)
        print(f"{case:15s}  {values}  {max(row['dropped'] for row in rows):.0f}")


def turn(rate: float, seconds: float) -> dict[str, float]:
    """A node of two rods that steps and publishes at 1 kHz for some seconds, with Rerun if the rate is not 0."""
    import rclpy
    from rclpy.experimental import EventsExecutor

    from mbd_sim.ros.node.sim_node import SimNode
    from mbd_sim.ros.stepping import realtime

    with tempfile.TemporaryDirectory() as folder:
        arguments = ["--ros-args", "--log-level", "ERROR", "-p", "record:=false", "-p", "publish_rate:=1000.0"]
        if rate:
            arguments += ["-p", f"rerun:={Path(folder) / 'run.rrd'}", "-p", f"rerun_rate:={rate}"]
        rclpy.init(args=arguments)
        node, ended = SimNode(lambda: None), threading.Event()
        realtime.freeze_memory()
        executor = EventsExecutor()
        executor.add_node(node)

        def spin() -> None:
            while not ended.is_set():
                executor.spin_once(timeout_sec=0.1)

        threading.Thread(target=spin, name="executor", daemon=True).start()
        node.start()
        time.sleep(2.0)
        first = _counters(node)
        time.sleep(seconds)
        last = _counters(node)
        late, period = (
            getattr(node.stepping_thread.pacer, name).summary(first[name]) for name in ("lateness", "period")
        )
        viewer = node.publishing_thread.viewer
        node.stop()
        ended.set()
    steps = last["steps"] - first["steps"]
    return {
        "cpu": 1e6 * (last["cpu"] - first["cpu"]) / steps,
        "stepping": 1e6 * (last["stepping"] - first["stepping"]) / steps,
        "p50": 1e6 * late.median,
        "p99": 1e6 * late.p99,
        "period": 1e6 * period.p99,
        "dropped": viewer.dropped if viewer else 0,
    }


def _counters(node: Any) -> dict[str, Any]:
    runner = node.stepping_thread
    on_cpu = Path(f"/proc/self/task/{runner.thread_id}/schedstat").read_text().split()[0]
    return {
        "steps": runner.ticks,
        "cpu": int(on_cpu) * 1e-9,
        "stepping": runner.counters.stepping,
        "lateness": runner.pacer.lateness.counts().copy(),
        "period": runner.pacer.period.counts().copy(),
    }


if __name__ == "__main__":
    main()
