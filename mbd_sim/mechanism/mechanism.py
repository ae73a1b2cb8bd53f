"""A mechanism as one record, which the dynamics, the pictures and the exporters read."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mbd_sim.base.errors import counted, listed, quoted, shortened
from mbd_sim.base.geometry.batch import array
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.geometry.rotation import aligning_z
from mbd_sim.base.linear_algebra import added, product
from mbd_sim.base.short_repr import LONGEST
from mbd_sim.mechanism.elements.joint_types import CommandedDrive, JointCoordinate
from mbd_sim.mechanism.elements.parts import Joint, Part
from mbd_sim.mechanism.values.source import Source

if TYPE_CHECKING:
    from mbd_sim.mechanism.elements.actuators import Actuator, Base
    from mbd_sim.mechanism.elements.constraints import Constraint
    from mbd_sim.mechanism.elements.contacts import Contact
    from mbd_sim.mechanism.elements.forces import (
        AppliedEffort,
        AppliedForce,
        AppliedPotential,
        Bushing,
        Damper,
        ForceElement,
        Spring,
        TwoPointElement,
    )
    from mbd_sim.mechanism.elements.parts import Move
    from mbd_sim.mechanism.elements.sensors import AnySensor


@dataclass(frozen=True, eq=False)
class Mechanism:
    """A mechanism. `joints`, which form a tree, are in declared order, which is that of q, u and the efforts.

    `tree` has their names from ground outwards, those that split parts last. `closing` joints close loops;
    they have no coordinates. Contacts that approach more slowly than `rest_speed` in m/s or rad/s do not rebound.
    `sensor_seed` selects the noise of `sensors`. `moved` are the joints that differ from the file, see
    `mbd_sim.mechanism.exact_geometry`. `ranges` are the least and the greatest sensible value of parameters.
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
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)

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
        return float(added(part.mass for part in self.parts.values()))

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
        pose = Pose(pose.position, product(pose.rotation, aligning_z(joint.axis)))
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
