"""Nodes that record are killed at random moments: whether each file can be opened and verified, and how much is lost.

The loss is the age, at the kill, of the oldest joint state that is in no file. It contains the time for which a loaded
machine did not run the node. Every second node splits its recording, as often as it may.

    python -m benchmarks.kills --runs 100 --load 4
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import random
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from mcap.reader import make_reader
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rosbags.highlevel import AnyReader
from sensor_msgs.msg import JointState

from benchmarks.node_process import load
from mbd_sim.cli.runs.verify import verify_text
from mbd_sim.recordings.run.recovery import recover, recover_bag
from mbd_sim.recordings.run.verification import verify
from test.shared_builds import share_builds
from test.system.nodes import SimNodeProcess

SPLITS = [
    {}, {"record_split_duration": 0.15}, {}, {"record_split_size": 0.01}, {"record_split_duration": 1.0},
]  # fmt: skip
LONGEST_LIFE = 4.0  # s after the first file has appeared
ENVELOPE = 1000  # states from whose arrivals the clock of the node is derived
FIRST_DOMAIN, DOMAINS = 60, 30
_kept: list[Any] = []  # of finished runs: rclpy 7.1.6 crashes when an executor of events is collected


@dataclass
class Killed:
    """A killed node: its parameters, its folder, the life of its recording, and the results."""

    parameters: dict[str, Any]
    folder: Path
    life: float
    stamps: list[int] = field(default_factory=list)  # of the joint states that arrived, in ns
    arrivals: list[int] = field(default_factory=list)  # of the monotonic clock, in ns
    killed_ns: int = 0
    files: int = 0
    loss: float = 0.0  # s
    problems: list[str] = field(default_factory=list)

    @property
    def label(self) -> str:
        """The parameters that differ."""
        splits = [
            f"{name.removeprefix('record_')} {value}" for name, value in self.parameters.items() if "split" in name
        ]
        return f"{self.parameters['record_format']} {self.parameters['publish_rate']:g} Hz {' '.join(splits)}"


def main() -> None:
    """Kill the nodes, then check their recordings, and print the losses."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--at-once", type=int, default=3, help="nodes that run at once")
    parser.add_argument("--load", type=int, default=0, help="busy processes besides the nodes")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    share_builds()  # the same mechanism is recomputed for each file
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    chance = random.Random(options.seed)
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(options.load)]
    with tempfile.TemporaryDirectory() as folder:
        runs = [planned(number, Path(folder) / f"run_{number}", chance) for number in range(options.runs)]
        try:
            runs, loads = kill_all(runs, options.at_once)
        finally:
            for process in busy:
                process.kill()
                process.wait()
        for run in runs:
            check(run)
            print(f"{run.label:45s} lived {run.life:4.2f} s, {run.files:3d} files, lost {run.loss:5.3f} s", flush=True)
            for problem in run.problems:
                print(f"    {problem}", flush=True)
    losses = [run.loss for run in runs]
    p50, p95 = np.percentile(losses, [50.0, 95.0])
    print(f"lost                p50 {p50:.3f} s, p95 {p95:.3f} s, max {max(losses):.3f} s")
    for name in ("record_split", "rosbag2"):
        chosen = [run.loss for run in runs if name in repr(run.parameters)]
        print(f"  with {name:14s} p50 {np.median(chosen):.3f} s, max {max(chosen):.3f} s in {len(chosen)} runs")
    print(f"files               {sum(run.files for run in runs)}")
    print(f"runs with problems  {sum(bool(run.problems) for run in runs)} of {len(runs)}")
    print(f"load of the machine over the last minute, at each kill: {min(loads):.1f} to {max(loads):.1f}; now {load()}")


def planned(number: int, folder: Path, chance: random.Random) -> Killed:
    """A run with random parameters."""
    folder.mkdir()
    parameters = {
        "record": True, "record_dir": ".", "real_time_priority": 0, "record_format": ("mcap", "rosbag2")[number % 2],
        "publish_rate": chance.choice([100.0, 1000.0, 1000.0]), **SPLITS[number % len(SPLITS)],
    }  # fmt: skip
    return Killed(parameters, folder, chance.uniform(0.0, LONGEST_LIFE))


def kill_all(runs: list[Killed], at_once: int) -> tuple[list[Killed], list[float]]:
    """Run and kill the nodes, some at once; return them, and the load of the machine at each kill."""
    with multiprocessing.get_context("spawn").Pool(at_once) as pool:
        results = pool.map(kill_one, runs, chunksize=1)
    return [run for run, _ in results], [number for _, number in results]


def kill_one(run: Killed) -> tuple[Killed, float]:
    """Run a node until some time after its first file has appeared, and kill it; return the load as well."""
    domain = FIRST_DOMAIN + os.getpid() % DOMAINS
    context = Context()
    rclpy.init(context=context, domain_id=domain)
    node = Node("counts", context=context)

    def on_state(payload: bytes) -> None:
        run.arrivals.append(time.monotonic_ns())
        seconds, nanoseconds = struct.unpack_from("<iI", payload, 4)
        run.stamps.append(seconds * 10**9 + nanoseconds)

    namespace = f"/{run.folder.name}"  # unique: another node may use the same domain
    node.create_subscription(JointState, f"{namespace}/joint_states", on_state, 1000, raw=True)
    executor = EventsExecutor(context=context)
    executor.add_node(node)
    ended = threading.Event()

    def spin() -> None:
        while not ended.is_set():
            executor.spin_once(timeout_sec=0.1)

    spinning = threading.Thread(target=spin)
    spinning.start()
    process = SimNodeProcess(domain, run.folder, run.parameters, [f"__ns:={namespace}"])
    while not any(run.folder.rglob("*.mcap")):
        time.sleep(1e-3)
    time.sleep(run.life)
    run.killed_ns = time.monotonic_ns()
    process.process.send_signal(signal.SIGKILL)
    process.process.wait()
    ended.set()
    spinning.join()
    _kept.append((context, node, executor))
    return run, os.getloadavg()[0]


def check(run: Killed) -> None:
    """Recover the recording, open all files with other readers, verify them, and compute the loss."""
    paths = sorted(run.folder.rglob("*.mcap"))
    run.files = len(paths)
    last_ns = -1
    for path in paths:
        try:
            recover(path)
        except Exception as error:
            run.problems.append(f"{path.name}: recover: {error!r} ({path.stat().st_size} bytes)")
    if any(run.folder.glob("*/*.mcap")):
        try:
            list(recover_bag(paths[0].parent))
            with AnyReader([paths[0].parent]) as bag:
                sum(1 for _ in bag.messages())
        except Exception as error:
            run.problems.append(f"folder: {error!r}")
    for path in paths:
        try:
            with path.open("rb") as stream:
                for _, channel, message in make_reader(stream, validate_crcs=True).iter_messages():
                    if channel.topic.endswith("/joint_states"):
                        last_ns = max(last_ns, message.log_time)
            with AnyReader([path]) as reader:
                sum(1 for _ in reader.messages())
        except Exception as error:
            run.problems.append(f"{path.name}: other readers: {error!r}")
        try:
            if not all(found.agrees for found in verify(path)):
                run.problems += [verify_text(found) for found in verify(path)]
        except Exception as error:
            run.problems.append(f"{path.name}: verify: {error!r}")
    lost = [n for n, stamp in enumerate(run.stamps) if stamp > last_ns]
    if lost:
        # The node's clock at the kill, from the states that were least delayed on their way here.
        offset = min(
            arrival - stamp for arrival, stamp in zip(run.arrivals[-ENVELOPE:], run.stamps[-ENVELOPE:], strict=True)
        )
        run.loss = max(0.0, (run.killed_ns - offset - run.stamps[lost[0]]) * 1e-9)


if __name__ == "__main__":
    main()
