"""A mechanism as plain records, which the dynamics, the viewer and the exporters read.

Frames: every part has its own frame, in which its points, mass center and inertia are given. A `Pose` places one
frame in another: `x_outer = position + rotation @ x_inner`. SI units throughout.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, assert_never

import numpy as np

from mbd_sim.errors import counted, listed, quoted, shortened
from mbd_sim.geometry.batch import array
from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.geometry.rotation import aligning_z
from mbd_sim.mechanism.drives import CommandedDrive
from mbd_sim.mechanism.expression import TimeExpression
from mbd_sim.mechanism.joint_types import JOINT_KINDS, JointCoordinate, JointKind, JointType
from mbd_sim.mechanism.laws import ElasticLaw, Friction, PowerLaw, Varying
from mbd_sim.mechanism.source import Source
from mbd_sim.short_repr import LONGEST, short_repr

if TYPE_CHECKING:
    from mbd_sim.mechanism.actuators import Actuator
    from mbd_sim.mechanism.bases import Base
    from mbd_sim.mechanism.constraints import Constraint
    from mbd_sim.mechanism.contacts import Contact
    from mbd_sim.mechanism.force_elements import (
        AppliedEffort,
        AppliedForce,
        AppliedPotential,
        Bushing,
        Damper,
        ForceElement,
        Spring,
        TwoPointElement,
    )
    from mbd_sim.mechanism.sensors import AnySensor

GROUND = "ground"


@dataclass(frozen=True, eq=False)
class Shape:
    """A shape to draw: `kind` as in the file, centered on `pose`; rods and axial shapes are along z.

    `size` is (length, radius) for rods, (radius,) for discs, rings, spheres and particles, (x, y) for plates,
    (x, y, z) for blocks and (length, radius) for cylinders.
    """

    kind: str
    size: tuple[float, ...]
    pose: Pose
    color: str | None = None
    hole: bool = False

    __repr__ = short_repr


@dataclass(frozen=True, eq=False)
class Mesh:
    """A surface for other programs to draw: its URI, the pose of its origin, scale factors (3,) along its axes."""

    file: str
    pose: Pose
    scale: tuple[float, float, float]
    color: str | None = None


@dataclass(frozen=True, eq=False)
class Part:
    """A rigid body: `mass` in kg, `center` (3,) of mass and `inertia` (3, 3) about it, in the part's frame."""

    name: str
    mass: float
    center: Array
    inertia: Array
    points: Mapping[str, Pose] = field(default_factory=dict)
    shapes: tuple[Shape, ...] = ()
    meshes: tuple[Mesh, ...] = ()

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
    A joint that `splits` its outboard part closes a loop, but has coordinates: it carries a piece of that part, which
    is welded to the rest, see `Mechanism.bodies`.
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
    splits: bool = False
    compliance: float = 1.0

    def __repr__(self) -> str:
        return f"<Joint {self.name}: {self.type}, {self.parent} – {self.child}>"

    @property
    def kind(self) -> JointKind:
        """The properties of its type."""
        return JOINT_KINDS[self.type]

    @property
    def outboard_part(self) -> str:
        """The part on the far side of this joint, seen from ground through the spanning tree."""
        return self.parent if self.reversed else self.child

    @property
    def outboard(self) -> str:
        """The body that this joint adds to the spanning tree: the part on its far side, or a piece of that."""
        return f"{self.outboard_part}/{self.name}" if self.splits else self.outboard_part

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


@dataclass(frozen=True, eq=False)
class Attachment:
    """A point (3,) of a part, or of ground, in that part's frame."""

    part: str
    point: Array

    __repr__ = short_repr


@dataclass(frozen=True, eq=False)
class Mechanism:
    """A mechanism. `joints`, which form a tree, are in declared order, which is that of q, u and the efforts.

    `tree` has their names from ground outwards, those that split parts last. `closing` joints close loops;
    they have no coordinates. Contacts that approach more slowly than `rest_speed` in m/s or rad/s do not rebound.
    `sensor_seed` selects the noise of `sensors`. `moved` are the joints that differ from the file, see
    `mbd_sim.exact_geometry`.
    """

    name: str
    description: str
    parts: Mapping[str, Part]
    joints: Mapping[str, Joint]
    tree: tuple[str, ...]
    ground_points: Mapping[str, Pose]
    gravity: Array
    method: str
    step: float
    parameters: Mapping[str, float]
    source: Source
    springs: tuple[Spring, ...] = ()
    dampers: tuple[Damper, ...] = ()
    applied: tuple[AppliedForce, ...] = ()
    efforts: tuple[AppliedEffort, ...] = ()
    potentials: tuple[AppliedPotential, ...] = ()
    bushings: tuple[Bushing, ...] = ()
    closing: Mapping[str, Joint] = field(default_factory=dict)
    constraints: tuple[Constraint, ...] = ()
    contacts: tuple[Contact, ...] = ()
    actuators: tuple[Actuator, ...] = ()
    bases: tuple[Base, ...] = ()
    sensors: tuple[AnySensor, ...] = ()
    sensor_seed: int = 0
    rest_speed: float = 1e-5
    moved: Mapping[str, Move] = field(default_factory=dict)

    def __repr__(self) -> str:
        parts, joints = counted(len(self.parts), "part"), counted(len(self.all_joints), "joint")
        names = listed(list(self.coordinate_names), 6) or "none"
        return shortened(f"<Mechanism {self.name}: {parts}, {joints}; coordinates {names}>", LONGEST)

    @property
    def all_joints(self) -> Mapping[str, Joint]:
        """The joints of the tree, then those that close loops."""
        return {**self.joints, **self.closing}

    @property
    def bodies(self) -> Mapping[str, Part]:
        """What the joints of the tree carry: the parts, and those that joints split, in equal pieces."""
        pieces: dict[str, list[str]] = {}
        for joint in self.joints.values():
            if joint.splits:
                pieces.setdefault(joint.outboard_part, [joint.outboard_part]).append(joint.outboard)
        bodies = dict(self.parts)
        for part, names in pieces.items():
            whole = self.parts[part]
            mass, inertia = whole.mass / len(names), whole.inertia / len(names)
            bodies[part] = replace(whole, mass=mass, inertia=inertia)
            bodies |= {name: Part(name, mass, whole.center, inertia) for name in names[1:]}
        return bodies if pieces else self.parts

    @property
    def welds(self) -> Mapping[str, Joint]:
        """Fixed joints between split parts and their pieces, by the names of the joints that split them."""
        return {name: _weld(joint) for name, joint in self.joints.items() if joint.splits}

    @property
    def closures(self) -> Mapping[str, Joint]:
        """Everything that closes loops: the closing joints, and the welds of split parts."""
        return {**self.closing, **self.welds}

    @property
    def two_point_elements(self) -> tuple[TwoPointElement, ...]:
        """The force elements between two points: the springs, then the dampers."""
        return (*self.springs, *self.dampers)

    @property
    def force_elements(self) -> tuple[ForceElement, ...]:
        """All force elements by kind, with the bushings in joints."""
        return (*self.two_point_elements, *self.applied, *self.efforts, *self.potentials, *self.bushings)

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """A name for each generalized speed u, in order."""
        return tuple(name for joint in self.joints.values() for name in joint.coordinate_names)

    def coordinate(self, name: str) -> JointCoordinate:
        """The degree of freedom of a tree joint, driven or not, by its name, such as `base.x`."""
        joint = next(joint for joint in self.joints.values() if name in joint.motion_names)
        return joint.kind.coordinates[joint.motion_names.index(name)]

    @property
    def driven_names(self) -> tuple[str, ...]:
        """A name for each coordinate of the driven joints, in declared order."""
        return tuple(name for joint in self.joints.values() if joint.drive for name in joint.motion_names)

    @property
    def commanded(self) -> tuple[Actuator | CommandedDrive, ...]:
        """The actuators, then the drives that follow commands, in the order of their commands among the inputs."""
        drives = (joint.drive for joint in self.joints.values() if isinstance(joint.drive, CommandedDrive))
        return (*self.actuators, *drives)

    @property
    def mass(self) -> float:
        """The mass of all parts, kg."""
        return float(sum(part.mass for part in self.parts.values()))

    def tree_joints(self) -> Iterator[Joint]:
        """The joints of the tree from ground outwards."""
        return (self.joints[name] for name in self.tree)

    def effort_limits(self) -> Array:
        """The largest effort (nv,) of each degree of freedom in N or N·m, infinite if none is given."""
        limits = [
            np.inf if joint.effort_limit is None else joint.effort_limit
            for joint in self.joints.values()
            for _ in joint.coordinate_names
        ]
        found: Array = array(limits)
        return found


def _weld(joint: Joint) -> Joint:
    """The weld of the part that a joint splits, at the joint's frame there, with z along its axis."""
    pose = joint.parent_pose if joint.reversed else joint.child_pose
    if joint.axis.any():
        pose = Pose(pose.position, pose.rotation @ aligning_z(joint.axis))
    no_axis, none = np.zeros(3), np.zeros(0)
    ends = joint.outboard_part, joint.outboard
    return Joint(joint.name, "fixed", *ends, pose, pose, no_axis, no_axis, none, none, none, none, none)


def require_mechanism(given: object) -> Mechanism:
    """Return what was given if it is a mechanism.

    :raises TypeError: it is something else, such as the name of a file.
    """
    if isinstance(given, Mechanism):
        return given
    name = quoted(str(given)) if isinstance(given, str | Path) else "…"
    raise TypeError(f"{quoted(given)} is not a Mechanism. Load it from its file: load_mechanism({name}).")
