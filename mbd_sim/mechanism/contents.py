"""What a mechanism contains: commands and their ranges, one-sided elements, actuators, expressions of forces."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, assert_never

from mbd_sim.base.errors import MechanismError, Problem, listed
from mbd_sim.mechanism.elements.constraints import Coupling, is_one_sided
from mbd_sim.mechanism.elements.forces import (
    AppliedEffort,
    AppliedForce,
    AppliedPotential,
    Bushing,
    Damper,
    ForceElement,
    Spring,
)
from mbd_sim.mechanism.elements.joint_types import CommandedDrive
from mbd_sim.mechanism.elements.parts import Joint
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.expression import TimeExpression
from mbd_sim.mechanism.values.laws import Expressed, Varying
from mbd_sim.mechanism.values.source import Location

if TYPE_CHECKING:  # few mechanisms have actuators
    from mbd_sim.mechanism.elements.actuators import Actuator, LinePort


def commanded_drives(mechanism: Mechanism) -> Mapping[str, CommandedDrive]:
    """The drives that follow commands, by the names of their joints, in the order of the file."""
    return {name: joint.drive for name, joint in mechanism.joints.items() if isinstance(joint.drive, CommandedDrive)}


def led_by_drives(mechanism: Mechanism) -> dict[str, str]:
    """The coordinates that couplings with driven ones prescribe, each with the coordinate that leads it."""
    exact = [one for one in mechanism.constraints if isinstance(one, Coupling) and not (one.play or one.bound)]
    prescribed, found = set(mechanism.driven_names), dict[str, str]()
    while exact:
        ends = [(one, [name for name in one.factors if name not in prescribed]) for one in exact]
        led = {names[0]: one for one, names in ends if len(names) == 1}
        if not led:
            break
        found |= {name: next((other for other in one.factors if other != name), "") for name, one in led.items()}
        prescribed |= led.keys()
        exact = [one for one, names in ends if len(names) > 1]
    return found


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


def command_bounds(mechanism: Mechanism, taker: Actuator | CommandedDrive) -> Iterator[tuple[float, float]]:
    """The lower and the upper bound of each command of an actuator or a drive, infinite without a limit.

    Positions are bounded by the `limits` of a joint and velocities by its `velocity_limit`; for a drive, by its own.
    The first command of an actuator is bounded by its `command_range` as well.
    """
    from mbd_sim.mechanism.elements.actuators import CoordinatePort

    position, speed = (-math.inf, math.inf), math.inf
    if isinstance(taker, CommandedDrive):
        position, speed = (taker.lower, taker.upper), taker.velocity_limit
    elif isinstance(taker.port, CoordinatePort):
        for joint in mechanism.joints.values():
            if taker.port.coordinate in joint.coordinate_names:
                limits = joint.limits_of(joint.coordinate_names.index(taker.port.coordinate))
                position = position if limits is None else (limits.lower, limits.upper)
                speed = math.inf if joint.velocity_limit is None else joint.velocity_limit
    own = (-math.inf, math.inf) if isinstance(taker, CommandedDrive) else taker.command_range
    for index, channel in enumerate(taker.channels):
        lower, upper = {"position": position, "velocity": (-speed, speed)}.get(channel, (-math.inf, math.inf))
        yield (max(lower, own[0]), min(upper, own[1])) if index == 0 else (lower, upper)


def action_bounds(mechanism: Mechanism, taker: Actuator | CommandedDrive) -> Iterator[tuple[float, float]]:
    """The command bounds within the range of what commands a motor or a valve: beyond it, commands have no effect."""
    for channel, bounds in zip(taker.channels, command_bounds(mechanism, taker), strict=True):
        lower, upper = bounds
        if not isinstance(taker, CommandedDrive) and channel == taker.control:
            lower, upper = max(lower, -taker.output_limit), min(upper, taker.output_limit)
        yield lower, upper


def line_ports(mechanism: Mechanism) -> dict[str, LinePort]:
    """The lines along which actuators act, by the name of the actuator."""
    from mbd_sim.mechanism.elements.actuators import LinePort

    return {actuator.name: actuator.port for actuator in mechanism.actuators if isinstance(actuator.port, LinePort)}


def has_actuator_states(mechanism: Mechanism) -> bool:
    """Whether the motion depends on states of actuators: currents, pressures, integrals, or what a servo holds."""
    return any(actuator.has_states for actuator in mechanism.actuators)


@dataclass(frozen=True, slots=True)
class ForceExpression:
    """An expression of a force, its location in the file, and the joint or spring of whose elongation it may be."""

    location: Location
    expression: TimeExpression
    stretched: Joint | Spring | None = None


def expressions_of_forces(mechanism: Mechanism) -> Iterator[ForceExpression]:
    """The expressions of the forces of a mechanism."""
    return force_expressions(mechanism.joints.values(), mechanism.force_elements)


def coordinates_acted_on(element: ForceElement) -> set[str]:
    """The joint coordinates along which a force element acts, or on which its force depends."""
    depended = {state.coordinate for one in force_expressions((), [element]) for state in one.expression.state}
    match element:
        case AppliedEffort(coordinate=coordinate):
            return depended | {coordinate}
        case AppliedPotential() | Spring() | Damper() | Bushing() | AppliedForce():
            return depended
        case _:
            assert_never(element)


def force_expressions(joints: Iterable[Joint], elements: Iterable[ForceElement]) -> Iterator[ForceExpression]:
    """The expressions of springs in joints, and of force elements."""
    for joint in joints:
        if isinstance(joint.spring, Expressed | Varying):
            yield ForceExpression(("joints", joint.name, "spring", "force"), joint.spring.force, joint)
    for element in elements:
        match element:
            case Spring(name=name, law=Expressed(force=force) | Varying(force=force)):
                yield ForceExpression(("forces", name, "force"), force, element)
            case AppliedForce(name=name, vector=vector):
                for index, expression in enumerate(vector):
                    yield ForceExpression(("forces", name, "vector", index), expression)
            case AppliedEffort(name=name, effort=effort):
                yield ForceExpression(("forces", name, "effort"), effort)
            case AppliedPotential(name=name, energy=energy):
                yield ForceExpression(("forces", name, "energy"), energy)
            case Spring() | Damper() | Bushing():
                pass
            case _:
                assert_never(element)
