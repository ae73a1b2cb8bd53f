"""All integration methods by name."""

from __future__ import annotations

from dataclasses import replace

from mbd_sim.integrators.adams import ADAMS
from mbd_sim.integrators.gauss import GAUSS
from mbd_sim.integrators.method import Method
from mbd_sim.integrators.rosenbrock import ROSENBROCK, ROSENBROCK_W
from mbd_sim.integrators.tableau import EXPLICIT
from mbd_sim.integrators.taylor import TAYLOR

# Between contacts its steps are those of a method of one step.
MOREAU = replace(EXPLICIT["tsitouras8"], name="moreau", time_stepping=True)
METHODS: dict[str, Method] = {**EXPLICIT, **ADAMS, **TAYLOR, **ROSENBROCK, **ROSENBROCK_W, **GAUSS, MOREAU.name: MOREAU}
