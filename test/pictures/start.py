"""Mechanisms at their start, for pictures: the poses of their parts, without machine code."""

from __future__ import annotations

import numpy as np

from mbd_sim.base.geometry.pose import Pose, unpack_poses
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.mechanism.mechanism import Mechanism


class AtStart:
    """Stands for a simulation that takes no step."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism

    @classmethod
    def from_file(cls, name: str) -> AtStart:
        return cls(load_mechanism(name))

    @classmethod
    def from_text(cls, text: str) -> AtStart:
        return cls(parse_mechanism(text))

    def poses(self) -> dict[str, Pose]:
        """The poses of the parts."""
        equations = derive(self.mechanism)
        rows = np.array(equations.poses(0.0, equations.start_state)).reshape(-1, 12)
        return {name: Pose(*pose) for name, *pose in zip(equations.part_names, *unpack_poses(rows), strict=True)}
