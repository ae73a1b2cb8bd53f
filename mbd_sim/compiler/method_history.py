"""The size of what a method keeps of earlier steps, in memory behind the inputs of the system."""

from __future__ import annotations

from mbd_sim.compiler.adams_history import history_size as adams_size
from mbd_sim.compiler.taylor_history import expansion_size
from mbd_sim.integrators.methods import Method
from mbd_sim.integrators.taylor import Taylor


def history_size(method: Method, size: int, inputs_size: int) -> int:
    """The numbers of the history of a method, for a state and inputs of these sizes; 0 for methods without one."""
    if isinstance(method, Taylor):
        return expansion_size(method, size, inputs_size)
    return adams_size(method, size, inputs_size)
