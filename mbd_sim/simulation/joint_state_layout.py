"""The arrays of a `joint_states` message, and the state that they describe.

The free coordinates come first, in the order of `Model.coordinate_names`, then the driven ones. An orientation is a
rotation vector in the message and a quaternion in the state.
"""

from __future__ import annotations

import numpy as np

from mbd_sim.geometry.pose import Array
from mbd_sim.geometry.rotation import of_vector
from mbd_sim.simulation.compiled_model import Model
from mbd_sim.simulation.state_records import Energies


def joint_state_names(model: Model) -> tuple[str, ...]:
    """Return the names of all coordinates, the driven ones last."""
    return (*model.coordinate_names, *model.driven_names)


def joint_state_arrays(model: Model, time: float, y: Array, inputs: Array) -> tuple[Array, Array, Array]:
    """Return positions, velocities and efforts (n,) of a state, SI units.

    Efforts are those commanded and those of actuators; of driven joints they are the drives'.
    """
    position, velocity, effort = model.coordinates(y), y[model.u_range], inputs[: model.layout.nv]
    if model.mechanism.actuators:
        effort = effort + model.actuator_efforts(time, y, inputs)
    if not model.driven_names:
        return position, velocity, effort
    drives = model.drives(time, y, inputs)
    return (
        np.concatenate([position, drives[0]]),
        np.concatenate([velocity, drives[1]]),
        np.concatenate([effort, drives[2]]),
    )


def recorded_state(model: Model, y: Array, position: Array, velocity: Array) -> Array:
    """Return the integrated state `y` with recorded positions and velocities (n,) of the free coordinates."""
    state = y.copy()
    for name, coordinates in model.layout.q.items():
        values = position[model.layout.u[name]]
        if name in model.quaternions:
            orientation = model.quaternions[name] - coordinates.start
            values = np.concatenate([values[:orientation], of_vector(values[orientation:])])
        state[coordinates] = values
    state[model.u_range] = velocity[: model.layout.nv]
    return state


def integrated_energies(energies: Energies) -> tuple[float, float, float]:
    """Return the energies that are part of the state, in their order: its last three values, in J."""
    return energies.work_applied, energies.work_drives, energies.dissipated
