"""Dimensional synthesis: parameters of a mechanism for a path, a function, or the least effort of its drive.

Linkages for poses, dead centers and functions, without a mechanism to start from, are in `linkages`.

| module | contents |
|---|---|
| `problem` | what is wanted: `PathGoal`, `FunctionGoal`, `EffortGoal` |
| `conditions` | what a design keeps besides: `Condition` |
| `minimizers` | least peaks by linear programs, least squares, both under conditions |
| `synthesis` | `synthesize`: the optimum nearby, checked by moving the mechanism through it |
| `candidates` | many sets of parameters at once, and how far each is from the goal |
| `global_search` | `synthesize_globally`: differential evolution between bounds, then local searches |
"""

from __future__ import annotations

from mbd_sim.studies.synthesis.conditions import Condition
from mbd_sim.studies.synthesis.global_search import synthesize_globally
from mbd_sim.studies.synthesis.problem import EffortGoal, FunctionGoal, PathGoal
from mbd_sim.studies.synthesis.synthesis import Design, synthesize

__all__ = ["Condition", "Design", "EffortGoal", "FunctionGoal", "PathGoal", "synthesize", "synthesize_globally"]
