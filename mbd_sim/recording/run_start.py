"""What a recorded run begins with, as its metadata says; see `mbd_sim.recording.run_metadata`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mbd_sim.errors import MbdSimError
from mbd_sim.geometry.pose import Array
from mbd_sim.recording.contents import Part
from mbd_sim.recording.reader import ABOUT

NEEDED = ("method", "step", "start")


class RecomputeError(MbdSimError):
    """A recording that cannot be computed again."""


@dataclass(frozen=True)
class Beginning:
    """All that the motion depends on, besides the mechanism and what is commanded later.

    `step` is in s. `start` is the whole integrated state and `inputs` are all of the equations; `tick` counts the steps
    since the node started, `steps` those of the mechanism since its time zero, and `clock_ns` is the node's clock. What
    older recordings do not say is None: they begin with the node.
    """

    file: str
    method: str
    step: float
    wrenches: tuple[str, ...]
    live: Mapping[str, float]
    start: Array
    inputs: Array | None
    start_energy: float | None
    tick: int
    steps: int
    clock_ns: int | None


def beginning(part: Part) -> Beginning:
    """Read the metadata of a file.

    :raises RecomputeError: there is none, or it lacks something, or is damaged.
    """
    about = part.metadata.get(ABOUT)
    if about is None:
        raise RecomputeError(f"{part.path}: is no recording of sim_node: it has no metadata '{ABOUT}'.")
    for key in NEEDED:
        if key not in about:
            raise RecomputeError(f"{part.path}: its metadata '{ABOUT}' lacks '{key}'.")
    try:
        tick = int(about.get("first_tick", about.get("tick", "0")))
        live = {str(key): float.fromhex(value) for key, value in json.loads(about.get("live", "{}")).items()}
        return Beginning(
            file=about.get("file", str(part.path)),
            method=about["method"],
            step=float.fromhex(about["step"]),
            wrenches=tuple(json.loads(about.get("wrenches", "[]"))),
            live=live,
            start=_exact(about["start"]),
            inputs=_exact(about["inputs"]) if "inputs" in about else None,
            start_energy=float.fromhex(about["start_energy"]) if "start_energy" in about else None,
            tick=tick,
            steps=int(about.get("first_step", tick)),
            clock_ns=int(about["first_clock"]) if "first_clock" in about else None,
        )
    except (ValueError, TypeError, AttributeError, OverflowError) as error:
        raise RecomputeError(f"{part.path}: its metadata '{ABOUT}' cannot be read ({error}).") from error


def _exact(text: str) -> Array:
    return np.array([float.fromhex(value) for value in json.loads(text)])
