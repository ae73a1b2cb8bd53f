"""Machines in contact beside MuJoCo: a quadruped that stands and trots, an escapement, and many hoppers at once.

python -m benchmarks.contact_machines [--rounds 3]

µs are those of processor time per simulated ms, in calls of 1 ms for the quadruped, which gets commands; those of the
hoppers are per member. MuJoCo runs with steps of 1 ms and of 0.0625 ms, the quadruped as in `benchmarks.floor_robots`,
and differences are those of the largest coordinate at the end. The quadruped needs the package `example-robot-data`.
MuJoCo has no outlines, of which the escapement consists; the last column is our energy residual in J.
"""

from __future__ import annotations

import argparse
import os
import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from benchmarks.contacts import HOPPER, MEMBERS, TIME
from benchmarks.floor_robots import Course, difference, ours, theirs
from benchmarks.floor_trials import TRIALS
from benchmarks.robots import robots_folder
from mbd_sim import Ensemble, Simulation
from mbd_sim.files.load import parse_mechanism

SPAN = 2.0  # s
SETTINGS = (1e-3, 6.25e-5)  # s, MuJoCo's steps
DOGS = {"quadruped stands": "a1_stands", "quadruped trots": "a1_trots"}
HOPPERS = """<mujoco><option timestep="{step}" cone="elliptic"/>
<default><geom solref="{stiff} 1" solimp="0.9999 0.9999 0.001 0.5 2" condim="3" friction="0.5 0 0"/></default>
<worldbody><geom type="plane" size="1 1 1" pos="0 0 -0.02"/>
 <body><joint type="slide" axis="0 0 1"/><inertial pos="0 0 0" mass="1" diaginertia="1e-3 1e-3 1e-3"/>
  <body><joint type="slide" axis="0 0 -1" stiffness="2000" damping="2" springref="0.3"/>
   <geom type="sphere" size="0.02" mass="0.1"/></body></body></worldbody></mujoco>"""


@dataclass(frozen=True)
class Row:
    """µs per simulated ms of ours and of each of MuJoCo's settings, its differences from ours, and our residual."""

    name: str
    cost: float
    others: tuple[tuple[float, float], ...]
    residual: float

    def cells(self) -> Iterator[str]:
        """The cells of the row."""
        yield from (self.name, f"{self.cost:.3g}")
        for cost, error in self.others or ((np.nan, np.nan),) * len(SETTINGS):
            yield from ("–",) * 3 if np.isnan(cost) else (f"{cost:.3g}", f"{error:.0e}", f"{cost / self.cost:.2g}")
        yield f"{self.residual:.0e}"


def cost(course: Course) -> float:
    """µs per simulated ms."""
    return 1e6 * course.seconds / (SPAN / 1e-3)


def dog(name: str, trial_name: str, rounds: int) -> Row:
    """A quadruped on four spherical feet, or on all of its shapes."""
    trial = TRIALS[trial_name]
    mechanism = trial.build()
    runs: list[list[Course]] = []
    for _ in range(rounds):
        own = ours(trial, mechanism, SPAN, 4, None)
        runs.append([own, *(theirs(trial, mechanism, SPAN, 4, step) for step in SETTINGS)])
    costs = [statistics.median(cost(run[k]) for run in runs) for k in range(1 + len(SETTINGS))]
    errors = [difference(runs[0][0], other)[-1] for other in runs[0][1:]]
    return Row(name, costs[0], tuple(zip(costs[1:], errors, strict=True)), runs[0][0].residual)


def escapement(rounds: int) -> Row:
    """A pendulum clock with Graham's anchor, of outlines."""
    sim, times = Simulation.from_file("graham_escapement"), []
    for _ in range(rounds):
        sim.reset()
        began = time.thread_time()
        sim.run(until=SPAN)
        times.append(time.thread_time() - began)
    return Row("Graham's escapement", 1e6 * statistics.median(times) / (SPAN / 1e-3), (), sim.energies.residual)


def hoppers(rounds: int) -> Row:
    """Many hoppers that fall from different heights, each as a simulation of MuJoCo."""
    heights = np.array([0.4 + 0.4 * index / MEMBERS for index in range(MEMBERS)])
    ensemble = Ensemble(parse_mechanism(HOPPER), [{"h": float(height)} for height in heights], threads=1)
    calls: list[Callable[[], None]] = [lambda: ensemble.step(round(TIME / ensemble.step_size))]
    ends = [np.zeros((MEMBERS, 2)) for _ in SETTINGS]
    calls += [mujoco_hoppers(heights, step, into) for step, into in zip(SETTINGS, ends, strict=True)]
    costs: list[list[float]] = [[] for _ in calls]
    for _ in range(rounds):
        ensemble.reset()
        for call, times in zip(calls, costs, strict=True):
            began = time.thread_time()
            call()
            times.append(1e6 * (time.thread_time() - began) / (TIME / 1e-3 * MEMBERS))
    medians = [statistics.median(times) for times in costs]
    errors = [float(np.max(np.abs(end - ensemble.q))) for end in ends]
    residual = float(np.max(np.abs(ensemble.energies.residual)))
    return Row(f"{MEMBERS} hoppers", medians[0], tuple(zip(medians[1:], errors, strict=True)), residual)


def mujoco_hoppers(heights: NDArray[np.float64], step: float, into: NDArray[np.float64]) -> Callable[[], None]:
    """A run of all hoppers one after the other, which writes their ends."""
    model = mujoco.MjModel.from_xml_string(HOPPERS.format(step=step, stiff=2.0 * step))
    data = mujoco.MjData(model)

    def run() -> None:
        for index, height in enumerate(heights):
            mujoco.mj_resetData(model, data)
            data.qpos[:] = height, 0.3
            mujoco.mj_step(model, data, nstep=round(TIME / step))
            into[index] = data.qpos

    return run


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3, help="runs of each, of which the median counts (default 3)")
    rounds = parser.parse_args().rounds
    heads = " | ".join(f"MuJoCo, {1e3 * step:g} ms | difference | ratio" for step in SETTINGS)
    print(f"| {SPAN:g} s | µs per ms | {heads} | residual, J |")
    print("| --- | --: |" + " --: | --: | --: |" * len(SETTINGS) + " --: |")
    for name, trial in DOGS.items() if robots_folder() is not None else ():
        print(f"| {' | '.join(dog(name, trial, rounds).cells())} |", flush=True)
    for row in (escapement, hoppers):
        print(f"| {' | '.join(row(rounds).cells())} |", flush=True)
    print(f"\nLoad of the machine over the last minute: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores.")


if __name__ == "__main__":
    main()
