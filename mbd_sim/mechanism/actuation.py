"""The ranges of commands, and the ports and states of the actuators of a mechanism."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from mbd_sim.mechanism.elements.actuators import Actuator, CoordinatePort, LinePort
from mbd_sim.mechanism.elements.joint_types import CommandedDrive
from mbd_sim.mechanism.mechanism import Mechanism

if TYPE_CHECKING:
    from mbd_sim.mechanism.mechanism import Mechanism


def command_bounds(mechanism: Mechanism, taker: Actuator | CommandedDrive) -> Iterator[tuple[float, float]]:
    """The lower and the upper bound of each command of an actuator or a drive, infinite without a limit.

    Positions are bounded by the `limits` of a joint and velocities by its `velocity_limit`; for a drive, by its own.
    The first command of an actuator is bounded by its `command_range` as well.
    """
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
        if isinstance(taker, Actuator) and channel == taker.control:
            lower, upper = max(lower, -taker.output_limit), min(upper, taker.output_limit)
        yield lower, upper


def line_ports(mechanism: Mechanism) -> dict[str, LinePort]:
    """The lines along which actuators act, by the name of the actuator."""
    return {actuator.name: actuator.port for actuator in mechanism.actuators if isinstance(actuator.port, LinePort)}


def has_actuator_states(mechanism: Mechanism) -> bool:
    """Whether the motion depends on states of actuators: currents, pressures, integrals, or what a servo holds."""
    return any(actuator.has_states for actuator in mechanism.actuators)
