"""New states of a simulation between two steps: at time zero, with positions by name, or given as numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from operator import index

import numpy as np

from mbd_sim.geometry.pose import Array
from mbd_sim.geometry.shaped_arrays import finite_vector
from mbd_sim.simulation.compiled_model import Model
from mbd_sim.simulation.contact_start import require_outside
from mbd_sim.simulation.kernel_memory import KernelMemory
from mbd_sim.simulation.state_values import checked_values, require_allowed_speeds, state_with

Coordinates = Sequence[float] | Array | Mapping[str, float]  # in order, or some by name


def started(
    model: Model, values: Array, q: Coordinates | None, u: Coordinates | None, nearest_speeds: bool
) -> tuple[Array, Array]:
    """The state and the inputs at time zero, with the live values (n,) of the run: see `Simulation.reset`."""
    y, inputs = model.start.copy(), model.inputs.copy()
    positions, speeds = (value if isinstance(value, Mapping) else {} for value in (q, u))
    if q is not None and not isinstance(q, Mapping):
        y[model.q_range] = finite_vector(q, model.layout.nq, "q")
    if u is not None and not isinstance(u, Mapping):
        y[model.u_range] = finite_vector(u, model.layout.nv, "u")
    inputs[model.input_layout.values] = values
    model.normalize(y)
    if q is None and u is None and np.array_equal(inputs, model.inputs):
        return y, inputs
    if positions or speeds:
        y = state_with(model, 0.0, y, values, checked_values(model, positions, speeds))
    else:
        given = y[model.u_range].copy()
        model.project(y, values)
        if u is not None and not nearest_speeds:
            require_allowed_speeds(model, y, given, values)
    model.hold_start(y, inputs)
    require_outside(model, 0.0, y, inputs)
    return y, inputs


def moved(model: Model, memory: KernelMemory, positions: Mapping[str, float], speeds: Mapping[str, float]) -> Array:
    """The present state with positions and speeds by name: see `Simulation.set_state`."""
    given = checked_values(model, positions, speeds)
    time, before, inputs = memory.now
    y = state_with(model, time, before, inputs[model.input_layout.values], given)
    require_outside(model, time, y, inputs)
    model.keep_accounts(time, before, y, inputs)
    return y


def checked_steps(steps: int | None) -> int:
    """The steps since time zero of a state that is restored.

    :raises ValueError: they are missing or negative.
    """
    if steps is None:
        raise ValueError(
            "the time of the state is missing: also give the number of steps, restore(state, steps=…), or restore "
            "a snapshot()."
        )
    if index(steps) < 0:
        raise ValueError(f"the number of steps must be 0 or more, not {steps}.")
    return index(steps)
