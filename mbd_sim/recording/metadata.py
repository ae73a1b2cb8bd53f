"""What a recording says about the run besides its messages: all that is needed to compute it again."""

from __future__ import annotations

import json
import platform
from datetime import datetime
from importlib.metadata import PackageNotFoundError, version

import mbd_sim
from mbd_sim.mechanism.model import Array
from mbd_sim.simulation import Simulation


def run_metadata(
    simulation: Simulation, state: Array | None = None, inputs: Array | None = None, ticks: int = 0
) -> dict[str, str]:
    """Mechanism, method, step, start state and live values (hexadecimal, exact), versions and host."""
    mechanism = simulation.mechanism
    return {
        "mechanism": mechanism.name,
        "file": mechanism.source.file,
        "method": simulation.model.method.name,
        "step": simulation.step_size.hex(),
        "start": _exact(simulation.state if state is None else state),
        "inputs": _exact(simulation.inputs if inputs is None else inputs),
        "tick": str(ticks),
        "wrenches": json.dumps(simulation.model.equations.inputs.loaded),
        "live": json.dumps({name: value.hex() for name, value in simulation.live.items()}),
        "coordinates": json.dumps(simulation.coordinate_names),
        "mbd_sim": mbd_sim.__version__,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "processor": _processor(),
        **{name: _version(name) for name in ("casadi", "llvmlite", "numpy")},
        "started": datetime.now().astimezone().isoformat(timespec="milliseconds"),
    }


def _exact(values: Array) -> str:
    return json.dumps([value.hex() for value in values.tolist()])


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "unknown"


def _processor() -> str:
    import llvmlite.binding as llvm

    return str(llvm.get_host_cpu_name())
