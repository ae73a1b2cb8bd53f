"""The metadata of a recording: everything besides its messages that is needed to recompute the run."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping
from datetime import datetime
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import mbd_sim
from mbd_sim.geometry.pose import Array
from mbd_sim.messages.snapshot import Snapshot
from mbd_sim.simulation.simulation import Simulation

# Increased whenever the equations are traced with other rounding errors. Recordings without this entry have the first.
FIRST_EQUATIONS, EQUATIONS = "1", "2"


def run_metadata(
    simulation: Simulation, moment: Snapshot | None = None, parameters: Mapping[str, Any] | None = None
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
