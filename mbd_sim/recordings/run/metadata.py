"""The metadata of a recording: everything besides its messages that is needed to recompute the run.

It is written here, and read as the start of the recorded run.
"""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

import mbd_sim
from mbd_sim.base.errors import MbdSimError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.recordings.messages.cdr import RUN_METADATA, RecordedFile
from mbd_sim.recordings.messages.states import Snapshot
from mbd_sim.simulation.run.simulation import BaseSimulation

# Increased whenever the equations are traced with other rounding errors. Recordings without this entry have the first.
FIRST_EQUATIONS, EQUATIONS = "1", "2"


def run_metadata(
    simulation: BaseSimulation, moment: Snapshot | None = None, parameters: Mapping[str, Any] | None = None
) -> dict[str, str]:
    """Return mechanism, method, step, the `Snapshot` at the first message, versions and host; numbers are hexadecimal.

    :param moment: by default the present state of the simulation, with ticks and clock at zero.
    :param parameters: those of the node.
    """
    mechanism = simulation.mechanism
    moment = moment or Snapshot(0, 0, simulation.time, simulation.snapshot())
    point = moment.point
    return {
        "mechanism": mechanism.name,
        "file": mechanism.source.file,
        "method": simulation.model.method_name,
        "step": simulation.step_size.hex(),
        "start": _exact(point.state),
        "inputs": _exact(point.inputs),
        "start_energy": float(point.start_energy).hex(),
        "first_tick": str(moment.ticks),
        "first_step": str(point.steps),
        "first_clock": str(moment.clock_ns),
        "wrenches": json.dumps(simulation.model.input_layout.loaded),
        "live": json.dumps({name: value.hex() for name, value in point.live.items()}),
        **({"samples": _exact_rows(point.samples)} if len(point.samples) else {}),
        **({"history": _exact(point.history)} if len(point.history) else {}),
        "coordinates": json.dumps(simulation.coordinate_names),
        "parameters": json.dumps(dict(parameters or {})),
        "mbd_sim": mbd_sim.__version__,
        "equations": EQUATIONS,
        **_host(),
        "started": datetime.now().astimezone().isoformat(timespec="milliseconds"),
    }


def _exact(values: Array) -> str:
    return json.dumps([value.hex() for value in values.tolist()])


def _exact_rows(rows: Array) -> str:
    return json.dumps([[value.hex() for value in row] for row in rows.tolist()])


@cache
def _host() -> Mapping[str, str]:
    import llvmlite.binding as llvm

    return {
        "python": platform.python_version(),
        "platform": platform.platform(),
        "processor": str(llvm.get_host_cpu_name()),
        **{name: _version(name) for name in ("casadi", "llvmlite", "numpy")},
    }


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "unknown"


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
            y=_read_exact(about["start"]),
            inputs=_read_exact(about["inputs"]) if "inputs" in about else None,
            start_energy=float.fromhex(about["start_energy"]) if "start_energy" in about else None,
            tick=tick,
            steps=int(about.get("first_step", tick)),
            clock_ns=int(about["first_clock"]) if "first_clock" in about else None,
            samples=_read_exact_rows(about["samples"]) if "samples" in about else None,
            history=_read_exact(about["history"]) if "history" in about else None,
            frame_prefix=str(json.loads(about.get("parameters", "{}")).get("frame_prefix", "")),
        )
    except (ValueError, TypeError, AttributeError, OverflowError) as error:
        raise RecomputeError(f"{file.path}: its metadata '{RUN_METADATA}' cannot be read ({error}).") from error


def _read_exact(text: str) -> Array:
    return np.array([float.fromhex(value) for value in json.loads(text)])


def _read_exact_rows(text: str) -> Array:
    rows = [[float.fromhex(value) for value in row] for row in json.loads(text)]
    return np.array(rows).reshape(len(rows), -1)
