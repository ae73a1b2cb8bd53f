"""The state of a run as plain data: snapshots, and the arrays of a `joint_states` message.

A snapshot has everything that the rest of a run depends on, and can be pickled.

In a message, the free coordinates come first, in the order of `Model.coordinate_names`, then the driven ones. An
orientation is a rotation vector in the message and a quaternion in the state.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.geometry.rotation import of_vector
from mbd_sim.base.short_repr import record
from mbd_sim.simulation.model.model import Model
from mbd_sim.simulation.model.state_records import Energies


@dataclass(frozen=True)
class RunLayout:
    """What the numbers of a snapshot stand for.

    `coordinates` are the names of the speeds, `loaded` the parts that accept wrenches, `values` the keys of the live
    values, `step_size` is in s, and `members` is the number of simulations.
    """

    mechanism: str
    coordinates: tuple[str, ...]
    loaded: tuple[str, ...]
    values: tuple[str, ...]
    step_size: float
    members: int = 1


_NAMES = {
    "mechanism": "mechanism",
    "coordinates": "coordinates",
    "loaded": "parts that accept wrenches",
    "values": "live values",
    "step_size": "step in s",
    "members": "members",
}


@record
class RunPoint:
    """A run at a step boundary: everything that the rest of it depends on besides later commands.

    `steps` are those since time zero. `state` (n,) is the integrated state y; `inputs` (m,) hold the efforts, the
    wrenches, the commands, the live values and the modes of contacts; `live` are the live values by key. `start_energy`
    is T + V at the start in J. `samples` are the states that sensors have measured, see `SensorSamples.table`, and
    `history` is what the method keeps of earlier steps. `layout` says what the numbers stand for; a recording has it in
    its metadata.
    """

    steps: int
    state: Array
    inputs: Array
    start_energy: float
    live: Mapping[str, float]
    samples: Array = field(default_factory=lambda: np.empty((0, 0)))
    history: Array = field(default_factory=lambda: np.empty(0))
    error_estimate: float = 0.0
    layout: RunLayout | None = None


@dataclass(frozen=True, eq=False)
class MemberFailure:
    """The call of `Ensemble.step` that failed: `count` steps after the first `steps`, with these `inputs` (m,)."""

    steps: int
    count: int
    inputs: Array


@dataclass(frozen=True, eq=False)
class EnsembleSnapshot:
    """All members of an ensemble at a step boundary, from `Ensemble.snapshot`, for `Ensemble.restore`.

    The arrays have a row or an entry for each member; for their meaning see `RunPoint` and `Ensemble.alive`.
    `failures` has an entry for each member that is no longer alive.
    """

    layout: RunLayout
    state: Array
    steps: int
    inputs: Array
    start_energies: Array
    error_estimates: Array
    alive: NDArray[np.bool_]
    failures: Mapping[int, MemberFailure]


def require_same_layout(given: RunLayout | None, own: RunLayout) -> None:
    """Refuse a snapshot whose numbers stand for something else.

    :raises ValueError: it names the difference.
    """
    if given is None:
        raise InputError(
            "it is not known which run this state belongs to",
            "Restore its numbers: restore(point.state, …).",
        )
    pairs = [(words, getattr(given, name), getattr(own, name)) for name, words in _NAMES.items()]
    different = [f"{words}: {one!r} instead of {other!r}" for words, one, other in pairs if one != other]
    if different:
        raise InputError(
            f"this snapshot belongs to another run ({'; '.join(different)})",
            "Build this one in the same way, or restore only what fits: restore(snapshot.state, steps=…).",
        )


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
