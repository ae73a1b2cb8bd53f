"""The metadata of a recording: everything besides its messages that is needed to recompute the run."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

import mbd_sim
from mbd_sim.geometry.pose import Array
from mbd_sim.simulation.simulation import Simulation

# Increased whenever the equations are traced with other rounding errors. Recordings without this entry have the first.
FIRST_EQUATIONS, EQUATIONS = "1", "2"


@dataclass(frozen=True, slots=True)
class Moment:
    """Everything that the motion from a tick on depends on, besides later commands.

    `ticks` counts the steps since the node started, `steps` those since time zero of the mechanism; `clock_ns` is the
    node's simulated clock. `y` is the integrated state, `inputs` are those of the equations: efforts, wrenches and live
    values. `samples` are the states that sensors have measured, see `SensorSamples.table`;
    `history` is what the method keeps of earlier steps.
    """

    ticks: int
    clock_ns: int
    steps: int
    y: Array
    inputs: Array
    start_energy: float
    live: Mapping[str, float]
    samples: Array = field(default_factory=lambda: np.empty((0, 0)))
    history: Array = field(default_factory=lambda: np.empty(0))

    @classmethod
    def of(cls, simulation: Simulation, ticks: int = 0, clock_ns: int = 0) -> Moment:
        """Copy the present state of a simulation."""
        return cls(
            ticks,
            clock_ns,
            simulation.steps,
            simulation.state,
            simulation.inputs.copy(),
            simulation.start_energy,
            simulation.live,
            simulation.samples,
            simulation.history,
        )


def run_metadata(
    simulation: Simulation, moment: Moment | None = None, parameters: Mapping[str, Any] | None = None
) -> dict[str, str]:
    """Return mechanism, method, step, the `Moment` of the first message, versions and host; numbers are hexadecimal.

    :param moment: by default the present state of the simulation, with ticks and clock at zero.
    :param parameters: those of the node.
    """
    mechanism = simulation.mechanism
    moment = moment or Moment.of(simulation)
    return {
        "mechanism": mechanism.name,
        "file": mechanism.source.file,
        "method": simulation.model.method_name,
        "step": simulation.step_size.hex(),
        "start": _exact(moment.y),
        "inputs": _exact(moment.inputs),
        "start_energy": float(moment.start_energy).hex(),
        "first_tick": str(moment.ticks),
        "first_step": str(moment.steps),
        "first_clock": str(moment.clock_ns),
        "wrenches": json.dumps(simulation.model.input_layout.loaded),
        "live": json.dumps({name: value.hex() for name, value in moment.live.items()}),
        **({"samples": _exact_rows(moment.samples)} if len(moment.samples) else {}),
        **({"history": _exact(moment.history)} if len(moment.history) else {}),
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
