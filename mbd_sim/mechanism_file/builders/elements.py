"""What a mechanism is built from: everything in a file, before the spanning tree is found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from mbd_sim.errors import Problem
from mbd_sim.geometry.pose import Pose
from mbd_sim.mechanism.records import Joint, Part

if TYPE_CHECKING:
    from mbd_sim.mechanism.actuators import Actuator
    from mbd_sim.mechanism.bases import Base
    from mbd_sim.mechanism.constraints import Constraint
    from mbd_sim.mechanism.contacts import Contact
    from mbd_sim.mechanism.force_elements import AppliedEffort, AppliedForce, AppliedPotential, Bushing, Damper, Spring
    from mbd_sim.mechanism.sensors import AnySensor


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
