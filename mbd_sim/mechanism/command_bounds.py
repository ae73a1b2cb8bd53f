"""The ranges of joints, which bound commanded positions and velocities."""

from __future__ import annotations

import math
from collections.abc import Iterator

from mbd_sim.mechanism.actuators import Actuator, CoordinatePort
from mbd_sim.mechanism.drives import CommandedDrive
from mbd_sim.mechanism.records import Mechanism


def command_bounds(mechanism: Mechanism, taker: Actuator | CommandedDrive) -> Iterator[tuple[float, float]]:
    """The lower and the upper bound of each command of an actuator or a drive, infinite without a limit.

    Positions are bounded by the `limits` of a joint and velocities by its `velocity_limit`; for a drive, by its own.
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
    for channel in taker.channels:
        yield {"position": position, "velocity": (-speed, speed)}.get(channel, (-math.inf, math.inf))


def action_bounds(mechanism: Mechanism, taker: Actuator | CommandedDrive) -> Iterator[tuple[float, float]]:
    """The same, with the range of what commands a motor or a valve: beyond it, commands have no further effect."""
    for channel, bounds in zip(taker.channels, command_bounds(mechanism, taker), strict=True):
        if isinstance(taker, Actuator) and channel == taker.control:
            yield -taker.output_limit, taker.output_limit
        else:
            yield bounds
