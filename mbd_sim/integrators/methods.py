"""All integration methods by name."""

from __future__ import annotations

from mbd_sim.integrators.gauss import GAUSS, Gauss
from mbd_sim.integrators.rosenbrock import ROSENBROCK, Rosenbrock
from mbd_sim.integrators.tableau import EXPLICIT, Tableau

Method = Tableau | Rosenbrock | Gauss

METHODS: dict[str, Method] = {**EXPLICIT, **ROSENBROCK, **GAUSS}
AUTO = "auto"  # instead of a name: chosen by the rates of the mechanism
