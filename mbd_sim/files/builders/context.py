"""What all builders share: the context, in which problems are collected, and the elements of the mechanism.

The context has the points of the parts, the file for error messages, and the problems found so far. The elements are
everything in a file, before the spanning tree is found. Rotations as written in a file become rotation matrices here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from mbd_sim.base.errors import InputError, Problem, counted, listed, nearest, quoted
from mbd_sim.base.geometry.batch import array
from mbd_sim.base.geometry.pose import Pose
from mbd_sim.files.text.units import split_unit, unit_factor
from mbd_sim.mechanism.elements.actuators import Actuator, Base
from mbd_sim.mechanism.elements.constraints import Constraint
from mbd_sim.mechanism.elements.contacts import Contact
from mbd_sim.mechanism.elements.forces import AppliedEffort, AppliedForce, AppliedPotential, Bushing, Damper, Spring
from mbd_sim.mechanism.elements.joint_types import JointCoordinate
from mbd_sim.mechanism.elements.parts import Attachment, Joint, Part
from mbd_sim.mechanism.elements.sensors import AnySensor
from mbd_sim.mechanism.spanning_tree import PointsByPart, resolve_reference
from mbd_sim.mechanism.values.source import Location, Source, value_at


@dataclass
class BuildContext:
    """Resolves references and collects problems, each with its line in the file.

    `joints` are None for those whose own problem is reported already, and for all if the file has no readable ones.
    If not `complete`, the file has entries that were refused before.
    """

    points_by_part: PointsByPart
    source: Source
    problems: list[Problem] = field(default_factory=list)
    joints: Mapping[str, Joint | None] | None = None
    complete: bool = True

    def report(self, location: Location, message: str, remedy: str = "") -> None:
        """Add a problem at a location of the file."""
        self.problems.append(self.source.problem(location, message, remedy))

    def has_unit(self, location: Location, *si_units: str) -> bool:
        """Whether a value of the file that is written with a unit has one of the dimension of any of these SI units.

        Otherwise the problem is added. The schema cannot check it where the dimension depends on other keys.
        """
        data = value_at(self.source.data, location)
        errors = []
        for si_unit in si_units if isinstance(data, str) else ():
            try:
                if written := split_unit(data)[1]:
                    unit_factor(written, si_unit)
                return True
            except InputError as error:
                errors.append(InputError(error.message, error.remedy, data))
        self.problems += [self.source.problem_of(location, error) for error in errors[:1]]
        return not errors

    @cached_property
    def coordinates(self) -> dict[str, tuple[Joint, JointCoordinate]]:
        """The coordinates of the valid joints, with their joints, by name."""
        return {
            label: (joint, coordinate)
            for joint in self.valid_joints.values()
            for label, coordinate in zip(joint.motion_names, joint.kind.coordinates, strict=True)
        }

    @cached_property
    def valid_joints(self) -> dict[str, Joint]:
        """The joints that were built."""
        return {name: joint for name, joint in (self.joints or {}).items() if joint is not None}

    def coordinate(self, location: Location, reference: str) -> tuple[Joint, JointCoordinate] | None:
        """The joint coordinate that a reference names; None, with a problem, if there is none."""
        if reference in self.coordinates:
            return self.coordinates[reference]
        if reference in self.valid_joints:
            names = self.valid_joints[reference].motion_names
            remedy = f"Name one of them: {listed(list(names))}." if names else "Name a joint that moves."
            number = counted(len(names), "coordinate") if names else "no coordinates"
            self.report(location, f"{quoted(reference)} has {number}", remedy)
        else:
            self.require_joint(location, reference)
        return None

    def require_joint(self, location: Location, reference: str) -> None:
        """Report a reference that names neither a joint nor a coordinate, unless it may be one of a refused joint."""
        if self.joints is None or reference in self.joints or reference in self.coordinates:
            return
        if not any(joint is None and reference.startswith(f"{name}.") for name, joint in self.joints.items()):
            remedy = nearest(reference, self.coordinates or self.joints)
            self.report(location, f"there is no joint coordinate {quoted(reference)}", remedy)

    def frame(self, location: Location, reference: str) -> tuple[str, Pose] | None:
        """The part and the frame that a reference names; None, with a problem, if there are none."""
        try:
            return resolve_reference(reference, self.points_by_part)
        except InputError as error:
            self.problems.append(self.source.problem_of(location, error))
            return None

    def attachments(self, location: Location, references: list[str] | tuple[str, ...]) -> list[Attachment]:
        """The points that a list of references names; empty, with a problem, unless two different parts have them."""
        frames = [self.frame((*location, index), reference) for index, reference in enumerate(references)]
        return self.on_different_parts(location, frames)

    def on_different_parts(self, location: Location, frames: list[tuple[str, Pose] | None]) -> list[Attachment]:
        """The origins of frames; empty if one is missing, or, with a problem, if all belong to one part."""
        known = [frame for frame in frames if frame is not None]
        if len(known) < len(frames):
            return []
        if len({part for part, _ in known}) < 2:
            self.report(location, f"connects '{known[0][0]}' with itself", "Name points of different parts.")
            return []
        return [attachment(frame) for frame in known]


def attachment(frame: tuple[str, Pose]) -> Attachment:
    """The origin of a frame of a part."""
    part, pose = frame
    return Attachment(part, array(pose.position))


@dataclass(frozen=True)
class ForceElements:
    """The force elements of a mechanism by kind, without gravity and the springs and dampers in joints."""

    springs: tuple[Spring, ...] = ()
    dampers: tuple[Damper, ...] = ()
    applied: tuple[AppliedForce, ...] = ()
    efforts: tuple[AppliedEffort, ...] = ()
    potentials: tuple[AppliedPotential, ...] = ()
    bushings: tuple[Bushing, ...] = ()


@dataclass(frozen=True)
class MechanismElements:
    """Everything in a file, before the tree is found, and the problems of all of it."""

    parts: dict[str, Part]
    joints: dict[str, Joint]
    forces: ForceElements
    constraints: tuple[Constraint, ...]
    contacts: tuple[Contact, ...]
    actuators: tuple[Actuator, ...]
    sensors: tuple[AnySensor, ...]
    bases: tuple[Base, ...]
    joint_bushings: tuple[Bushing, ...]
    ground_points: dict[str, Pose]
    problems: list[Problem]
