"""The reference of the Python interface: every public name, by group, from its docstring and types."""

from __future__ import annotations

import importlib
import inspect

import mbd_sim

GROUPS = {
    "Mechanisms": ("load_mechanism", "parse_mechanism", "Mechanism"),
    "Simulation": ("Simulation", "Model", "Energies", "Violation", "DriveState", "Reaction", "PartMotion", "SensorReading", "Pose"),
    "Recordings and pictures": ("RunRecorder", "RunPicture"),
    "Many simulations": ("Ensemble", "EnsembleEnergies"),
    "Analyses": (
        "linearize", "Linearization", "StateSpace", "modes", "Mode", "equilibrium", "nearest_equilibrium", "equilibria",
        "Equilibrium", "lqr", "InverseDynamics", "inertia_split", "InertiaSplit",
    ),
    "Positions without masses": ("Kinematics", "inverse_kinematics", "InverseKinematics"),
    "Equations as formulas": ("symbolic_equations", "SymbolicEquations", "to_latex"),
    "Errors": ("MbdSimError", "MechanismError", "CommandError", "DivergedError", "InputError", "NoInertiaError", "Problem"),
}  # fmt: skip
PACKAGES = {
    "Learning environments": "mbd_sim.many.gym",
    "Kinematic analysis": "mbd_sim.studies.kinematic_analysis",
    "Synthesis of linkages": "mbd_sim.studies.synthesis",
    "Linkages for poses": "mbd_sim.studies.synthesis.linkages",
    "Plane motion": "mbd_sim.studies.plane_motion",
    "Linear analysis": "mbd_sim.studies.linear_analysis",
    "Optimization": "mbd_sim.studies.optimization",
}
INDEX = """# Python

The public interface is in `mbd_sim`; what one task needs is in packages of their own, such as `mbd_sim.many.gym` and `mbd_sim.studies.kinematic_analysis`.
Units are SI and vectors have three components
in the axes of ground unless the text says otherwise. No page of it needs ROS.
"""


def pages() -> dict[str, str]:
    """The pages by their names in `docs/generated/`.

    :raises ValueError: a public name is in no group, or a name of a group is not public.
    """
    public, grouped = set(mbd_sim.__all__) - {"__version__"}, {name for names in GROUPS.values() for name in names}
    if public != grouped:
        raise ValueError(f"list in GROUPS of {__file__}, or remove from it: {sorted(public ^ grouped)}")
    written = {f"python/{_file(group)}.md": _page(group, "mbd_sim", names) for group, names in GROUPS.items()}
    for group, package in PACKAGES.items():
        names = tuple(importlib.import_module(package).__all__)
        written[f"python/{_file(group)}.md"] = _page(
            group, package, tuple(n for n in names if n[0].isalpha() and not n.isupper())
        )
    names = "\n".join(path.removeprefix("python/").removesuffix(".md") for path in written)
    return {"python/index.md": f"{INDEX}\n```{{toctree}}\n:maxdepth: 2\n\n{names}\n```\n", **written}


def _file(group: str) -> str:
    return group.lower().replace(" ", "_")


def _page(group: str, package: str, names: tuple[str, ...]) -> str:
    return "\n".join([f"# {group}\n", *(_entry(package, name) for name in names)])


def _entry(package: str, name: str) -> str:
    thing = getattr(__import__(package, fromlist=[name]), name)
    if not inspect.isclass(thing):
        return f"## {name}\n\n```{{eval-rst}}\n.. autofunction:: {package}.{name}\n```\n"
    options = (
        [":show-inheritance:"]
        if issubclass(thing, Exception)
        else [":members:", ":inherited-members: Env, VectorEnv, tuple"]
    )
    return "\n".join(
        [f"## {name}\n", "```{eval-rst}", f".. autoclass:: {package}.{name}", *(f"   {o}" for o in options), "```\n"]
    )
