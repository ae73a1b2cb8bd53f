"""Run the benchmarks: python -m benchmarks --help."""

from __future__ import annotations

import argparse
import datetime
import os
import sys
from importlib.metadata import PackageNotFoundError

from benchmarks import saved
from benchmarks.engines import CLASSES, OURS, Candidate, candidates
from benchmarks.fresh import in_fresh_process
from benchmarks.judge import END, Judge
from benchmarks.measure import STEP, Effort, Result, measure
from benchmarks.mechanisms import LARGE, MECHANISMS, left_out, plan_named
from benchmarks.overview import overview, summary
from benchmarks.plan import Plan
from benchmarks.report import details
from benchmarks.saved import Measured

COMPARED = ("rk4", "tsitouras8", "taylor")  # of our methods, besides the default, where not all are measured
FRESH = {"mujoco": ("Euler",)}  # methods whose set-up is measured, where not of all


def main() -> int:
    """Measure, save and print; the exit status is the number of mechanisms that could not be measured."""
    parser = argparse.ArgumentParser(prog="benchmarks", description="Compare mbd_sim with other simulators.")
    parser.add_argument("--mechanisms", nargs="*", choices=list(MECHANISMS), default=list(MECHANISMS), metavar="NAME")
    parser.add_argument("--engines", nargs="*", choices=list(CLASSES), default=list(CLASSES), metavar="NAME")
    parser.add_argument("--rounds", type=int, default=9, help="interleaved samples of each stepping loop (default 9)")
    parser.add_argument("--no-fresh", action="store_true", help="take set-up times and memory from the previous run")
    parser.add_argument("--no-plots", action="store_true", help="skip the work-precision plots")
    parser.add_argument("--quick", action="store_true", help="three short samples, no set-up times, no plots: a test")
    options = parser.parse_args()
    effort = Effort(3, 0.1 * END, END) if options.quick else Effort(options.rounds)
    chosen, versions = candidates(options.engines)
    measured, failed = [], 0
    for name in options.mechanisms:
        print(f"Measuring {name} …", file=sys.stderr, flush=True)
        try:
            found = measured_mechanism(name, chosen, versions, effort, fresh=not (options.no_fresh or options.quick))
        except (PackageNotFoundError, RuntimeError) as error:
            print(f"{name}: {error}", file=sys.stderr, flush=True)
            failed += 1
            continue
        saved.save(found)
        measured.append(found)
    if not measured:
        return failed
    print(f"\n{overview(summary(measured))}\n\n{details(measured)}", flush=True)
    if not (options.no_plots or options.quick):
        from benchmarks.work_precision import plots

        plots(options.engines, saved.FOLDER / "work_precision.png")
    return failed


def measured_mechanism(
    name: str, candidates: list[Candidate], versions: list[str], effort: Effort, fresh: bool
) -> Measured:
    """All simulators on one mechanism; without `fresh`, with the set-up times of the previous run."""
    text = MECHANISMS[name]()
    plan, judge = plan_named(name, text), Judge(text)
    default = judge.sim.model.method.name
    load, today = os.getloadavg()[0], datetime.datetime.now(datetime.UTC).date().isoformat()
    found = Measured(name, f"{OURS} {default}", today, load, effort.rounds, effort.sample, versions)
    chosen = []
    for candidate in candidates:
        if why := left_out(name, candidate.module):
            found.left_out[candidate.label] = why
        elif candidate.module != OURS or name not in LARGE or candidate.method in (*COMPARED, default):
            chosen.append(candidate)
    previous, set_up = saved.load(name), FRESH | {OURS: (*COMPARED, default)}
    if name in LARGE:
        set_up["heyoka"] = ()  # which compiles for minutes
    found.results, found.agreement = measure(plan, judge, chosen, effort)
    for result, candidate in zip(found.results, chosen, strict=True):
        if not fresh:
            add_previous(result, previous)
        elif candidate.method in set_up.get(candidate.module, (candidate.method,)):
            add_fresh(result, candidate, plan)
    return found


def add_fresh(result: Result, candidate: Candidate, plan: Plan) -> None:
    """Measure set-up time and memory in a separate process."""
    try:
        found = in_fresh_process(candidate, plan, STEP)
    except RuntimeError as error:
        result.note = result.note or f"set-up: {error}"
        return
    result.setup, result.again, result.memory = found["setup"], found["again"], found["memory"]


def add_previous(result: Result, previous: Measured | None) -> None:
    """Take set-up time and memory from the previous run, if there was one."""
    if previous is not None and (last := previous.result(result.label)) is not None:
        result.setup, result.again, result.memory = last.setup, last.again, last.memory


if __name__ == "__main__":
    sys.exit(main())
