"""Runs every robot of a folder of URDF files from rest, as it comes, and prints whether its energies stay in balance.

python -m benchmarks.urdf_robots ~/robots --seconds 10

The wheel of `example-robot-data` contains 69 such files: `pip download --no-deps example-robot-data`, then unzip it.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path

from mbd_sim import DivergedError, MbdSimError, Simulation

SAMPLES = 100  # readings of the energies in a run
SMALLEST = 1.0 / 16.0  # of the step, with which a robot that diverges is tried again
HEADER = "  nv method        step, s until, s residual, J relative    error build,s   run,s"


@dataclass(frozen=True)
class RobotRun:
    """One robot: how far it came in s, the largest energy residual in J, and the largest energy in motion in J.

    `build` and `run` are in s of wall time. `problem` is why it was refused, could not be built, or diverged.
    """

    coordinates: int = 0
    method: str = ""
    step: float = 0.0
    reached: float = 0.0
    residual: float = 0.0
    energy: float = 0.0
    error_estimate: float = 0.0
    build: float = 0.0
    run: float = 0.0
    problem: str = ""


def run_robot(file: Path, seconds: float, step: float | None, method: str | None) -> RobotRun:
    """Build and run one robot in this process."""
    began = time.perf_counter()
    try:
        sim = Simulation.from_file(file, step=step, method=method)
    except MbdSimError as error:
        return RobotRun(build=time.perf_counter() - began, problem=f"refused: {error}")
    built = time.perf_counter()
    start, residual, energy, problem = sim.energies, 0.0, 0.0, ""
    try:
        for sample in range(1, SAMPLES + 1):
            sim.run(until=seconds * sample / SAMPLES)
            now = sim.energies
            residual = max(residual, abs(now.residual))
            energy = max(energy, now.kinetic, abs(now.potential - start.potential), now.dissipated)
    except DivergedError as error:
        problem = f"diverged: {error}"
    ended = time.perf_counter()
    method_name, took = sim.model.method.name, (built - began, ended - built)
    reached = (sim.time, residual, energy, sim.error_estimate)
    return RobotRun(sim.u.size, method_name, sim.step_size, *reached, *took, problem)


def run_apart(file: Path, options: argparse.Namespace, step: float | None) -> RobotRun:
    """The same in a process of its own, which ends after `options.patience` seconds."""
    command = [sys.executable, "-m", "benchmarks.urdf_robots", str(file), "--one", "--seconds", str(options.seconds)]
    command += ["--step", str(step)] if step else []
    command += ["--method", options.method] if options.method else []
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=options.patience, check=False)
    except subprocess.TimeoutExpired:
        return RobotRun(problem=f"not finished after {options.patience:g} s")
    if done.returncode:
        return RobotRun(problem=f"failed: {done.stderr.strip().splitlines()[-1:]}")
    return RobotRun(**json.loads(done.stdout.splitlines()[-1]))


def row(name: str, found: RobotRun) -> str:
    """A line of the table."""
    relative = found.residual / found.energy if found.energy else 0.0
    numbers = (
        f"{found.coordinates:4d} {found.method:13s} {found.step:7.2g} {found.reached:8.3f} {found.residual:11.1e} "
        f"{relative:8.1e} {found.error_estimate:8.1e} {found.build:7.1f} {found.run:7.1f}"
    )
    return f"{name:44s} {numbers}  {' '.join(found.problem.split())[:240]}".rstrip()


def main() -> int:
    """Print a row for each robot, and how many ran to the end. The exit status is the number that never did.

    A robot that diverges is run again with half the step, down to a sixteenth.
    """
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="a folder, searched with its subfolders, or one URDF file")
    parser.add_argument("--seconds", type=float, default=10.0, help="of simulated time (default: 10)")
    parser.add_argument("--step", type=float, help="in s; by default that of mechanism files")
    parser.add_argument("--method", help="by default chosen by the robot's spectrum")
    parser.add_argument("--patience", type=float, default=600.0, help="wall time for each robot in s (default: 600)")
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        print(json.dumps(asdict(run_robot(options.folder, options.seconds, options.step, options.method))))
        return 0
    files = sorted(options.folder.rglob("*.urdf")) if options.folder.is_dir() else [options.folder]
    print(f"{'robot':44s} {HEADER}")
    ran, smaller, diverged = 0, 0, 0
    for file in files:
        step, first = options.step, None
        while True:
            found = run_apart(file, options, step)
            first = first or found
            print(row(file.stem, found), flush=True)
            if not found.problem.startswith("diverged") or found.step <= SMALLEST * first.step:
                break
            step = 0.5 * found.step
        ran += not found.problem
        smaller += not found.problem and found is not first
        diverged += found.problem.startswith("diverged")
    others = len(files) - ran - diverged
    print(
        f"{ran} of {len(files)} robots ran to the end, {smaller} of them with a smaller step; {diverged} diverged, "
        f"{others} were refused or not finished"
    )
    return diverged


if __name__ == "__main__":
    raise SystemExit(main())
