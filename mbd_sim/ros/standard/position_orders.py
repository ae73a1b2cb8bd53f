"""What a node and the process of its searches exchange; neither what computes nor ROS is imported for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from mbd_sim.base.geometry.pose import Array


@dataclass(frozen=True, eq=False)
class PositionSearch:
    """What to search for: coordinates with which a frame, which is a part or `part.point`, is at the target.

    The search begins at `seed`, positions by name, and otherwise at q (nq,). The target is given in ground's frame, or
    in that of the part `relative_to` where it is at the beginning; without a `rotation` (3, 3) any one will do. `limit`
    is in s; `time` in s is that of drives.
    """

    frame: str
    position: Array
    rotation: Array | None
    relative_to: str | None
    q: Array
    seed: Mapping[str, float]
    time: float
    limit: float


@dataclass(frozen=True, eq=False)
class PositionAnswer:
    """The `outcome` as a name among MoveItErrorCodes, and a sentence about it.

    `positions` are those by name, as of `Kinematics.positions`, and `joint_poses` the positions and quaternions
    (w, x, y, z) of free and spherical joints by name (7,). Both are empty where a request cannot be searched for.
    """

    outcome: str
    text: str = ""
    positions: Mapping[str, float] = field(default_factory=dict)
    joint_poses: Mapping[str, Array] = field(default_factory=dict)
