"""Run the benchmarks: python -m benchmarks --help."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path

from benchmarks.engines import CLASSES, NAMES, OURS, Candidate, candidates
from benchmarks.fresh import in_fresh_process
from benchmarks.judge import Judge
from benchmarks.measure import STEP, Result, agreement, measure
from benchmarks.mechanisms import MECHANISMS
from benchmarks.plan import Plan, plan_of
from benchmarks.table import markdown, scientific, summary

HERE = Path(__file__).parent
RESULTS, DOCS = HERE / "results", HERE.parent / "docs"
AGREE = 1e-9


def main() -> None:
    """Measure, print, and save."""
    parser = argparse.ArgumentParser(prog="benchmarks", description="Compare mbd_sim with other simulators.")
    parser.add_argument("--mechanisms", nargs="*", choices=list(MECHANISMS), default=list(MECHANISMS), metavar="NAME")
    parser.add_argument("--engines", nargs="*", choices=list(CLASSES), default=list(CLASSES), metavar="NAME")
    parser.add_argument("--rounds", type=int, default=21, help="interleaved samples of each stepping loop (default 21)")
    parser.add_argument("--no-fresh", action="store_true", help="take set-up times and memory from the previous run")
    parser.add_argument("--no-plots", action="store_true", help="skip the work-precision plots")
    parser.add_argument("--docs", action="store_true", help="write docs/benchmarks.md and docs/work_precision.png")
    options = parser.parse_args()
    chosen, lines = candidates(options.engines)
    report, measured, default = [], {}, ""
    print("\n".join(lines), flush=True)
    RESULTS.mkdir(exist_ok=True)
    for name in options.mechanisms:
        text = MECHANISMS[name]()
        plan, judge = plan_of(text), Judge(text)
        results = measure(plan, judge, chosen, options.rounds)
        for result, candidate in zip(results, chosen, strict=True):
            if options.no_fresh:
                add_last(result, plan)
            else:
                add_fresh(result, candidate, plan)
        checked = (
            f"Largest relative difference of accelerations from ours: {', '.join(agreements(plan, judge, chosen))}."
        )
        measured[name], default = results, judge.sim.mechanism.method
        table = markdown(results, default)
        print(f"\n## {name}\n\n{table}\n\n{checked}", flush=True)
        report += [f"## {name}", table, checked]
        saved = {"mechanism": name, "engines": lines, "results": [asdict(result) for result in results]}
        (RESULTS / f"{plan.name}.json").write_text(json.dumps(saved, indent=1), encoding="utf-8")
    overview = summary(measured, default)
    print(f"\n## All mechanisms\n\n{overview}", flush=True)
    page = "\n\n".join([f"**Versions:** {', '.join(lines)}.", overview, *report]) + "\n"
    (RESULTS / "report.md").write_text(page, encoding="utf-8")
    if options.docs:
        preface = (HERE / "preface.md").read_text(encoding="utf-8")
        (DOCS / "benchmarks.md").write_text(f"{preface}\n{page}", encoding="utf-8")
    if not options.no_plots:
        from benchmarks.work_precision import plots

        plots(options.engines, (DOCS if options.docs else RESULTS) / "work_precision.png")


def add_fresh(result: Result, candidate: Candidate, plan: Plan) -> None:
    """Measure set-up time and memory in a separate process."""
    try:
        found = in_fresh_process(candidate, plan, STEP)
    except RuntimeError as error:
        result.note = result.note or f"set-up: {error}"
        return
    result.setup, result.again, result.memory = found["setup"], found["again"], found["memory"]


def add_last(result: Result, plan: Plan) -> None:
    """Take set-up time and memory from the previous run, if there was one."""
    file = RESULTS / f"{plan.name}.json"
    last = json.loads(file.read_text(encoding="utf-8"))["results"] if file.exists() else []
    for found in last:
        if found["label"] == result.label:
            result.setup, result.again, result.memory = found["setup"], found["again"], found["memory"]


def agreements(plan: Plan, judge: Judge, chosen: list[Candidate]) -> list[str]:
    """The largest difference of the accelerations of each simulator from ours, as text.

    :raises RuntimeError: the model of an open chain differs from ours.
    """
    found = {}
    for candidate in chosen:
        if candidate.module != OURS and candidate.module not in found:
            found[candidate.module] = agreement(plan, judge, candidate)
    for module, difference in found.items():
        if difference is not None and difference > AGREE and not plan.pins:
            raise RuntimeError(
                f"{plan.name}: {NAMES[module]} has a different mechanism: its accelerations differ by {difference:.1e}"
            )
    return [f"{NAMES[module]} {scientific(value)}" for module, value in found.items() if value is not None]


if __name__ == "__main__":
    main()
