"""`make bench`: runs all comparisons one after another, and keeps what they print in `results`.

python -m benchmarks.everything --python .venv/bin/python [--quick] [--only NAME …]

It must be run by an interpreter that has the other simulators; --python is the one that has ROS. A program that fails
is named at the end, and the others are run nevertheless. `python -m benchmarks.figures` then writes the pages.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from benchmarks.robots import robots_folder
from benchmarks.saved import FOLDER

ROOT = Path(__file__).resolve().parent.parent
LOCAL = {"ROS_DOMAIN_ID": "96", "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}  # unless the environment has others
LIMIT = 3600.0  # s, after which a program is ended


@dataclass(frozen=True)
class Program:
    """A module of this folder: its arguments, those for a quick test, and whether it needs ROS or other simulators."""

    module: str
    arguments: tuple[str, ...] = ()
    quick: tuple[str, ...] = ()
    ros: bool = False
    in_test: bool = True


PROGRAMS = {
    "comparison": Program("benchmarks", quick=("--quick",)),
    "startup": Program("benchmarks.startup", ("--rounds", "5"), quick=("--rounds", "1", "--only", "rod"), ros=True),
    "environments": Program("benchmarks.environments", quick=("--rounds", "1")),
    "contacts": Program("benchmarks.contacts", quick=("--rounds", "1")),
    "contact_bodies": Program("benchmarks.contact_bodies", quick=("--rounds", "1")),
    "contact_machines": Program("benchmarks.contact_machines", quick=("--rounds", "1")),
    "kinematics": Program("benchmarks.kinematics"),
    "default_method": Program("benchmarks.default_method", quick=("double_rod", "four_bar", "--rounds", "1"), ros=True),
    "calls": Program("benchmarks.calls"),
    "sensitivities": Program("benchmarks.sensitivities", ros=True),
    "sweeps": Program("benchmarks.sweeps", ("2048", "20"), quick=("64", "1"), ros=True),
    "lockstep": Program("benchmarks.lockstep", ("double_pendulum", "500"), quick=("double_pendulum", "200"), ros=True),
    "commands": Program("benchmarks.commands", ros=True, in_test=False),
}


def run(name: str, program: Program, interpreter: str, arguments: tuple[str, ...]) -> str:
    """Run a program, print what it prints, and keep it in a file. Returns why it failed, or nothing."""
    command = [interpreter, "-m", program.module, *arguments]
    began, lines = time.monotonic(), []
    print(f"\n### {name}\n", flush=True)
    environment = LOCAL | os.environ
    with subprocess.Popen(command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, text=True) as child:
        timer = threading.Timer(LIMIT, child.kill)
        timer.start()
        for line in child.stdout or ():
            print(line, end="", flush=True)
            lines.append(line)
        child.wait()
        timer.cancel()
    if child.returncode:
        late = time.monotonic() - began >= LIMIT
        return f"{name}: " + (f"not finished after {LIMIT:g} s" if late else f"exit status {child.returncode}")
    FOLDER.mkdir(exist_ok=True)
    file_of(name).write_text("".join(lines), encoding="utf-8")
    return ""


def file_of(name: str) -> Path:
    """What a program printed when it last succeeded."""
    return FOLDER / f"{name}.txt"


def failures(options: argparse.Namespace) -> Iterator[str]:
    """Run the programs; why those failed that did."""
    for name in options.only:
        program = PROGRAMS[name]
        if options.quick and not program.in_test:
            continue
        extra = tuple(options.compare) if name == "comparison" else ()
        arguments = (*(program.quick if options.quick else program.arguments), *extra)
        if name == "startup" and (robots := robots_folder()) is not None:
            arguments += ("--robots", str(robots))
        began = time.monotonic()
        if failure := run(name, program, options.python if program.ros else sys.executable, arguments):
            yield failure
        print(f"{name}: {time.monotonic() - began:.0f} s", file=sys.stderr, flush=True)


def main() -> int:
    """Run them; the exit status is the number of programs that failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--python", default=sys.executable, help="interpreter of mbd_sim itself, with ROS")
    parser.add_argument("--only", nargs="*", choices=list(PROGRAMS), default=list(PROGRAMS), metavar="NAME")
    parser.add_argument("--quick", action="store_true", help="a short test of all programs but the commands to a node")
    options, options.compare = parser.parse_known_args()  # the rest is for the comparison
    failed = list(failures(options))
    print("\n".join(["", *failed]), file=sys.stderr)
    return len(failed)


if __name__ == "__main__":
    sys.exit(main())
