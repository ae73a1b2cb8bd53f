"""The keyword arguments of `Simulation` and `Ensemble`, which describe them, for the functions that pass them on."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TypedDict

from mbd_sim.errors import MechanismError, nearest
from mbd_sim.mechanism.records import Mechanism

Value = float | str | Sequence[float]  # of a key of a mechanism file: in SI units, or a text such as "30 deg"


class SimulationOptions(TypedDict, total=False):
    """The keyword arguments of `Simulation`."""

    method: str | None
    step: float | None
    wrenches: Sequence[str]
    live: Sequence[str]
    set: Mapping[str, Value]
    parameters: Mapping[str, Value]


class RecordingOptions(TypedDict, total=False):
    """The keyword arguments of `RunRecorder`."""

    rate: float | None
    reactions: bool
    violation: bool
    poses: Sequence[str]
    accelerations: Sequence[str]


class EnsembleOptions(TypedDict, total=False):
    """The keyword arguments of `Ensemble`."""

    method: str | None
    step: float | None
    threads: int | None
    progress: Callable[[float], None] | None


def changed_values(
    mechanism: Mechanism, values: Mapping[str, Value], parameters: Mapping[str, Value]
) -> dict[str, Value]:
    """Values by key with parameters by name.

    :raises MechanismError: the mechanism has no such parameter.
    :raises ValueError: a parameter is among the values, too.
    """
    for name in parameters:
        if name not in mechanism.parameters:
            message, remedy = f"there is no parameter '{name}'", nearest(name, mechanism.parameters)
            raise MechanismError([mechanism.source.problem(("parameters",), message, remedy)])
        if name in values or f"parameters.{name}" in values:
            raise ValueError(f"the parameter '{name}' is given in `set` and in `parameters`. Give it once.")
    return {**values, **{f"parameters.{name}": value for name, value in parameters.items()}}
