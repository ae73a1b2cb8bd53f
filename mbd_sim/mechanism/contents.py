"""What a mechanism contains: drives that follow commands, commands, one-sided elements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from mbd_sim.base.errors import MechanismError, Problem, listed
from mbd_sim.mechanism.elements.constraints import is_one_sided
from mbd_sim.mechanism.elements.joint_types import CommandedDrive

if TYPE_CHECKING:
    from mbd_sim.mechanism.mechanism import Mechanism
if TYPE_CHECKING:
    from mbd_sim.mechanism.elements.actuators import Actuator
    from mbd_sim.mechanism.elements.joint_types import CommandedDrive
if TYPE_CHECKING:
    from mbd_sim.mechanism.mechanism import Mechanism


def commanded_drives(mechanism: Mechanism) -> Mapping[str, CommandedDrive]:
    """The drives that follow commands, by the names of their joints, in the order of the file."""
    return {name: joint.drive for name, joint in mechanism.joints.items() if isinstance(joint.drive, CommandedDrive)}


def require_no_commanded_drives(mechanism: Mechanism, what: str) -> None:
    """Refuse what is possible only without drives that follow commands.

    :param what: that it is not possible, such as "cannot be printed".
    :raises MechanismError: their joints are named.
    """
    if names := list(commanded_drives(mechanism)):
        message = f"{mechanism.name} {what}, because drives follow commands: {listed(names)}"
        raise MechanismError([Problem(message, "Drive these joints by expressions of the time.")])


def channel_names(takers: Sequence[Actuator | CommandedDrive]) -> tuple[str, ...]:
    """All commands in their order, as `actuator.channel`; a drive has the name of its joint."""
    return tuple(f"{taker.name}.{channel}" for taker in takers for channel in taker.channels)


def require_two_sided(mechanism: Mechanism, what: str, remedy: str = "") -> None:
    """Refuse what is possible only without one-sided elements.

    :param what: that it is not possible, such as "cannot be linearized".
    :raises MechanismError: the elements are named.
    """
    if names := one_sided_names(mechanism):
        message = f"{mechanism.name} {what}, because it has one-sided elements: {listed(names)}"
        raise MechanismError([Problem(message, remedy or "Remove them, or make them two-sided.")])


def has_one_sided(mechanism: Mechanism) -> bool:
    """Whether a mechanism has gaps, sticking friction or clutches: then its motion has events."""
    return bool(one_sided_names(mechanism))


def one_sided_names(mechanism: Mechanism) -> tuple[str, ...]:
    """The one-sided elements as keys of the file, such as `joints.elbow.limits`: joints, constraints, contacts."""
    found = []
    for name, joint in mechanism.all_joints.items():
        if any(limits is not None and limits.restitution is not None for limits in joint.limits):
            found.append(f"joints.{name}.limits")
        if joint.friction is not None and joint.friction.sticks:
            found.append(f"joints.{name}.friction")
    found += [f"constraints.{constraint.name}" for constraint in mechanism.constraints if is_one_sided(constraint)]
    found += dict.fromkeys(f"contacts.{contact.name}" for contact in mechanism.contacts if contact.rigid)
    return tuple(found)
