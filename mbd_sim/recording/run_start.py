"""The start of a recorded run, as its metadata describes it; `mbd_sim.recording.run_metadata` writes it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mbd_sim.errors import MbdSimError
from mbd_sim.geometry.pose import Array
from mbd_sim.recording.recorded_file import RUN_METADATA, RecordedFile

REQUIRED_KEYS = ("method", "step", "start")


class RecomputeError(MbdSimError):
    """A recording that cannot be recomputed."""


@dataclass(frozen=True)
class RunStart:
    """Everything that the motion depends on besides the mechanism and later commands.

    `step` is in s. `y` is the integrated state and `inputs` are all inputs of the equations. `tick` counts the steps
    since the node started, `steps` those since time zero of the mechanism; `clock_ns` is the simulated clock.
    `samples` are the states that sensors have measured, `history` is what the method keeps of earlier steps. What
    older recordings lack is None: they begin when the node starts.
    """

    file: str
    method: str
    step: float
    wrenches: tuple[str, ...]
    live: Mapping[str, float]
    y: Array
    inputs: Array | None
    start_energy: float | None
    tick: int
    steps: int
    clock_ns: int | None
    samples: Array | None = None
    history: Array | None = None
    frame_prefix: str = ""  # of the frames that messages name


def read_run_start(file: RecordedFile) -> RunStart:
    """Read the start of a run from the metadata of a file.

    :raises RecomputeError: the metadata is missing, incomplete or damaged.
    """
    about = file.metadata.get(RUN_METADATA)
    if about is None:
        raise RecomputeError(f"{file.path}: is not a recording of sim_node: it has no metadata '{RUN_METADATA}'.")
    for key in REQUIRED_KEYS:
        if key not in about:
            raise RecomputeError(f"{file.path}: its metadata '{RUN_METADATA}' lacks '{key}'.")
    try:
        tick = int(about.get("first_tick", about.get("tick", "0")))
        return RunStart(
            file=about.get("file", str(file.path)),
            method=about["method"],
            step=float.fromhex(about["step"]),
            wrenches=tuple(json.loads(about.get("wrenches", "[]"))),
            live={str(key): float.fromhex(value) for key, value in json.loads(about.get("live", "{}")).items()},
            y=_exact(about["start"]),
            inputs=_exact(about["inputs"]) if "inputs" in about else None,
            start_energy=float.fromhex(about["start_energy"]) if "start_energy" in about else None,
            tick=tick,
            steps=int(about.get("first_step", tick)),
            clock_ns=int(about["first_clock"]) if "first_clock" in about else None,
            samples=_exact_rows(about["samples"]) if "samples" in about else None,
            history=_exact(about["history"]) if "history" in about else None,
            frame_prefix=str(json.loads(about.get("parameters", "{}")).get("frame_prefix", "")),
        )
    except (ValueError, TypeError, AttributeError, OverflowError) as error:
        raise RecomputeError(f"{file.path}: its metadata '{RUN_METADATA}' cannot be read ({error}).") from error


def _exact(text: str) -> Array:
    return np.array([float.fromhex(value) for value in json.loads(text)])


def _exact_rows(text: str) -> Array:
    rows = [[float.fromhex(value) for value in row] for row in json.loads(text)]
    return np.array(rows).reshape(len(rows), -1)
