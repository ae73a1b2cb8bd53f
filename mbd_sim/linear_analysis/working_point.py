"""The state about which a simulation is linearized."""

from __future__ import annotations

import numpy as np

from mbd_sim.analysis.equilibrium import equilibrium, equilibrium_near, is_autonomous
from mbd_sim.errors import InputError
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.actuators import has_actuator_states
from mbd_sim.simulation.simulation import Simulation

_OTHERWISE = "Linearize about the start or another state instead."


def to_equilibrium(simulation: Simulation, near: Array | None = None) -> Array:
    """Set a simulation to rest in an equilibrium near its start, under its present efforts and live values.

    :param near: coordinates (nq,) of a configuration; then the equilibrium next to it is taken, stable or not. By
        default a stable one near the start is preferred.
    :returns: the coordinates (nq,).
    :raises InputError: none is found, or the mechanism cannot have one: it depends on time, or has one-sided elements
        or actuators with states of their own.
    """
    equations, name = simulation.model.equations, simulation.mechanism.name
    if equations.contact is not None:
        raise InputError(f"no equilibrium of '{name}' is sought, because it has one-sided elements", _OTHERWISE)
    if has_actuator_states(simulation.mechanism):
        raise InputError(f"no equilibrium of '{name}' is sought, because actuators have states", _OTHERWISE)
    if not is_autonomous(equations):
        raise InputError(f"'{name}' has no equilibrium, because forces or drives depend on time", _OTHERWISE)
    inputs, efforts = simulation.inputs.copy(), simulation.efforts.copy()
    q = equilibrium(equations, inputs) if near is None else equilibrium_near(equations, near, inputs)
    if q is None:
        raise InputError(f"no equilibrium of '{name}' was found near this configuration", _OTHERWISE)
    simulation.reset(q=q, u=np.zeros(len(simulation.u)))
    simulation.set_efforts(efforts)
    return q
