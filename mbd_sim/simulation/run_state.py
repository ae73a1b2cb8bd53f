"""What all parts of a simulation share: the compiled model, the memory of the kernel, and the time."""

from __future__ import annotations

from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.simulation.compiled_model import Model
from mbd_sim.simulation.kernel_memory import KernelMemory
from mbd_sim.simulation.live_values import LiveValues


class RunState:
    """The state of a `Simulation`, on which its parts build: readings, steps, changes of the state, and commands."""

    mechanism: Mechanism
    model: Model
    step_size: float
    start_energy: float
    y: Array
    q: Array
    u: Array
    inputs: Array
    _memory: KernelMemory
    _live: LiveValues

    @property
    def steps(self) -> int:
        """Steps since time zero."""
        return self._memory.steps

    @property
    def time(self) -> float:
        """Simulated time in s: the number of steps times the step size, so that it cannot drift."""
        return self.steps * self.step_size

    @property
    def history(self) -> Array:
        """A copy of what the method keeps of earlier steps; empty for most methods."""
        return self._memory.history.copy()

    @property
    def state(self) -> Array:
        """A copy of the integrated state: q, u, and the energies of the audit."""
        return self._memory.y.copy()
