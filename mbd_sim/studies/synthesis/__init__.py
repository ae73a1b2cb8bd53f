"""Dimensional synthesis: parameters of a mechanism for a path, a function, or the least effort of its drive.

| module | contents |
|---|---|
| `goals` | what is wanted: `PathGoal`, `FunctionGoal`, `EffortGoal` |
| `problem` | the deviations from a goal as a differentiable function; the least largest one by linear programs |
| `synthesis` | `synthesize`: the optimum, checked by moving the mechanism through it |
"""

from __future__ import annotations

from mbd_sim.studies.synthesis.goals import EffortGoal, FunctionGoal, PathGoal
from mbd_sim.studies.synthesis.synthesis import Design, synthesize

__all__ = ["Design", "EffortGoal", "FunctionGoal", "PathGoal", "synthesize"]
