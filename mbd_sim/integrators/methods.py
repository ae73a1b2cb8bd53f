"""All integration methods by name."""

from __future__ import annotations

from dataclasses import replace

from mbd_sim.integrators.explicit import ADAMS, EXPLICIT, TAYLOR
from mbd_sim.integrators.implicit import GAUSS, ROSENBROCK, ROSENBROCK_W
from mbd_sim.integrators.method import Method

# Between contacts its steps are those of a method of one step.
MOREAU = replace(EXPLICIT["tsitouras8"], name="moreau", time_stepping=True)
METHODS: dict[str, Method] = {**EXPLICIT, **ADAMS, **TAYLOR, **ROSENBROCK, **ROSENBROCK_W, **GAUSS, MOREAU.name: MOREAU}
