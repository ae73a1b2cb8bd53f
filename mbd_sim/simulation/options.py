"""The keyword arguments of `Simulation` and `Ensemble`, which describe them, for the functions that pass them on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypedDict

Value = float | str | Sequence[float]  # of a key of a mechanism file: in SI units, or a text such as "30 deg"


class SimulationOptions(TypedDict, total=False):
    """The keyword arguments of `Simulation`."""

    method: str | None
    step: float | None
    wrenches: Sequence[str]
    live: Sequence[str]
    set: Mapping[str, Value]


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
