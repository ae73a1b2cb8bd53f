"""The measurements: interleaved times, error after three seconds, drift of the energy."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from benchmarks.engines import NAMES, Candidate, Engine
from benchmarks.judge import END, Judge
from benchmarks.plan import Plan

STEP = 1e-3  # s
AGREE = 1e-9  # of the largest acceleration
DURATIONS = (100.0, 10.0, END)  # s, for which the energy is monitored: the longest one that costs no more than
PATIENCE = 4.0  # s of computing


@dataclass(frozen=True)
class Effort:
    """How thoroughly to measure.

    The interleaved samples of each stepping loop, the simulated time of each in s, and the longest time in s over which
    the energy is monitored.
    """

    rounds: int
    sample: float = END
    longest: float = DURATIONS[0]


@dataclass
class Result:
    """Measurements of one simulator on one mechanism; times in µs per step of 1 ms, energies relative."""

    label: str
    each: float | None = None
    many: float | None = None
    commanded: float | None = None
    error: float | None = None
    drift: float | None = None
    monitored: float = DURATIONS[0]
    violation: float | None = None
    setup: float | None = None
    again: float | None = None
    memory: float | None = None
    note: str = ""
    samples: dict[str, list[float]] = field(default_factory=dict, repr=False)


def measure(plan: Plan, judge: Judge, chosen: Sequence[Candidate], effort: Effort) -> tuple[list[Result], dict]:
    """All candidates on one mechanism, and the largest differences of accelerations from ours by simulator."""
    engines: dict[str, Engine] = {}
    results, agreement = {}, {}
    for candidate in chosen:
        results[candidate.label] = result = Result(candidate.label)
        try:
            engines[candidate.label] = engine = candidate.build(plan, STEP)
        except Exception as error:  # simulators raise all kinds of exceptions for models they do not support
            result.note = f"cannot: {error}"
            continue
        if candidate.module not in agreement:
            agreement[candidate.module] = difference(plan, judge, engine)
            require_agreement(plan, candidate, agreement[candidate.module])
    time_interleaved(plan, engines, results, effort)
    for label, engine in engines.items():
        accuracy(plan, judge, engine, results[label], effort.longest)
    return list(results.values()), {name: value for name, value in agreement.items() if value is not None}


def require_agreement(plan: Plan, candidate: Candidate, found: float | None) -> None:
    """Refuse to compare different mechanisms.

    :raises RuntimeError: the model of an open chain differs from ours.
    """
    if found is not None and not found <= AGREE and not plan.pins:
        raise RuntimeError(
            f"{plan.name}: {NAMES[candidate.module]} has a different mechanism: its accelerations differ by {found:.1e}"
        )


def time_interleaved(plan: Plan, engines: dict[str, Engine], results: dict[str, Result], effort: Effort) -> None:
    """Time all engines in turn, so that other load on the machine affects them alike; medians.

    Each sample is a run from the start state: what a step costs may change with the motion.
    """
    loops = {
        (label, kind): loop
        for label, engine in engines.items()
        for kind in ("each", "many", "commanded")
        if (loop := getattr(engine, kind, None)) is not None
    }
    steps = round(effort.sample / STEP)
    for _ in range(effort.rounds):
        for (label, kind), loop in loops.items():
            sample = timed(plan, engines[label], loop, steps)
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


def accuracy(plan: Plan, judge: Judge, engine: Engine, result: Result, longest: float) -> None:
    """Measure the error after three seconds, the largest drift of the energy, and the violation of the loops.

    Where dampers dissipate energy, there is no drift.
    """
    engine.reset(plan.q, plan.u)
    start = judge.energy(plan.q, plan.u)
    second = round(1.0 / STEP)
    second_costs = 1e-6 * (result.many or 0.0) / STEP
    durations = [duration for duration in DURATIONS if duration <= longest and duration * second_costs <= PATIENCE]
    result.monitored = durations[0] if durations else END
    drift = violation = 0.0
    for t in range(1, round(result.monitored) + 1):
        try:
            engine.many(second)
            q, u = engine.state()
        except Exception as error:
            q, u = np.full(len(plan.q), math.nan), np.full(len(plan.u), math.nan)
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
    result.drift = drift if plan.conservative or not math.isfinite(drift) else None
    result.violation = violation if plan.pins else None


def difference(plan: Plan, judge: Judge, engine: Engine, states: int = 10) -> float | None:
    """The largest relative difference of the accelerations from ours: at random states, with loops at the start state.

    None if the simulator provides no accelerations.
    """
    if not hasattr(engine, "accelerations"):
        return None
    worst = 0.0
    for q, u in [(plan.q, plan.u)] if plan.pins else plan.random_states(states):
        try:
            found = engine.accelerations(q, u)
        except NotImplementedError:
            return None
        expected = judge.accelerations(q, u)
        worst = max(worst, float(np.max(np.abs(found - expected)) / np.max(np.abs(expected))))
    return worst
