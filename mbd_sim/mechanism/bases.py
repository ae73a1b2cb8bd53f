"""Wheeled bases as plain records: the commands of wheels and steering joints for a velocity of the base.

The frame of a base has x forward, y to the left and its origin in the middle between the wheels, for a car in the
middle of the axle that is not steered. Rolling without slip (Siegwart, Nourbakhsh & Scaramuzza, sec. 3.2).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

from mbd_sim.errors import CommandError, listed
from mbd_sim.mechanism.channels import Channel

BaseType = Literal["differential", "mecanum", "car"]


class Velocity(NamedTuple):
    """The velocity of a base in its own frame, in m/s, and its yaw rate in rad/s."""

    x: float
    y: float
    yaw: float

    @classmethod
    def of(cls, linear: Sequence[float], angular: Sequence[float]) -> Velocity:
        """The velocity from all components (3,) in m/s and rad/s.

        :raises CommandError: one is not finite, or leads out of the plane.
        """
        if not all(map(math.isfinite, (*linear, *angular))):
            raise CommandError("the velocity is not finite", "Give finite numbers.")
        parts = {"linear.z": linear[2], "angular.x": angular[0], "angular.y": angular[1]}
        if wrong := [name for name, value in parts.items() if value]:
            raise CommandError(f"{listed(wrong)} would lead out of the plane of the base", "Set all of them to zero.")
        return cls(linear[0], linear[1], angular[2])


@dataclass(frozen=True)
class Wheel:
    """A wheel whose speed `taker` controls, an actuator or the joint of a drive.

    `rates` are the speeds of the wheel in rad/s for a `Velocity` of 1 in each component. Speeds up to `limit` can be
    commanded.
    """

    taker: str
    rates: tuple[float, float, float]
    limit: float = math.inf


@dataclass(frozen=True)
class Steering:
    """A joint that steers a wheel at x and y in m. Its angle, positive to the left, is that of `taker` times `sign`.

    It stays between `lower` and `upper` in rad.
    """

    taker: str
    x: float
    y: float
    sign: float = 1.0
    lower: float = -math.inf
    upper: float = math.inf


@dataclass(frozen=True, slots=True)
class BaseCommands:
    """Commands by taker and channel; `limited` if they are slower, or turn less, than was wanted."""

    takers: Mapping[str, Mapping[Channel, float]]
    limited: bool


@dataclass(frozen=True)
class Base:
    """A base on wheels; that of a car has `steering`."""

    name: str
    type: BaseType
    wheels: tuple[Wheel, ...]
    steering: tuple[Steering, ...] = ()

    def commands(self, wanted: Velocity) -> BaseCommands:
        """The commands with which the base moves with a velocity.

        Where a wheel would be too fast, all are slowed down alike; where a wheel cannot be steered that far, all are
        steered less.

        :raises CommandError: the base cannot move in this direction.
        """
        if wanted.y and self.type != "mecanum":
            raise CommandError(f"this base cannot move sideways, but linear.y is {wanted.y:g}", "Set it to zero.")
        takers: dict[str, dict[Channel, float]] = {}
        moved = wanted
        if self.steering and math.isfinite(wanted.yaw / (wanted.x or math.nan)):
            curvature = self._curvature(wanted.yaw / wanted.x)
            moved = Velocity(wanted.x, 0.0, wanted.x * curvature)
            for one in self.steering:
                angle = math.atan2(curvature * one.x, 1.0 - curvature * one.y)
                takers[one.taker] = {"position": one.sign * angle}
        elif self.steering and wanted.yaw:
            raise CommandError(
                f"a car cannot turn on the spot, but angular.z is {wanted.yaw:g}", "Set linear.x as well."
            )
        speeds = [sum(rate * part for rate, part in zip(wheel.rates, moved, strict=True)) for wheel in self.wheels]
        scale = min([1.0, *(wheel.limit / abs(v) for wheel, v in zip(self.wheels, speeds, strict=True) if v)])
        for wheel, speed in zip(self.wheels, speeds, strict=True):
            takers[wheel.taker] = {"velocity": speed * scale}
        return BaseCommands(takers, scale < 1.0 or (moved != wanted and not math.isclose(moved.yaw, wanted.yaw)))

    def _curvature(self, wanted: float) -> float:
        """The curvature in 1/m nearest to a wanted one at which all wheels can be steered."""
        for one in self.steering:
            for angle, nearest in ((one.lower, max), (one.upper, min)):
                if math.isfinite(angle):
                    slope = math.tan(angle)
                    wanted = nearest(wanted, slope / (one.x + one.y * slope))
        return wanted
