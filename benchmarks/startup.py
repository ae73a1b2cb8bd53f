"""Start-up times of `mbd_sim`, in new processes: to the first step, of `check`, of the node; warm and cold.

    python -m benchmarks.startup --robots FOLDER --beside OTHER_CHECKOUT

Warm processes find what they need in the cache, cold ones begin with an empty one. Each row has the medians of wall
time and of processor time, of the whole process and from its first line, that is, without the start of the interpreter.
Targets are for wall times from the first line, on a quiet machine with two processors, except for whole commands.

The humanoid is the Talos of the package example-robot-data, found below a folder with its URDF files.
"""

from __future__ import annotations

import argparse
import atexit
import functools
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import NamedTuple

if __package__ in (None, ""):  # as a program: python benchmarks/startup.py
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from benchmarks.mechanisms import rods

HERE = Path(__file__).resolve().parent.parent
HUMANOID = "talos_reduced.urdf"
INNER = "inner: "  # at the start of the line in which a process prints its own times
TIMED = """
import time as _time
_wall, _processor = _time.perf_counter(), _time.process_time()
{statement}
print({inner!r}, _time.perf_counter() - _wall, _time.process_time() - _processor)
"""
FIRST_STEP = "from mbd_sim import Simulation\nSimulation.from_file({file!r}).step()"
# Starts a node and waits for its first message; the times are those of the node's process.
FIRST_JOINT_STATE = """
import os, subprocess, sys, time
os.environ |= {{'ROS_DOMAIN_ID': '97', 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}}
import rclpy
from sensor_msgs.msg import JointState
rclpy.init()
node, received = rclpy.create_node('waits'), []
node.create_subscription(JointState, 'joint_states', received.append, 10)
began = time.perf_counter()
child = subprocess.Popen([sys.executable, *{arguments!r}], stderr=subprocess.DEVNULL)
while not received:
    rclpy.spin_once(node, timeout_sec=0.01)
wall = time.perf_counter() - began
with open(f'/proc/{{child.pid}}/stat') as file:
    ticks = sum(map(int, file.read().rpartition(')')[2].split()[11:13]))
print({inner!r}, wall, ticks / os.sysconf('SC_CLK_TCK'))
child.terminate()
child.wait()
"""
BARE_NODE = """
import time, rclpy
from sensor_msgs.msg import JointState
rclpy.init()
publisher = rclpy.create_node('bare').create_publisher(JointState, 'joint_states', 10)
while True:
    publisher.publish(JointState())
    time.sleep(0.001)
"""


class Times(NamedTuple):
    """Seconds of one start: of the whole process, and from its first line."""

    wall: float
    processor: float
    inner_wall: float
    inner_processor: float


@dataclass(frozen=True)
class Row:
    """A start: its `arguments` for Python, its target in s, and whether that is for the whole process."""

    name: str
    arguments: Sequence[str]
    target: float | None = None
    whole: bool = False
    cold: bool = False
    rounds: int | None = None  # fewer than the others
    least: bool = False  # the least of the rounds counts, not their median


def timed(statement: str) -> tuple[str, str]:
    """Arguments of an interpreter that runs a statement and prints its times."""
    return "-c", TIMED.format(statement=statement, inner=INNER)


def first_joint_state(*arguments: str) -> tuple[str, str]:
    """Arguments of an interpreter that starts a node and prints the times to its first message."""
    return "-c", FIRST_JOINT_STATE.format(arguments=arguments, inner=INNER)


def rows(folder: Path, robots: Path | None) -> list[Row]:
    """All starts; their mechanism files are written to a folder."""
    files = {}
    for count in (30, 100, 300):
        files[count] = str(folder / f"rods{count}.yaml")
        Path(files[count]).write_text(rods(count), encoding="utf-8")

    def first_step(file: str) -> tuple[str, str]:
        return timed(FIRST_STEP.format(file=file))

    node = ("-m", "mbd_sim.ros.node.sim_node", "--ros-args", "-p", "record:=false")
    check = ("-c", "from mbd_sim.programs import command; command.cli.main.main()", "check", "double_rod")
    found = [
        Row("interpreter", timed("pass")),
        Row("numpy", timed("import numpy")),
        Row("import mbd_sim", timed("import mbd_sim")),
        Row("from mbd_sim import Simulation", timed("from mbd_sim import Simulation")),
        Row("double_rod to its first step", first_step("double_rod"), 0.25),
        Row("double_rod to its first step, cold", first_step("double_rod"), cold=True),
        Row("mbd_sim check double_rod", check, 0.4, whole=True),
        Row("30 rods to the first step", first_step(files[30]), 0.4),
        Row("100 rods to the first step", first_step(files[100]), 1.0),
        Row("30 rods to the first step, cold", first_step(files[30]), cold=True, rounds=3),
        Row("100 rods to the first step, cold", first_step(files[100]), 3.0, cold=True, rounds=3),
        Row("300 rods to the first step, cold", first_step(files[300]), 10.0, cold=True, rounds=1),
    ]
    robot_files = [] if robots is None else sorted(robots.rglob(HUMANOID))
    if robots is not None and not robot_files:
        print(f"there is no {HUMANOID} below {robots}: the humanoid is left out", file=sys.stderr)
    if robot_files:
        humanoid = first_step(str(robot_files[0].resolve()))
        found += [
            Row("humanoid (URDF) to the first step", humanoid),
            Row("humanoid (URDF) to the first step, cold", humanoid, 3.0, cold=True, rounds=5),
        ]
    found += [
        Row("sim_node to its first joint state, least", first_joint_state(*node), 0.8, least=True),
        Row("rclpy alone to a first joint state, least", first_joint_state("-c", BARE_NODE), least=True),
    ]
    return found


@functools.cache
def compiled_sources() -> dict[str, str]:
    """Where starts find their modules as byte code, as an installed package has them.

    Without them, each start would compile all of its Python sources, for 0.3 s.
    """
    folder = tempfile.TemporaryDirectory()
    atexit.register(folder.cleanup)
    return {"PYTHONPYCACHEPREFIX": folder.name, "PYTHONDONTWRITEBYTECODE": ""}


def one_start(row: Row, checkout: Path, cache: Path) -> Times:
    """The times of one process with the package of a checkout."""
    environment = os.environ | {"PYTHONPATH": str(checkout), "MBD_SIM_CACHE": str(cache), **compiled_sources()}
    command = [sys.executable, *row.arguments]
    began = time.perf_counter()
    with subprocess.Popen(command, cwd=cache, env=environment, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        output = process.stdout.read()
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    wall, processor = time.perf_counter() - began, used.ru_utime + used.ru_stime
    if process.returncode:
        raise SystemExit(f"{row.name} failed with {checkout}: exit code {process.returncode}")
    inner = [line.removeprefix(INNER).split() for line in output.splitlines() if line.startswith(INNER)]
    return Times(wall, processor, *(map(float, inner[0]) if inner else (wall, processor)))


def measure(found: Sequence[Row], checkouts: Sequence[Path], rounds: int) -> dict[tuple[str, Path], Times]:
    """The medians of each row and checkout, of processes that alternate; of some rows, the least."""
    times: dict[tuple[str, Path], list[Times]] = {(row.name, path): [] for row in found for path in checkouts}
    with tempfile.TemporaryDirectory() as folder:
        warm = {path: Path(folder) / f"warm{number}" for number, path in enumerate(checkouts)}
        for path, cache in warm.items():
            cache.mkdir(mode=0o700)
            for row in found:
                if not row.cold:
                    one_start(row, path, cache)
        for index in range(rounds):
            for row in found:
                if index >= (row.rounds or rounds):
                    continue
                for path in checkouts:
                    with tempfile.TemporaryDirectory() as cold:
                        start = one_start(row, path, Path(cold) if row.cold else warm[path])
                    times[row.name, path].append(start)
    least = {row.name for row in found if row.least}
    return {
        key: Times(
            *(min(column) if key[0] in least else statistics.median(column) for column in zip(*starts, strict=True))
        )
        for key, starts in times.items()
    }


def table(found: Sequence[Row], checkouts: Sequence[Path], medians: Mapping[tuple[str, Path], Times]) -> str:
    """A Markdown table; rows of several checkouts follow each other."""
    lines = [
        "| wall / processor time, s | from the first line | whole process | target |",
        "|---|--:|--:|--:|",
    ]
    for row in found:
        for number, path in enumerate(checkouts):
            if (row.name, path) not in medians:
                continue
            times = medians[row.name, path]
            name = row.name if number == 0 else "… beside"
            whole = f"{times.wall:.2f} / {times.processor:.2f}"
            inner = f"{times.inner_wall:.2f} / {times.inner_processor:.2f}"
            target = "" if row.target is None else f"{row.target:g}{' (whole)' if row.whole else ''}"
            is_node = "mbd_sim.ros" in str(row.arguments) or "rclpy" in str(row.arguments)
            shown = (inner, "–") if is_node else ("–" if row.whole else inner, whole)
            lines.append(f"| {name} | {shown[0]} | {shown[1]} | {target} |")
    return "\n".join(lines)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rounds", type=int, default=7, help="starts of each row, fewer of long ones; default: 7")
    parser.add_argument("--only", default="", help="measure only rows whose names contain this text")
    parser.add_argument("--robots", type=Path, help="a folder with the URDF files of example-robot-data")
    parser.add_argument("--beside", type=Path, help="another checkout to measure in alternation")
    parser.add_argument("--json", type=Path, help="write the medians to this file as well")
    arguments = parser.parse_args()
    checkouts = [HERE, *([arguments.beside.resolve()] if arguments.beside else [])]
    with tempfile.TemporaryDirectory() as folder:
        found = [row for row in rows(Path(folder), arguments.robots) if arguments.only in row.name]
        load = os.getloadavg()[0]
        medians = measure(found, checkouts, arguments.rounds)
    print(table(found, checkouts, medians))
    print(f"\nMeasured on {date.today()}, with a load of {load:.1f} before.")
    if arguments.json:
        content = {f"{name}, {path}": times._asdict() for (name, path), times in medians.items()}
        arguments.json.write_text(json.dumps(content, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
