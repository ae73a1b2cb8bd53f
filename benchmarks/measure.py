"""The measurements: interleaved times, error after three seconds, drift of the energy."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from benchmarks.engines import Candidate, Engine
from benchmarks.judge import END, Judge
from benchmarks.plan import Plan

STEP = 1e-3  # s
SAMPLE_TIME = 2e-3  # s, approximate duration of one sample of a stepping loop
MAX_STEPS = 2000  # of a sample
SLOW = 60e-6  # s per step, above which the energy is monitored for a shorter time
LONG, SHORT = 100.0, 10.0  # s


@dataclass
class Result:
    """Measurements of one simulator on one mechanism; times in µs per step of 1 ms, energies relative."""

    label: str
    each: float | None = None
    many: float | None = None
    error: float | None = None
    drift: float | None = None
    monitored: float = LONG
    violation: float | None = None
    setup: float | None = None
    again: float | None = None
    memory: float | None = None
    note: str = ""
    samples: dict[str, list[float]] = field(default_factory=dict, repr=False)


def measure(plan: Plan, judge: Judge, chosen: Sequence[Candidate], rounds: int) -> list[Result]:
    """All candidates on one mechanism."""
    engines: dict[str, Engine] = {}
    results = {}
    for candidate in chosen:
        results[candidate.label] = result = Result(candidate.label)
        try:
            engines[candidate.label] = candidate.build(plan, STEP)
        except Exception as error:  # simulators raise all kinds of exceptions for models they do not support
            result.note = f"cannot: {error}"
    time_interleaved(plan, engines, results, rounds)
    for label, engine in engines.items():
        accuracy(plan, judge, engine, results[label])
    return list(results.values())


def time_interleaved(plan: Plan, engines: dict[str, Engine], results: dict[str, Result], rounds: int) -> None:
    """Time all engines in turn, so that other load on the machine affects them alike; medians."""
    loops = {
        (label, kind): loop
        for label, engine in engines.items()
        for kind in ("each", "many")
        if (loop := getattr(engine, kind)) is not None
    }
    steps = {}
    for label, kind in loops:
        cost = timed(plan, engines[label], loops[label, kind], 100)
        # An engine with its own step size needs room for its steps.
        fewest = 1 if engines[label].each else MAX_STEPS // 2
        steps[label, kind] = max(fewest, min(MAX_STEPS, int(SAMPLE_TIME / max(cost, 1e-9))))
    for _ in range(rounds):
        for (label, kind), loop in loops.items():
            sample = timed(plan, engines[label], loop, steps[label, kind])
            results[label].samples.setdefault(kind, []).append(1e6 * sample)
    for label, kind in loops:
        setattr(results[label], kind, statistics.median(results[label].samples[kind]))


def timed(plan: Plan, engine: Engine, loop: Callable[[int], None], steps: int) -> float:
    """Processor time per step in s, from the start state on."""
    engine.reset(plan.q, plan.u)
    loop(2)
    began = time.thread_time()
    loop(steps)
    return (time.thread_time() - began) / steps


def accuracy(plan: Plan, judge: Judge, engine: Engine, result: Result) -> None:
    """Measure the error after three seconds, the largest drift of the energy, and the violation of the loops."""
    engine.reset(plan.q, plan.u)
    start = judge.energy(plan.q, plan.u)
    second = round(1.0 / STEP)
    result.monitored = LONG if 1e-6 * (result.many or 0.0) < SLOW else SHORT
    drift = violation = 0.0
    for t in range(1, round(result.monitored) + 1):
        try:
            engine.many(second)
            q, u = engine.state()
        except Exception as error:
            q, u = np.full((2, len(plan.q)), math.nan)
            result.note = str(error)
        if not np.all(np.isfinite([*q, *u])) or max(np.abs(u)) > 1e6:
            result.note = result.note or f"diverged before t = {t} s"
            drift = math.inf
            break
        now = (judge.energy(q, u) - start) / judge.largest_kinetic_energy
        drift = now if abs(now) > abs(drift) else drift
        violation = max(violation, judge.violation(q, u))
        if t == END:
            result.error = judge.error(q, u)
    result.drift = drift
    result.violation = violation if plan.pins else None


def agreement(plan: Plan, judge: Judge, candidate: Candidate, states: int = 10) -> float | None:
    """The largest relative difference of the accelerations from ours: at random states, with loops at the start state.

    None if the simulator provides no accelerations.
    """
    engine = candidate.build(plan, STEP)
    if not hasattr(engine, "accelerations"):
        return None
    rng, worst = np.random.default_rng(4), 0.0
    states_compared = [(plan.q, plan.u)] if plan.pins else rng.normal(size=(states, 2, len(plan.q)))
    for q, u in states_compared:
        try:
            found = engine.accelerations(q, u)
        except NotImplementedError:
            return None
        expected = judge.accelerations(q, u)
        worst = max(worst, float(np.max(np.abs(found - expected)) / np.max(np.abs(expected))))
    return worst
