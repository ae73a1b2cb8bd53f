"""Dimensional synthesis: parameters of a mechanism for a path, a function, or the least effort of its drive.

| module | contents |
|---|---|
| `problem` | what is wanted: `PathGoal`, `FunctionGoal`, `EffortGoal`; its least largest deviation by linear programs |
| `synthesis` | `synthesize`: the optimum, checked by moving the mechanism through it |
"""

from __future__ import annotations

from mbd_sim.studies.synthesis.problem import EffortGoal, FunctionGoal, PathGoal
from mbd_sim.studies.synthesis.synthesis import Design, synthesize

__all__ = ["Design", "EffortGoal", "FunctionGoal", "PathGoal", "synthesize"]
