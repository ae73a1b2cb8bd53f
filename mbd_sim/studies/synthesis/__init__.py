"""Dimensional synthesis: parameters of a mechanism for a path, a function, or the least effort of its drive.

| module | contents |
|---|---|
| `goals` | what is wanted: `PathGoal`, `FunctionGoal`, `EffortGoal` |
| `design_problem` | the deviations from a goal as a differentiable function of the unknowns |
| `minimax` | the least largest deviation, by linear programs in a trust region |
| `synthesis` | `synthesize`: the optimum, checked by moving the mechanism through it |
"""

from __future__ import annotations

from mbd_sim.studies.synthesis.goals import EffortGoal, FunctionGoal, PathGoal
from mbd_sim.studies.synthesis.synthesis import Design, synthesize

__all__ = ["Design", "EffortGoal", "FunctionGoal", "PathGoal", "synthesize"]
