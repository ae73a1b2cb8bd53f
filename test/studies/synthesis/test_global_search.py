"""Global search: what candidates say agrees with the exact problem, and does not depend on processes."""

import numpy as np
import pytest

from mbd_sim import InputError
from mbd_sim.files.checks.override import with_values
from mbd_sim.studies.synthesis import EffortGoal, FunctionGoal, PathGoal, global_search
from mbd_sim.studies.synthesis.candidates import UNREACHED, candidates_of
from mbd_sim.studies.synthesis.global_search import SearchSettings, global_design, synthesize_globally
from mbd_sim.studies.synthesis.problem import DesignProblem
from mbd_sim.studies.synthesis.synthesis import configurations_along
from test.studies.kinematic_analysis.linkages import four_bar, rocker_angles, tracer

ANGLES = np.linspace(0.2, 6.0, 7)
BOUNDS = {"a": (0.1, 0.9), "c": (0.6, 2.4)}


def path_goal(free=False):
    path = tracer(ANGLES)
    return PathGoal("coupler.tracer", np.column_stack([path.real, path.imag, np.full(len(path), np.nan)]), ANGLES, free)


@pytest.mark.parametrize(
    "goal",
    [path_goal(), FunctionGoal("pivot", rocker_angles(ANGLES)[0] - 2 * np.pi, ANGLES), EffortGoal(ANGLES, 3.0)],
    ids=["path", "function", "effort"],
)
def test_losses_of_candidates_are_those_of_the_problem(goal):
    """In the assembly mode of the file; the other one can only be better."""
    mechanism = with_values(four_bar(), {"a": 0.4, "c": 1.3})
    problem = DesignProblem(mechanism, "motor", goal, list(BOUNDS))
    system = problem.parametric.system
    problem.begin(configurations_along(system, system.start, ANGLES))
    exact = problem.deviations(problem.start)
    if isinstance(goal, FunctionGoal):
        exact = np.angle(np.exp(1j * exact))
    candidates = candidates_of(problem, "rms")
    given = np.array([problem.start, [0.9, 2.4]])
    losses = candidates.losses(given)
    assert losses[0] <= np.sqrt(np.mean(exact**2)) * (1.0 + 1e-6)
    assert losses[1] >= UNREACHED  # 0.9 + 2.4 > 1.4 + 1.5: the crank cannot turn
    _, configurations, drives = candidates.best(given[:1])
    problem.begin(configurations[0], problem.start)
    assert np.sqrt(np.mean(problem.deviations(problem.start) ** 2)) == pytest.approx(losses[0], rel=1e-6)
    assert drives[0] == pytest.approx(ANGLES)


def test_a_linkage_is_found_from_the_wrong_mode_and_beyond_its_bounds_by_any_number_of_processes(monkeypatch):
    """The file's crank is not between the bounds, and it is assembled the other way."""
    monkeypatch.setattr(global_search, "POLISHED", 2)
    start = with_values(four_bar(guess=20), {"a": 0.95, "b": 1.2, "c": 1.6})
    problem = DesignProblem(start, "motor", path_goal(), ["a", "b", "c"])
    variables = {**BOUNDS, "b": (0.8, 2.2)}
    variables = {key: variables[key] for key in ("a", "b", "c")}
    seen = []
    settings = SearchSettings(seed=1, generations=4, population=6)
    design = global_design(problem, variables, "motor", "rms", settings, lambda part, loss: seen.append((part, loss)))
    assert design.rms < 1e-12 and design.values == pytest.approx({"a": 0.5, "b": 1.4, "c": 1.2})
    assert design.trials >= 4 * 3 * 6
    assert [part for part, _ in seen] == pytest.approx(np.arange(1, len(seen) + 1) / 4)
    again = global_design(problem, variables, "motor", "rms", SearchSettings(1, 4, 6, workers=2))
    assert again.values == design.values


def test_wrong_settings_are_refused():
    with pytest.raises(InputError, match="0 generations of 15 members"):
        synthesize_globally(four_bar(), "motor", path_goal(), BOUNDS, generations=0)
