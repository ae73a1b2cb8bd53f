"""The best parameters between bounds, wherever they are: differential evolution, then local searches from the best.

Differential evolution (Storn & Price 1997, SciPy's) moves a population of sets of parameters through the whole box.
Only the losses of candidates are needed, and all assembly modes count. The best members that differ from each other are
then polished by the local search, with its exact derivatives. With a seed the result has the same bits however many
processes take part.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from typing import Any

import numpy as np

from mbd_sim.base.errors import InputError, MbdSimError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.short_repr import record
from mbd_sim.base.worker_processes import ending_at_once, leave_interrupts_to_parent
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.studies.synthesis.candidates import UNREACHED, ParameterCandidates, candidates_of
from mbd_sim.studies.synthesis.conditions import MET, Condition
from mbd_sim.studies.synthesis.problem import DesignProblem, FunctionGoal, Goal, PathGoal
from mbd_sim.studies.synthesis.synthesis import (
    MOST_STEPS,
    Design,
    Norm,
    bounds_of_unknowns,
    configurations_along,
    design_of,
    design_problem,
    local_optimum,
)

GENERATIONS = 300  # at most
POPULATION = 15  # members for each parameter
CHUNK = 64  # candidates that a process evaluates at once
POLISHED = 12  # members that are polished, at most
APART = 0.05  # least difference of two of them, of the bounds
EXACT = 1e-9  # deviation relative to that of the best member, at which no other one needs polishing

Progress = Callable[[float, float], None]


def synthesize_globally(
    mechanism: Mechanism,
    drive: str,
    goal: Goal,
    variables: Mapping[str, tuple[float, float]],
    *,
    norm: Norm = "rms",
    conditions: Sequence[Condition] = (),
    seed: int = 0,
    generations: int = GENERATIONS,
    population: int = POPULATION,
    workers: int = 1,
    progress: Progress | None = None,
) -> Design:
    """Find the best parameters between bounds, in any assembly mode; the values in the file do not matter.

    The best one is not certain to be found: another `seed`, more generations or a larger population can find a better
    one. The mechanism found can move through all positions of the drive without a dead point.

    :param conditions: what the design has to keep besides.
    :param generations: at most; the search ends earlier when all members are alike.
    :param population: the number of members for each parameter.
    :param workers: processes that evaluate candidates; the result is the same for any number. With several, a script
        needs `if __name__ == "__main__":` around its calls, as all processes of Python do.
    :param progress: called after each generation with the part of the generations that is done, and the least loss.
    :raises MbdSimError: no candidate can be assembled at all positions, or the best ones cannot move through them, or
        none of them keeps the conditions.
    :raises InputError: see `synthesize`.
    """
    if generations < 1 or population < 2 or workers < 1:
        raise InputError(
            f"{generations} generations of {population} members for each parameter, by {workers} processes",
            "Give at least 1, 2 and 1.",
        )
    problem = design_problem(mechanism, drive, goal, variables, norm, conditions)
    settings = SearchSettings(seed, generations, population, workers)
    return global_design(problem, variables, drive, norm, settings, progress)


@record
class SearchSettings:
    """How a global search goes, see `synthesize_globally`."""

    seed: int = 0
    generations: int = GENERATIONS
    population: int = POPULATION
    workers: int = 1


def global_design(
    problem: DesignProblem, variables: Mapping[str, tuple[float, float]], drive: str, norm: Norm,
    settings: SearchSettings, progress: Progress | None = None,
) -> Design:  # fmt: skip
    """The same for a problem whose equations are traced."""
    before, first = _before(problem)
    known = problem.conditions and np.all(np.isfinite(before))
    candidates = candidates_of(problem, norm, _size(before, norm) if known else 1.0)
    limits = list(variables.values())
    with _evaluator(candidates, settings.workers) as losses:
        members, energies, trials = _evolved(losses, limits, settings, progress)
    if energies[0] >= UNREACHED:
        raise MbdSimError(
            f"{problem.mechanism.name}: none of {trials} sets of parameters can be assembled at all positions of the "
            "drive",
            "Give other bounds, or a shorter range.",
        )
    chosen = _different(members[energies < UNREACHED], np.array(limits))
    return _polished(problem, candidates, chosen, (variables, drive, norm), (before, first), trials)


def _evolved(
    losses: Callable[[Array], Array],
    limits: Sequence[tuple[float, float]],
    settings: SearchSettings,
    progress: Progress | None,
) -> tuple[Array, Array, int]:
    """The last population (n, np) in the order of its losses (n,), and the number of evaluations."""
    from scipy.optimize import differential_evolution

    done, least = 0, np.inf

    def of_columns(x: Array) -> Array:
        nonlocal least
        found = losses(np.ascontiguousarray(x.T))
        least = min(least, float(np.min(found)))
        return found

    def report(best: Array, convergence: float) -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done / settings.generations, least)

    found: Any = differential_evolution(
        of_columns,
        limits,
        strategy="rand1bin",
        maxiter=settings.generations,
        popsize=settings.population,
        tol=1e-3,
        mutation=(0.4, 0.9),
        recombination=0.9,
        seed=np.random.default_rng(settings.seed),
        polish=False,
        init="sobol",
        updating="deferred",
        vectorized=True,
        callback=report,
    )
    order = np.argsort(found.population_energies, kind="stable")
    return found.population[order], found.population_energies[order], int(found.nfev) * len(order)


def _different(members: Array, limits: Array) -> Array:
    """The first members that differ from each other."""
    widths, chosen = limits[:, 1] - limits[:, 0], list[Array]()
    for member in members:
        if all(np.max(np.abs(member - one) / widths) > APART for one in chosen):
            chosen.append(member)
        if len(chosen) == POLISHED:
            break
    return np.array(chosen)


def _polished(
    problem: DesignProblem, candidates: ParameterCandidates, members: Array,
    wanted: tuple[Mapping[str, tuple[float, float]], str, Norm], before: tuple[Array, Array], trials: int,
) -> Design:  # fmt: skip
    """The best design near one of the members.

    :raises MbdSimError: none of them can move through the positions of the drive.
    """
    variables, drive, norm = wanted
    losses, configurations, drives = candidates.best(members)
    optima: list[tuple[float, int, Array, Array, int, bool]] = []
    for number, (member, first, places) in enumerate(zip(members, configurations, drives, strict=True)):
        start = _unknowns(problem, member, first, places)
        problem.begin(first, start)
        if not np.all(np.isfinite(problem.deviations(start))):
            continue
        bounds = bounds_of_unknowns(variables, start, around=False)
        x, steps, converged = local_optimum(problem, np.clip(start, *bounds), bounds, norm, MOST_STEPS)
        loss = _size(problem.deviations(x), norm)
        problem.jacobian(x)
        if not _keeps(problem, x):
            continue
        optima.append((loss, number, x, problem.configurations().copy(), steps, converged))
        if loss <= EXACT * losses[0]:
            break
    failure: MbdSimError | None = None
    for _, _, x, places, steps, converged in sorted(optima, key=lambda one: one[:2]):
        problem.begin(places, x)
        try:
            return design_of(
                problem, variables, drive, x, before[0], steps, converged=converged, trials=trials, measured=before[1]
            )
        except MbdSimError as error:
            failure = failure or error
    kept = ", or none keeps the conditions: give wider bounds, or vary more" if problem.conditions else ""
    raise failure or MbdSimError(f"{problem.mechanism.name}: no optimum can be reached from the best members{kept}.")


def _keeps(problem: DesignProblem, x: Array) -> bool:
    """Whether the conditions are met."""
    measured = zip(problem.conditions, problem.measured(x).tolist(), strict=True)
    return all(one.violation(value) <= MET for one, value in measured)


def _size(deviations: Array, norm: Norm) -> float:
    return float(np.sqrt(np.mean(deviations**2)) if norm == "rms" else np.max(np.abs(deviations)))


def _unknowns(problem: DesignProblem, member: Array, configurations: Array, drives: Array) -> Array:
    """The unknowns of the local search: parameters, then positions of the drive or an offset."""
    goal = problem.goal
    if isinstance(goal, PathGoal) and goal.free_timing:
        return np.concatenate([member, drives])
    if isinstance(goal, FunctionGoal) and goal.free_offset:
        return np.append(member, np.mean(configurations[:, problem.output_column] - goal.values))
    return member.copy()


def _before(problem: DesignProblem) -> tuple[Array, Array]:
    """The deviations of the mechanism in the file, and what conditions measure of it.

    They are inf and nan where it does not reach the positions of the drive.
    """
    system = problem.parametric.system
    try:
        problem.begin(configurations_along(system, system.start, problem.goal.drives))
    except MbdSimError:
        return np.full(problem.count, np.inf), np.full(len(problem.conditions), np.nan)
    return problem.deviations(problem.start), problem.measured(problem.start)


_candidates: ParameterCandidates | None = None  # of a worker process


@contextmanager
def _evaluator(candidates: ParameterCandidates, workers: int) -> Iterator[Callable[[Array], Array]]:
    """The losses of rows of parameters, computed in chunks of fixed size."""

    def chunks(parameters: Array) -> list[Array]:
        return [parameters[first : first + CHUNK] for first in range(0, len(parameters), CHUNK)]

    if workers == 1:
        yield lambda parameters: np.concatenate([candidates.losses(chunk) for chunk in chunks(parameters)])
        return
    with ending_at_once(ProcessPoolExecutor(workers, get_context("spawn"), _take_over, (candidates,))) as pool:
        yield lambda parameters: np.concatenate(list(pool.map(_losses, chunks(parameters))))


def _take_over(candidates: ParameterCandidates) -> None:
    leave_interrupts_to_parent()
    global _candidates
    _candidates = candidates


def _losses(parameters: Array) -> Array:
    assert _candidates is not None
    return _candidates.losses(parameters)
