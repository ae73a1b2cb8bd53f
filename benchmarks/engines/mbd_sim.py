"""`mbd_sim` itself, from the mechanism file, driven by `Simulation.step(1)`."""

from __future__ import annotations

from benchmarks.plan import Array, Plan
from mbd_sim import Simulation, __version__
from mbd_sim.integrators.methods import METHODS as INTEGRATORS

VERSION = __version__
METHODS = {name: name for name, method in INTEGRATORS.items() if method.order >= 4}


class MbdSim:
    """A simulation with one of our methods."""

    def __init__(self, plan: Plan, step: float, method: str) -> None:
        self._sim = Simulation.from_text(plan.text, method=method, step=step)
        self._efforts = [[effort] * len(plan.u) for effort in (0.0, 1e-12)]  # N or N·m

    def reset(self, q: Array, u: Array) -> None:
        """Start from a state."""
        self._sim.reset(q, u)

    def each(self, steps: int) -> None:
        """Take single steps, one call each."""
        step = self._sim.step
        for _ in range(steps):
            step(1)

    def commanded(self, steps: int) -> None:
        """Take single steps with new efforts before each, too small to change the motion."""
        step, command = self._sim.step, self._sim.set_efforts
        for index in range(steps):
            command(self._efforts[index & 1])
            step(1)

    def many(self, steps: int) -> None:
        """Take the steps in one call."""
        self._sim.step(steps)

    def state(self) -> tuple[Array, Array]:
        """Coordinates and speeds."""
        return self._sim.q.copy(), self._sim.u.copy()
