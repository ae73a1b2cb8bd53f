"""The types of joints: the coordinates of each, and the conditions that it imposes where it closes a loop.

`JOINT_KINDS` is the only table of joint types. The motion of each type is in
`mbd_sim.dynamics.kinematics.joint_motions`, and its keys in a mechanism file are in `mbd_sim.files.schema.joints`.

Drives that take the motion of a joint from commands are plain records. Like actuators they take one command or several,
their channels.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, TypeVar

JointType = Literal[
    "revolute", "prismatic", "screw", "cylindrical", "universal", "planar", "spherical", "free", "fixed"
]
Direction = Literal["axis", "second", "third", "x", "y", "z"]
LoopCondition = Literal[
    "coincident points",
    "point on axis",
    "point in plane",
    "parallel axes",
    "equal orientations",
    "constant angle between axes",
    "advance by the lead",
]


@dataclass(frozen=True)
class JointCoordinate:
    """A degree of freedom of a joint: a rotation about a direction, or a translation along it.

    `label` follows the joint's name in the name of the coordinate. `direction` is a vector of the joint (see
    `Joint.direction`), in the axes of the parent-side frame, or of the child-side frame with `on_child`. A positive
    effort acts on the child along this direction.
    """

    label: str
    rotation: bool
    direction: Direction
    on_child: bool = False

    @property
    def unit(self) -> str:
        """The SI unit of the coordinate."""
        return "rad" if self.rotation else "m"

    @property
    def effort_unit(self) -> str:
        """The SI unit of its generalized force."""
        return "N·m" if self.rotation else "N"


@dataclass(frozen=True)
class JointKind:
    """The properties of a joint type.

    `coordinates` are its degrees of freedom in the order of the generalized speeds u. `loop_conditions` are
    imposed where it closes a loop (Nikravesh, sec. 7.2). `quaternion` is the index in q of the first
    component of a unit quaternion (w, x, y, z), which replaces three angles. An `axial` joint is the same joint with
    its axis reversed if its two parts are exchanged. `planar_freedoms` is the number of degrees of freedom in a
    planar mechanism, None for a joint that cannot be part of one.
    """

    coordinates: tuple[JointCoordinate, ...]
    loop_conditions: tuple[LoopCondition, ...]
    quaternion: int | None = None
    axial: bool = False
    planar_freedoms: int | None = None

    @property
    def nv(self) -> int:
        """The number of generalized speeds."""
        return len(self.coordinates)

    @property
    def nq(self) -> int:
        """The number of generalized coordinates q: a quaternion has one more than the speeds."""
        return self.nv + (self.quaternion is not None)

    @property
    def labels(self) -> tuple[str, ...]:
        """The suffixes that make the names of the coordinates from the joint's name."""
        return tuple(coordinate.label for coordinate in self.coordinates)

    @property
    def rotates(self) -> bool:
        """Whether a coordinate is a rotation."""
        return any(coordinate.rotation for coordinate in self.coordinates)

    @property
    def connects(self) -> bool:
        """Whether the joint moves and still restricts a motion: all but fixed and free joints."""
        return 0 < self.nv < 6

    @property
    def slides(self) -> bool:
        """Whether the joint is a slider: it allows a translation along an axis or in a plane."""
        return self.connects and any(not coordinate.rotation for coordinate in self.coordinates)

    @property
    def slides_along_axis(self) -> bool:
        """Whether a coordinate is the displacement along the axis."""
        return any(not coordinate.rotation and coordinate.direction == "axis" for coordinate in self.coordinates)

    @property
    def advances(self) -> bool:
        """Whether the joint moves along its axis in proportion to its rotation, by its lead."""
        return "advance by the lead" in self.loop_conditions

    @property
    def keeps_line(self) -> bool:
        """Whether the joint turns about a line that belongs to both parts."""
        conditions = self.loop_conditions
        return "parallel axes" in conditions and (self.keeps_point or "point on axis" in conditions)

    @property
    def keeps_point(self) -> bool:
        """Whether a point of one part stays at a point of the other."""
        return "coincident points" in self.loop_conditions


def _about(direction: Direction, label: str = "", on_child: bool = False) -> JointCoordinate:
    return JointCoordinate(label, True, direction, on_child)


def _along(direction: Direction, label: str = "") -> JointCoordinate:
    return JointCoordinate(label, False, direction)


_ROTATION_VECTOR = (_about("x", ".rx", True), _about("y", ".ry", True), _about("z", ".rz", True))

JOINT_KINDS: Mapping[JointType, JointKind] = {
    "revolute": JointKind((_about("axis"),), ("coincident points", "parallel axes"), axial=True, planar_freedoms=1),
    "prismatic": JointKind((_along("axis"),), ("point on axis", "equal orientations"), axial=True, planar_freedoms=1),
    "screw": JointKind((_about("axis"),), ("point on axis", "parallel axes", "advance by the lead"), axial=True),
    "cylindrical": JointKind(
        (_along("axis", ".displacement"), _about("axis", ".angle")), ("point on axis", "parallel axes"), axial=True
    ),
    # The first rotation carries the second axis along, which therefore does not move in the child.
    "universal": JointKind(
        (_about("axis", ".first"), _about("second", ".second", on_child=True)),
        ("coincident points", "constant angle between axes"),
    ),
    "planar": JointKind(
        (_along("second", ".x"), _along("third", ".y"), _about("axis", ".angle")),
        ("parallel axes", "point in plane"),
        planar_freedoms=3,
    ),
    "spherical": JointKind(_ROTATION_VECTOR, ("coincident points",), quaternion=0),
    "free": JointKind((_along("x", ".x"), _along("y", ".y"), _along("z", ".z"), *_ROTATION_VECTOR), (), quaternion=3),
    "fixed": JointKind((), ("coincident points", "equal orientations"), axial=True, planar_freedoms=0),
}


Number = TypeVar("Number")  # or a symbol
Channel = Literal["position", "velocity", "effort", "voltage", "current", "opening"]


def default_command(channel: Channel, position: Number) -> Number | float:
    """The command before the first one: the position at the start is held, everything else is zero."""
    return position if channel == "position" else 0.0


STATES = 3  # position, velocity and acceleration


@dataclass(frozen=True)
class CommandedDrive:
    """A drive whose motion follows commands of its position, or of its velocity, through a filter of third order.

    `name` is that of the joint, and `bandwidth` the slowest rate in 1/s: see `mbd_sim.dynamics.kinematics.drives`. The
    position stays between `lower` and `upper`, and the speed and the acceleration within their limits, whatever is
    commanded; in rad or m and s. `start` is the position at time zero.
    """

    name: str
    controls: Literal["position", "velocity"]
    bandwidth: float
    velocity_limit: float = math.inf
    acceleration_limit: float = math.inf
    lower: float = -math.inf
    upper: float = math.inf
    start: float = 0.0

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The commands that it takes, in their order among the inputs."""
        return ("position", "velocity") if self.controls == "position" else ("velocity",)
