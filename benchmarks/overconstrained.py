"""The energy residual of random overconstrained linkages after ten minutes of simulated time, free and driven.

python -m benchmarks.overconstrained --seconds 600 --count 20
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from itertools import islice

from mbd_sim import DivergedError, MechanismError, Simulation
from test.generators.overconstrained import LINKAGES, linkage_text

SAMPLE = 500  # steps between two readings of the energies
BOUND = 1e-9


@dataclass(frozen=True)
class LinkageRun:
    """The largest residual of a run, relative to the energy that is in motion; `violation` is the largest one."""

    name: str
    seed: int
    driven: bool
    step: float
    residual: float
    violation: float
    error_estimate: float
    seconds: float


def run(name: str, seed: int, driven: bool, seconds: float, step: float | None) -> LinkageRun:
    """Simulate one linkage; its residual is infinite if the run diverges."""
    sim = Simulation.from_text(linkage_text(name, seed, driven=driven), step=step)
    began, residual, violation, start = time.perf_counter(), 0.0, 0.0, sim.energies
    largest = start.kinetic
    try:
        for _ in range(round(seconds / sim.step_size / SAMPLE)):
            sim.step(SAMPLE)
            now = sim.energies
            largest = max(largest, now.kinetic, abs(now.potential - start.potential))
            residual, violation = max(residual, abs(now.residual)), max(violation, *sim.violation)
    except DivergedError:
        residual = float("inf")
    took = time.perf_counter() - began
    return LinkageRun(name, seed, driven, sim.step_size, residual / largest, violation, sim.error_estimate, took)


def main() -> None:
    """Run each linkage free and driven; where the bound is missed, again with smaller steps."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--linkages", nargs="+", choices=list(LINKAGES), default=list(LINKAGES))
    parser.add_argument("--step", type=float, help="in s; by default that of the file")
    options = parser.parse_args()
    missed = 0
    pairs = islice(((name, seed) for seed in range(options.count) for name in options.linkages), options.count)
    for name, seed in pairs:
        for driven in (False, True):
            step, found = options.step, None
            for _ in range(4):
                try:
                    found = run(name, seed, driven, options.seconds, step)
                except MechanismError as error:
                    print(f"{name:22s} {seed:2d} cannot be driven from here: {error}", flush=True)
                    break
                print(
                    f"{name:22s} {seed:2d} {'driven' if driven else 'free':6s} step {found.step:.3g}: residual "
                    f"{found.residual:.1e}, violation {found.violation:.1e}, step error "
                    f"{found.error_estimate:.1e}, {found.seconds:.0f} s",
                    flush=True,
                )
                if found.residual < BOUND:
                    break
                step = 0.5 * found.step
            missed += found is None or not found.residual < BOUND
    print(f"{missed} runs miss {BOUND:.0e} with all steps")


if __name__ == "__main__":
    main()
