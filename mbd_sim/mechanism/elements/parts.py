"""Parts, joints and points as plain records.

Frames: every part has its own frame, in which its points, mass center and inertia are given. A `Pose` places one
frame in another: `x_outer = position + rotation @ x_inner`. SI units throughout.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, assert_never

import numpy as np

from mbd_sim.base.errors import counted
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.short_repr import record
from mbd_sim.mechanism.elements.joint_types import JOINT_KINDS, CommandedDrive, JointCoordinate, JointKind, JointType
from mbd_sim.mechanism.outlines.pieces import Outline
from mbd_sim.mechanism.values.expression import TimeExpression
from mbd_sim.mechanism.values.laws import ElasticLaw, Friction, PowerLaw, Varying
from mbd_sim.mechanism.values.names import is_name

GROUND = "ground"


def is_frame_name(text: str) -> bool:
    """Whether a text can be the name of a part or a sensor, which is that of a frame too: without a slash in front."""
    return is_name(text) and not text.startswith("/") and text != GROUND


ShapeKind = Literal[
    "rod", "particle", "disc", "ring", "plate", "block", "cylinder", "cone", "capsule", "sphere", "ellipsoid", "hull",
    "outline",
]  # fmt: skip


MOST_CORNERS = 100  # of a hull


@dataclass(frozen=True)
class Polyhedron:
    """A convex polyhedron: its `corners` in m, and its `faces` as places in these, counterclockwise from outside."""

    corners: tuple[tuple[float, float, float], ...]
    faces: tuple[tuple[int, ...], ...]


@record
class Shape:
    """A shape to draw: `kind` as in the file, its box centered on `pose`; rods and axial shapes are along z.

    `size` is (length, radius) for rods, cylinders, cones and capsules, (radius,) for discs, rings, spheres and
    particles, (x, y) for plates, (x, y, z) for blocks and the radii of ellipsoids, and empty for a hull, of which the
    corners of `hull` are in the frame of `pose`; an `outline` in its x-y plane has the size (thickness,).
    """

    kind: ShapeKind
    size: tuple[float, ...]
    pose: Pose
    color: str | None = None
    hole: bool = False
    hull: Polyhedron | None = None
    name: str | None = None
    outline: Outline | None = None


@dataclass(frozen=True, eq=False)
class Mesh:
    """A surface for other programs to draw: its URI, the pose of its origin, scale factors (3,) along its axes."""

    file: str
    pose: Pose
    scale: tuple[float, float, float]
    color: str | None = None


@dataclass(frozen=True, eq=False)
class Part:
    """A rigid body: `mass` in kg, `center` (3,) of mass and `inertia` (3, 3) about it, in the part's frame.

    `collisions` are the shapes that can touch others, if these are not the `shapes`, which are drawn.
    """

    name: str
    mass: float
    center: Array
    inertia: Array
    points: Mapping[str, Pose] = field(default_factory=dict)
    shapes: tuple[Shape, ...] = ()
    meshes: tuple[Mesh, ...] = ()
    collisions: tuple[Shape, ...] | None = None

    @property
    def touching(self) -> tuple[Shape, ...]:
        """The shapes that can touch others."""
        return self.shapes if self.collisions is None else self.collisions

    def __repr__(self) -> str:
        return f"<Part {self.name}: {self.mass:g} kg, {counted(len(self.points), 'point')}>"


@dataclass(frozen=True)
class Limits:
    """The range of a joint coordinate; `stiffness` k is None if the limits are only passed on to URDF.

    A stop pushes back with k δ (1 + c δ') at the depth δ beyond it, never less than 0; `damping` c is in s/rad or s/m.
    With a `restitution` the stops are rigid.
    """

    lower: float
    upper: float
    stiffness: float | None = None
    damping: float = 0.0
    restitution: float | None = None


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint: the motion of `child` relative to `parent`, between the frames `parent_pose` and `child_pose`.

    `axis` and `second` (3,) are unit vectors in the parent-side frame, or zero: the axis, a universal joint's
    second axis, a planar joint's x direction. `position` and `velocity` are start values of the joint's q and u; a
    spherical or free joint has its unit quaternion (w, x, y, z) and its angular velocity (3,) in the child's axes
    there, a free one after its position and velocity (3,) in the parent-side frame. `stiffness`, `rest` and
    `damping` have a value for each degree of freedom. A joint with a `drive` has none: its coordinates are these
    expressions of time, or follow commands. `limits` have an entry for each coordinate, or none at all. A `spring` law
    takes the elongation q - rest, the laws `damper` and `friction` the speed; only revolute and prismatic joints have
    them. A `reversed` joint leads from child to parent in the spanning tree. `velocity_limit` is not simulated, only
    passed on to URDF.
    A joint with a `piece` splits its outboard part: it closes a loop, but has coordinates, and carries this piece of
    that part, which is welded to the rest, see `Mechanism.bodies`.
    `fixed_in_assembly` and `fixed_speeds` (nv,) mark start values that the assembly of loops must not change. A joint
    with `cut` closes a loop. Redundant joints share the load in inverse proportion to their relative `compliance`.
    """

    name: str
    type: JointType
    parent: str
    child: str
    parent_pose: Pose
    child_pose: Pose
    axis: Array
    second: Array
    position: Array
    velocity: Array
    stiffness: Array
    rest: Array
    damping: Array
    lead: float = 0.0
    drive: tuple[TimeExpression, ...] | CommandedDrive = ()
    limits: tuple[Limits | None, ...] = ()
    effort_limit: float | None = None
    velocity_limit: float | None = None
    spring: ElasticLaw | Varying | None = None
    damper: PowerLaw | None = None
    friction: Friction | None = None
    fixed_in_assembly: tuple[bool, ...] = ()
    fixed_speeds: tuple[bool, ...] = ()
    cut: bool = False
    reversed: bool = False
    piece: str = ""
    compliance: float = 1.0

    def __repr__(self) -> str:
        return f"<Joint {self.name}: {self.type}, {self.parent} – {self.child}>"

    @property
    def kind(self) -> JointKind:
        """The properties of its type."""
        return JOINT_KINDS[self.type]

    @property
    def travel(self) -> float:
        """The displacement along its axis for a rotation of 1 rad about it, m: 0, but for a screw."""
        return self.lead / (2.0 * np.pi) if self.kind.advances else 0.0

    @property
    def splits(self) -> bool:
        """Whether the joint carries a piece of a part."""
        return bool(self.piece)

    @property
    def outboard_part(self) -> str:
        """The part on the far side of this joint, seen from ground through the spanning tree."""
        return self.parent if self.reversed else self.child

    @property
    def outboard(self) -> str:
        """The body that this joint adds to the spanning tree: the part on its far side, or a piece of that."""
        return self.piece or self.outboard_part

    @property
    def inboard(self) -> str:
        """The part of the spanning tree that this joint starts from."""
        return self.child if self.reversed else self.parent

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """A name for each degree of freedom, in the order of the generalized speeds u."""
        return () if self.drive else self.motion_names

    def limits_of(self, coordinate: int) -> Limits | None:
        """The range of a coordinate, by its index."""
        return self.limits[coordinate] if self.limits else None

    @property
    def motion_names(self) -> tuple[str, ...]:
        """A name for each coordinate of the joint, also of a driven joint."""
        return tuple(f"{self.name}{label}" for label in self.kind.labels)

    def direction(self, coordinate: JointCoordinate) -> Array:
        """The direction (3,) about or along which a coordinate moves, in the frame that the coordinate names."""
        match coordinate.direction:
            case "axis":
                return self.axis
            case "second":
                return self.second
            case "third":
                return np.asarray(np.cross(self.axis, self.second))
            case "x" | "y" | "z" as letter:
                return np.asarray(np.eye(3)["xyz".index(letter)])
            case _:
                assert_never(coordinate.direction)


@dataclass(frozen=True)
class Move:
    """By how much the frames of a joint were moved at most, so that its loops are exact: in m and in rad."""

    distance: float
    angle: float

    def exceeds(self, other: Move) -> bool:
        """Whether it is longer or turns by more than another one."""
        return self.distance > other.distance or self.angle > other.angle


@record
class Attachment:
    """A point (3,) of a part, or of ground, in that part's frame."""

    part: str
    point: Array


@record
class PartFrame:
    """A frame of a part, or of ground: its `pose` in that part's frame."""

    part: str
    pose: Pose

    @property
    def is_of_part(self) -> bool:
        """Whether it is the part's own frame."""
        return not np.any(self.pose.position) and bool(np.all(self.pose.rotation == np.eye(3)))
