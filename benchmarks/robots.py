"""Real robots from the URDF files of the package `example-robot-data`, as mechanism files for the comparison.

Damping and friction of their joints are removed, because MuJoCo's friction is soft; meshes and shapes are left out. A
robot with a free base falls without contacts, and its joints start with random positions and speeds: at rest, nothing
but the base would move. Inertias that no rigid body can have are made those of a sphere with the same trace, because
MuJoCo refuses them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

import numpy as np

PACKAGE = "example-robot-data"
FOLDER = "cmeel.prefix/share/example-robot-data/robots"
POSITION, SPEED = 0.3, 1.0  # rad and rad/s, or m and m/s: the largest of the start
LEFT_OUT = {"damping", "friction", "limits", "effort_limit", "velocity_limit", "meshes", "shapes"}


@dataclass(frozen=True)
class Robot:
    """A URDF in `FOLDER`, and whether its root link is `fixed` or `free`."""

    file: str
    base: str


ROBOTS = {
    "UR5": Robot("ur_description/urdf/ur5_robot.urdf", "fixed"),
    "ANYmal": Robot("anymal_b_simple_description/robots/anymal.urdf", "free"),
    "Talos": Robot("talos_data/robots/talos_reduced.urdf", "free"),
}


def robot_text(name: str) -> str:
    """The mechanism file of a robot.

    :raises importlib.metadata.PackageNotFoundError: `example-robot-data` is not installed.
    """
    from mbd_sim import load_mechanism

    robot = ROBOTS[name]
    file = distribution(PACKAGE).locate_file(f"{FOLDER}/{robot.file}")
    return started(load_mechanism(str(file), base=robot.base).source.data)


def robots_folder() -> Path | None:
    """The folder of the URDF files, if their package is installed."""
    try:
        return Path(str(distribution(PACKAGE).locate_file(FOLDER)))
    except PackageNotFoundError:
        return None


def started(data: Mapping[str, Any]) -> str:
    """A mechanism file without `LEFT_OUT`, with random positions and speeds of its hinges and sliders."""
    from mbd_sim.files.text.yaml_text import yaml_text

    rng = np.random.default_rng(1)
    parts, joints = (
        {
            key: {name: value for name, value in entry.items() if name not in LEFT_OUT}
            for key, entry in data[kind].items()
        }
        for kind in ("parts", "joints")
    )
    for part in parts.values():
        if part.pop("inertia_check", True) is False:
            given = part["inertia"]
            moments = [given[name] for name in ("xx", "yy", "zz")] if isinstance(given, Mapping) else given
            part["inertia"] = [sum(moments) / 3.0] * 3
    for joint in joints.values():
        if joint["type"] in ("revolute", "prismatic"):
            position, speed = rng.uniform(-1.0, 1.0, 2).tolist()
            joint["position"], joint["velocity"] = round(POSITION * position, 3), round(SPEED * speed, 3)
    return yaml_text({**data, "parts": parts, "joints": joints})
