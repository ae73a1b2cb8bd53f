"""The default method beside `tsitouras8` on every shipped mechanism: costs, energy residuals and errors.

python -m benchmarks.default_method [MECHANISM …]

Prints the table of docs/measurements.md. Each mechanism runs with steps of 1 ms: over 5 s for the largest
energy residual, and over 1 s for the error of the state, relative to its largest component, against `tsitouras8` with a
quarter of the step. The times are processor times of runs over 1 s in calls of 100 steps, taken in turn.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbd_sim import MbdSimError, Simulation
from mbd_sim.files.text.library import shipped
from mbd_sim.simulation.model.method_choice import DEFAULT, ONE_STEP

OTHER, METHODS = ONE_STEP, (DEFAULT, ONE_STEP)
STEP, MANY = 1e-3, 100  # s; steps in a call
WATCHED, COMPARED = 5.0, 1.0  # s
ROUNDS = 9
HEAD = (
    f"| | `{OTHER}`, µs | `{DEFAULT}`, µs | ratio | residual, J | residual, J | error | error |\n"
    "|---|--:|--:|--:|--:|--:|--:|--:|"
)
WORSE = 2.0  # times the residual of the other method, from which on a mechanism is named


@dataclass(frozen=True)
class Row:
    """A mechanism: by method µs per step, the largest residual in J and the error after 1 s; the ratio of times."""

    name: str
    costs: tuple[float, ...]
    ratio: float
    residuals: tuple[float, ...]
    errors: tuple[float, ...]

    def __str__(self) -> str:
        (own, other), (own_residual, other_residual), (own_error, other_error) = self.costs, self.residuals, self.errors
        return (
            f"| `{self.name}` | {other:.3f} | {own:.3f} | {self.ratio:.2f} | {other_residual:.1e} | {own_residual:.1e} "
            f"| {other_error:.0e} | {own_error:.0e} |"
        )


def measured(name: str, rounds: int = ROUNDS) -> Row:
    """Measure one mechanism.

    :raises MbdSimError: a run fails.
    """
    sims = [Simulation.from_file(name, method=method, step=STEP) for method in METHODS]
    reference = Simulation.from_file(name, method=OTHER, step=STEP / 4.0)
    reference.run(COMPARED)
    residuals = tuple(largest_residual(sim) for sim in sims)
    samples = [[second(sim) for sim in sims] for _ in range(rounds)]
    errors = tuple(difference(sim, reference) for sim in sims)
    costs = tuple(1e6 * statistics.median(values) for values in zip(*samples, strict=True))
    return Row(name, costs, statistics.median(other / own for own, other in samples), residuals, errors)


def largest_residual(sim: Simulation) -> float:
    """In J, over 5 s from the start."""
    sim.reset()
    found = 0.0
    for _ in range(round(WATCHED / STEP / 10)):
        sim.step(10)
        found = max(found, abs(sim.energies.residual))
    return found


def second(sim: Simulation) -> float:
    """Processor time in s for each step of the first second."""
    sim.reset()
    step, calls = sim.step, round(COMPARED / STEP / MANY)
    began = time.thread_time()
    for _ in range(calls):
        step(MANY)
    return (time.thread_time() - began) / (calls * MANY)


def difference(sim: Simulation, reference: Simulation) -> float:
    """The largest difference of coordinates and speeds, relative to the largest of them."""
    found, expected = (np.concatenate([one.q, one.u]) for one in (sim, reference))
    return float(np.max(np.abs(found - expected), initial=0.0) / np.max(np.abs(expected), initial=1e-300))


def remarks(rows: Sequence[Row], skipped: Sequence[str], failed: Sequence[str]) -> str:
    """What the table shows, and what is not in it."""
    ratios = [row.ratio for row in rows]
    worse = [row.name for row in rows if row.residuals[0] > WORSE * row.residuals[1]]
    lines = [
        f"{len(rows)} mechanisms; the ratio of their times is {min(ratios):.2f} to {max(ratios):.2f}, with a median of "
        f"{statistics.median(ratios):.2f}. The residual is more than {WORSE:g} times that of `{OTHER}` in: "
        f"{', '.join(worse) or 'none'}. Mechanisms with another default method: {len(skipped)}."
    ]
    return "\n\n".join([*lines, *failed])


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mechanisms", nargs="*", help="names of shipped mechanisms; by default all")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help=f"interleaved samples (default {ROUNDS})")
    options = parser.parse_args()
    rows, skipped, failed = [], [], []
    print(HEAD)
    for name in options.mechanisms or shipped():
        try:
            if Simulation.from_file(name).model.method.name != DEFAULT:
                skipped.append(name)
                continue
            rows.append(measured(name, options.rounds))
        except MbdSimError as error:
            failed.append(f"{name}: {' '.join(str(error).split())}")
            continue
        print(rows[-1], flush=True)
    if rows:
        print(f"\n{remarks(rows, skipped, failed)}")
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()
