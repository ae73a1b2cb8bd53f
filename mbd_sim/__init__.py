"""Multibody mechanisms from a plain file: Lagrange's equations, compiled to machine code, in real time.

from mbd_sim import Simulation

sim = Simulation.from_file("double_rod")
sim.set_efforts({"elbow": 2.0})
sim.run(until=10.0)
print(sim.q, sim.energies.residual)

This page has the whole Python interface, apart from the learning environments in `mbd_sim.gym`:

- mechanisms: `load_mechanism`, `parse_mechanism`, `Mechanism`
- motion: `Simulation` and `Ensemble`, and what they return: `Energies`, `EnsembleEnergies`, `Violation`, `DriveState`,
  `Reaction`, `PartMotion`, `SensorReading`, `Pose`; the compiled equations without a state: `Model`
- pictures of a simulation's run, in notebooks and as files: `Simulation.plot`, `Simulation.animate`, `RunPicture`
- recordings of a simulation's run: `Simulation.recording`, `RunRecorder`
- analyses: `linearize`, `Linearization`, `modes`, `Mode`, `StateSpace`, `equilibrium`, `nearest_equilibrium`,
  `equilibria`, `Equilibrium`, `lqr`, `InverseDynamics`, `inertia_split`, `InertiaSplit`
- positions without masses: `Kinematics`
- equations as formulas: `symbolic_equations`, `SymbolicEquations`, `to_latex`
- errors: `MbdSimError` and its subclasses
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mbd_sim.analysis.equilibrium import Equilibrium, equilibria, equilibrium, nearest_equilibrium
    from mbd_sim.analysis.inertia_split import InertiaSplit, inertia_split
    from mbd_sim.analysis.inverse_dynamics import InverseDynamics
    from mbd_sim.analysis.kinematics import Kinematics
    from mbd_sim.analysis.linearization import Linearization, Mode, linearize, modes
    from mbd_sim.analysis.regulator import lqr
    from mbd_sim.analysis.state_space import StateSpace
    from mbd_sim.errors import (
        CommandError,
        DivergedError,
        InputError,
        MbdSimError,
        MechanismError,
        NoInertiaError,
        Problem,
    )
    from mbd_sim.geometry.pose import Pose
    from mbd_sim.load import load_mechanism, parse_mechanism
    from mbd_sim.mechanism.records import Mechanism
    from mbd_sim.notebook.runs import RunPicture
    from mbd_sim.notebook.simulation import Simulation
    from mbd_sim.recording.run_recorder import RunRecorder
    from mbd_sim.simulation.compiled_model import Model
    from mbd_sim.simulation.ensemble import Ensemble
    from mbd_sim.simulation.motions import PartMotion
    from mbd_sim.simulation.sensor_model import SensorReading
    from mbd_sim.simulation.state_records import DriveState, Energies, EnsembleEnergies, Reaction, Violation
    from mbd_sim.symbolic import SymbolicEquations, symbolic_equations, to_latex

__version__ = "0.4.0"

__all__ = [
    "CommandError",
    "DivergedError",
    "DriveState",
    "Energies",
    "Ensemble",
    "EnsembleEnergies",
    "Equilibrium",
    "InertiaSplit",
    "InputError",
    "InverseDynamics",
    "Kinematics",
    "Linearization",
    "MbdSimError",
    "Mechanism",
    "MechanismError",
    "Mode",
    "Model",
    "NoInertiaError",
    "PartMotion",
    "Pose",
    "Problem",
    "Reaction",
    "RunPicture",
    "RunRecorder",
    "SensorReading",
    "Simulation",
    "StateSpace",
    "SymbolicEquations",
    "Violation",
    "__version__",
    "equilibria",
    "equilibrium",
    "inertia_split",
    "linearize",
    "load_mechanism",
    "lqr",
    "modes",
    "nearest_equilibrium",
    "parse_mechanism",
    "symbolic_equations",
    "to_latex",
]

_MODULES = {
    "mbd_sim.analysis.equilibrium": ("Equilibrium", "equilibria", "equilibrium", "nearest_equilibrium"),
    "mbd_sim.analysis.inertia_split": ("InertiaSplit", "inertia_split"),
    "mbd_sim.analysis.inverse_dynamics": ("InverseDynamics",),
    "mbd_sim.analysis.kinematics": ("Kinematics",),
    "mbd_sim.analysis.linearization": ("Linearization", "Mode", "linearize", "modes"),
    "mbd_sim.analysis.regulator": ("lqr",),
    "mbd_sim.analysis.state_space": ("StateSpace",),
    "mbd_sim.errors": (
        "CommandError",
        "DivergedError",
        "InputError",
        "MbdSimError",
        "MechanismError",
        "NoInertiaError",
        "Problem",
    ),
    "mbd_sim.geometry.pose": ("Pose",),
    "mbd_sim.load": ("load_mechanism", "parse_mechanism"),
    "mbd_sim.mechanism.records": ("Mechanism",),
    "mbd_sim.notebook.runs": ("RunPicture",),
    "mbd_sim.recording.run_recorder": ("RunRecorder",),
    "mbd_sim.simulation.compiled_model": ("Model",),
    "mbd_sim.simulation.ensemble": ("Ensemble",),
    "mbd_sim.simulation.motions": ("PartMotion",),
    "mbd_sim.simulation.sensor_model": ("SensorReading",),
    "mbd_sim.notebook.simulation": ("Simulation",),
    "mbd_sim.simulation.state_records": ("DriveState", "Energies", "EnsembleEnergies", "Reaction", "Violation"),
    "mbd_sim.symbolic": ("SymbolicEquations", "symbolic_equations", "to_latex"),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used: `import mbd_sim` alone loads nothing heavy."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'mbd_sim' has no attribute '{name}'")
    found = globals()[name] = getattr(importlib.import_module(_MODULE_OF[name]), name)
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *_MODULE_OF})
