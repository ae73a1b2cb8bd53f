"""Multibody mechanisms from a plain file: Lagrange's equations, compiled, in real time.

from mbd_sim import Simulation

sim = Simulation.from_file("double_rod")
sim.set_efforts({"elbow": 2.0})
sim.run(until=10.0)
print(sim.q, sim.energies.residual)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from mbd_sim.errors import CommandError, DivergedError, MbdSimError, MechanismError, Problem

if TYPE_CHECKING:
    from mbd_sim.load import load_mechanism, parse_mechanism
    from mbd_sim.mechanism.records import Mechanism
    from mbd_sim.simulation.compiled_model import Energies, Model
    from mbd_sim.simulation.ensemble import Ensemble
    from mbd_sim.simulation.simulation import Simulation

__version__ = "0.1.0"

__all__ = [
    "CommandError",
    "DivergedError",
    "Energies",
    "Ensemble",
    "MbdSimError",
    "Mechanism",
    "MechanismError",
    "Model",
    "Problem",
    "Simulation",
    "__version__",
    "load_mechanism",
    "parse_mechanism",
]

_LAZY = {
    "Energies": "mbd_sim.simulation.compiled_model",
    "Ensemble": "mbd_sim.simulation.ensemble",
    "Mechanism": "mbd_sim.mechanism.records",
    "Model": "mbd_sim.simulation.compiled_model",
    "Simulation": "mbd_sim.simulation.simulation",
    "load_mechanism": "mbd_sim.load",
    "parse_mechanism": "mbd_sim.load",
}


def __getattr__(name: str) -> Any:
    """Import what is asked for when it is asked for: `import mbd_sim` itself loads nothing heavy."""
    if name not in _LAZY:
        raise AttributeError(f"module 'mbd_sim' has no attribute '{name}'")
    import importlib

    return getattr(importlib.import_module(_LAZY[name]), name)
