"""The ranges of joints, which bound commanded positions and velocities. Independent of ROS."""

from __future__ import annotations

import numpy as np

from mbd_sim.errors import CommandError
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.channels import Channel
from mbd_sim.mechanism.command_bounds import command_bounds
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.ros.joint_curve import JointCurve


class CommandRanges:
    """The `lower` and `upper` bound (n,) of each command of actuators and drives, infinite without a limit.

    Positions are bounded by the `limits` of a joint and velocities by its `velocity_limit`, with their live values; for
    a drive, by those of the drive.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        found = [bounds for taker in mechanism.commanded for bounds in command_bounds(mechanism, taker)]
        self.lower, self.upper = np.array(found, dtype=float).reshape(-1, 2).T
        names = [(taker.name, channel) for taker in mechanism.commanded for channel in taker.channels]
        self._index = {name: index for index, name in enumerate(names)}

    def clamped(self, commands: Array) -> Array:
        """Commands (n,) within their bounds; nan stays."""
        return np.clip(commands, self.lower, self.upper)

    def exceeded(self, commands: Array) -> bool:
        """Whether one of the commands (n,) is out of its bounds."""
        return bool(np.any((commands < self.lower) | (commands > self.upper)))

    def require(self, taker: str, joint: str, curve: JointCurve) -> None:
        """Refuse a trajectory with a point out of bounds.

        :raises CommandError: it names the point.
        """
        for number, point in enumerate(curve.points, start=1):
            values: tuple[tuple[Channel, float | None], ...] = (
                ("position", point.position),
                ("velocity", point.velocity),
            )
            for channel, value in values:
                index = self._index[taker, channel]
                lower, upper = float(self.lower[index]), float(self.upper[index])
                if value is not None and not lower <= value <= upper:
                    raise CommandError(
                        (
                            f"the {channel} {value:.6g} of '{joint}' at point {number} is beyond the limits of the "
                            f"joint, {lower:.6g} to {upper:.6g}"
                        ),
                        "Stay within them.",
                    )
