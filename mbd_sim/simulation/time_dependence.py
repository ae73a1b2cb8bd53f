"""Whether the motion from a state depends on the time at which it begins."""

from __future__ import annotations

import math

from mbd_sim.simulation.compiled_model import Model


def time_dependence(model: Model) -> str | None:
    """Why the same state moves in another way at another time; None if it does not, but for `sampling_steps`."""
    functions = [model.equations.rates, model.equations.project]
    if model.between_steps is not None:
        functions += [sampler.function for sampler in model.between_steps.samplers]
    if any(function is not None and function.jac_sparsity(0, 0).nnz() for function in functions):
        return "a drive, a force or a constraint of the mechanism depends on the time"
    return None


def sampling_steps(model: Model) -> int:
    """The number of steps after which all sampled servos act again as at time zero; 1 without such."""
    between = model.between_steps
    return 1 if between is None else math.lcm(*(sampler.every for sampler in between.samplers))
