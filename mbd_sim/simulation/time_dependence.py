"""Whether the motion from a state depends on the time at which it begins."""

from __future__ import annotations

from mbd_sim.simulation.compiled_model import Model


def time_dependence(model: Model) -> str | None:
    """Why the same state moves in another way at another time; None if it does not."""
    functions = [model.equations.rates, model.equations.project]
    if any(function is not None and function.jac_sparsity(0, 0).nnz() for function in functions):
        return "a drive, a force or a constraint of the mechanism depends on the time"
    if model.between_steps is not None:
        return "actuators sample at whole multiples of their periods, or their commands are delayed"
    return None
