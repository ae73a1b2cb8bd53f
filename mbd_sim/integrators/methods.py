"""All integration methods by name."""

from __future__ import annotations

from mbd_sim.integrators.explicit import ADAMS, EXPLICIT, TAYLOR
from mbd_sim.integrators.implicit import GAUSS, ROSENBROCK, ROSENBROCK_W
from mbd_sim.integrators.method import Method

METHODS: dict[str, Method] = {**EXPLICIT, **ADAMS, **TAYLOR, **ROSENBROCK, **ROSENBROCK_W, **GAUSS}
