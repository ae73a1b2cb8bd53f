"""The keyword arguments of `Simulation` and `Ensemble`, which describe them, for the functions that pass them on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypedDict


class SimulationOptions(TypedDict, total=False):
    """The keyword arguments of `Simulation`."""

    method: str | None
    step: float | None
    wrenches: Sequence[str]
    live: Sequence[str]


class EnsembleOptions(TypedDict, total=False):
    """The keyword arguments of `Ensemble`."""

    method: str | None
    step: float | None
    threads: int | None
