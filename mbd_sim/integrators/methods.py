"""All integration methods by name."""

from __future__ import annotations

from mbd_sim.integrators.adams import ADAMS, Adams
from mbd_sim.integrators.gauss import GAUSS, Gauss
from mbd_sim.integrators.rosenbrock import ROSENBROCK, ROSENBROCK_W, Rosenbrock
from mbd_sim.integrators.tableau import EXPLICIT, Tableau
from mbd_sim.integrators.taylor import TAYLOR, Taylor

StepMethod = Tableau | Rosenbrock | Gauss | Adams
Method = StepMethod | Taylor

METHODS: dict[str, Method] = {**EXPLICIT, **ADAMS, **TAYLOR, **ROSENBROCK, **ROSENBROCK_W, **GAUSS}
