"""Steps of time stepping (method `moreau`): what they cost, and random ones beside those of the code for all contacts.

python -m benchmarks.time_stepping [--seeds 2] [--steps 600]

µs are those of processor time of a call of one step, with commands where the machine has some; those of the ensemble
are per step and member, in calls of 1000 steps. Then each step of random mechanisms and scenes with contacts is taken
in compiled code and in Python, from the same state, and compared. The quadruped needs `example-robot-data`.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator

import numpy as np

from benchmarks.floor_trials import TRIALS, silent
from benchmarks.robots import robots_folder
from mbd_sim import Ensemble, MbdSimError, Simulation
from test.generators.body_scenes import SCENES, scene
from test.generators.contact_mechanisms import ALL_KINDS, contact_mechanism
from test.simulation.contact.compiled.both_ways import Both
from test.simulation.contact.time_stepping.test_stepper import STACK

METHOD, STEPS, MEMBERS = "moreau", 1000, 100
DOGS = ("a1_trots", "a1_stands")
SHIPPED = ("bounce", "rope", "slider_crank_friction", "spinning_ball", "grasp", "heap")


def simulations() -> Iterator[tuple[str, Simulation]]:
    """The scenes with their names."""
    for name in DOGS if robots_folder() is not None else ():
        yield name, Simulation(TRIALS[name].build(), step=1e-3, method=METHOD)
    for name in SHIPPED:
        yield name, Simulation.from_file(name, method=METHOD)
    yield "stack", Simulation.from_text(STACK, method=METHOD)


def print_costs() -> None:
    """µs of each step."""
    print("| | µs: median | mean | longest |")
    print("| --- | --: | --: | --: |")
    for name, simulation in simulations():
        commands, times = TRIALS[name].commands if name in TRIALS else silent, list[float]()
        for _ in range(STEPS):
            given = commands(simulation.time)
            began = time.thread_time()
            if given:
                simulation.set_commands(given)
            simulation.step()
            times.append(1e6 * (time.thread_time() - began))
        later = np.array(times[1:])
        print(f"| {name} | {np.median(later):.3g} | {np.mean(later):.3g} | {np.max(later):.3g} |", flush=True)
    choices = [{"e": 0.3 + 0.6 * index / MEMBERS} for index in range(MEMBERS)]
    ensemble = Ensemble.from_file("bounce", choices, method=METHOD, threads=1)
    ensemble.step(1)
    began = time.thread_time()
    ensemble.step(STEPS)
    print(f"| {MEMBERS} members of bounce | {1e6 * (time.thread_time() - began) / STEPS / MEMBERS:.2g} | | |")


def print_comparison(seeds: int, steps: int) -> None:
    """How many steps of random scenes are compiled, and act on contacts; each is compared."""
    scenes = compiled = left = acting = 0
    for seed in range(seeds):
        for kind in (*ALL_KINDS, *SCENES):
            text = (scene if kind in SCENES else contact_mechanism)(seed, kind)
            try:
                both = Both(Simulation.from_text(text, method=METHOD))
            except MbdSimError:
                continue
            try:
                both.compare(steps)
            except AssertionError as error:
                print(f"{kind} {seed}: {error}", flush=True)
            scenes, compiled, left, acting = (
                scenes + 1,
                compiled + both.compiled,
                left + both.left,
                acting + both.acting,
            )
    print(f"{scenes} random scenes: {compiled} steps compiled, of which {acting} with contacts; {left} left to Python")


def main() -> None:
    """Print both."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=2, help="random scenes of each kind (default 2)")
    parser.add_argument("--steps", type=int, default=600, help="of each random scene (default 600)")
    options = parser.parse_args()
    print_costs()
    print_comparison(options.seeds, options.steps)


if __name__ == "__main__":
    main()
