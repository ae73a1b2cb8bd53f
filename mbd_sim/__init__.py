"""Multibody mechanisms from a plain file: Lagrange's equations, compiled to machine code, in real time.

from mbd_sim import Simulation

sim = Simulation.from_file("double_rod")
sim.set_efforts({"elbow": 2.0})
sim.run(until=10.0)
print(sim.q, sim.energies.residual)

This page has the whole Python interface, apart from the learning environments in `mbd_sim.many.gym`:

- mechanisms: `load_mechanism`, `parse_mechanism`, `Mechanism`
- motion: `Simulation` and `Ensemble`, and what they return: `Energies`, `EnsembleEnergies`, `Violation`, `DriveState`,
  `Reaction`, `PartMotion`, `SensorReading`, `Pose`; the compiled equations without a state: `Model`
- pictures of a simulation's run, in notebooks and as files: `Simulation.plot`, `Simulation.animate`, `RunPicture`
- recordings of a simulation's run: `Simulation.recording`, `RunRecorder`
- analyses: `linearize`, `Linearization`, `modes`, `Mode`, `StateSpace`, `equilibrium`, `nearest_equilibrium`,
  `equilibria`, `Equilibrium`, `lqr`, `InverseDynamics`, `inertia_split`, `InertiaSplit`
- positions without masses: `Kinematics`, `inverse_kinematics`, `InverseKinematics`
- equations as formulas: `symbolic_equations`, `SymbolicEquations`, `to_latex`
- errors: `MbdSimError` and its subclasses
"""

from __future__ import annotations

import importlib
import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mbd_sim.analysis.equilibria.equilibrium import Equilibrium, equilibria, equilibrium, nearest_equilibrium
    from mbd_sim.analysis.linear.linearization import Linearization, Mode, linearize, modes
    from mbd_sim.analysis.linear.state_space import StateSpace, lqr
    from mbd_sim.analysis.mechanics.inverse_dynamics import InertiaSplit, InverseDynamics, inertia_split
    from mbd_sim.analysis.mechanics.inverse_kinematics import InverseKinematics, inverse_kinematics
    from mbd_sim.analysis.mechanics.kinematics import Kinematics
    from mbd_sim.base.errors import (
        CommandError,
        DivergedError,
        InputError,
        MbdSimError,
        MechanismError,
        NoInertiaError,
        Problem,
    )
    from mbd_sim.base.geometry.pose import Pose
    from mbd_sim.files.load import load_mechanism, parse_mechanism
    from mbd_sim.mechanism.mechanism import Mechanism
    from mbd_sim.notebook.runs import RunPicture
    from mbd_sim.notebook.simulation import Simulation
    from mbd_sim.recordings.run.run_recorder import RunRecorder
    from mbd_sim.simulation.ensemble.ensemble import Ensemble
    from mbd_sim.simulation.kernel.sensors import SensorReading
    from mbd_sim.simulation.model.model import Model
    from mbd_sim.simulation.model.state_records import (
        DriveState,
        Energies,
        EnsembleEnergies,
        PartMotion,
        Reaction,
        Violation,
    )
    from mbd_sim.studies.symbolic.equations import SymbolicEquations, symbolic_equations
    from mbd_sim.studies.symbolic.latex import to_latex

__version__ = "0.23.0"

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
    "InverseKinematics",
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
    "inverse_kinematics",
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
    "mbd_sim.analysis.equilibria.equilibrium": (
        "Equilibrium",
        "equilibria",
        "equilibrium",
        "nearest_equilibrium",
    ),
    "mbd_sim.analysis.mechanics.inverse_dynamics": (
        "InertiaSplit",
        "InverseDynamics",
        "inertia_split",
    ),
    "mbd_sim.analysis.mechanics.inverse_kinematics": ("InverseKinematics", "inverse_kinematics"),
    "mbd_sim.analysis.mechanics.kinematics": ("Kinematics",),
    "mbd_sim.analysis.linear.linearization": (
        "Linearization",
        "Mode",
        "linearize",
        "modes",
    ),
    "mbd_sim.analysis.linear.state_space": (
        "StateSpace",
        "lqr",
    ),
    "mbd_sim.base.errors": (
        "CommandError",
        "DivergedError",
        "InputError",
        "MbdSimError",
        "MechanismError",
        "NoInertiaError",
        "Problem",
    ),
    "mbd_sim.base.geometry.pose": ("Pose",),
    "mbd_sim.files.load": (
        "load_mechanism",
        "parse_mechanism",
    ),
    "mbd_sim.mechanism.mechanism": ("Mechanism",),
    "mbd_sim.notebook.runs": ("RunPicture",),
    "mbd_sim.recordings.run.run_recorder": ("RunRecorder",),
    "mbd_sim.simulation.model.model": ("Model",),
    "mbd_sim.simulation.ensemble.ensemble": ("Ensemble",),
    "mbd_sim.simulation.model.state_records": (
        "DriveState",
        "Energies",
        "EnsembleEnergies",
        "PartMotion",
        "Reaction",
        "Violation",
    ),
    "mbd_sim.simulation.kernel.sensors": ("SensorReading",),
    "mbd_sim.notebook.simulation": ("Simulation",),
    "mbd_sim.studies.symbolic": (
        "SymbolicEquations",
        "symbolic_equations",
        "to_latex",
    ),
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


if "IPython" in sys.modules and (_shell := sys.modules["IPython"].get_ipython()) is not None:
    from mbd_sim.notebook.formatters import register

    register(_shell.display_formatter.formatters)
