"""Builds the wheeled bases of a mechanism from their records in the file."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import assert_never

from mbd_sim.errors import nearest
from mbd_sim.mechanism.actuators import Actuator, CoordinatePort
from mbd_sim.mechanism.bases import Base, Steering, Wheel
from mbd_sim.mechanism.drives import CommandedDrive
from mbd_sim.mechanism.records import Joint
from mbd_sim.mechanism.source import Location
from mbd_sim.mechanism_file.builders.build_context import BuildContext
from mbd_sim.mechanism_file.schema import wheeled_base_schema as schema

VELOCITY_REMEDY = "Give the joint an actuator with a velocity servo, or 'drive: {command: velocity, …}'."
POSITION_REMEDY = "Give the joint an actuator with a position servo, or 'drive: {command: position, …}'."


def build_bases(
    specs: Mapping[str, schema.AnyBaseSpec],
    joints: Mapping[str, Joint],
    actuators: Sequence[Actuator],
    context: BuildContext,
) -> tuple[Base, ...]:
    """The bases of a file; mistakes are reported to `context`."""
    builder = _BaseBuilder(joints, actuators, context)
    bases = tuple(builder.base(name, spec) for name, spec in specs.items())
    _require_own_joints(bases, context)
    return bases


def _require_own_joints(bases: Sequence[Base], context: BuildContext) -> None:
    owners: dict[str, str] = {}
    for base in bases:
        for taker in (*(wheel.taker for wheel in base.wheels), *(one.taker for one in base.steering)):
            if (owner := owners.setdefault(taker, base.name)) != base.name:
                message = f"'{taker}' belongs to the base '{owner}' as well"
                context.report(("bases", base.name), message, "Name each wheel in one base.")


@dataclass(frozen=True, eq=False)
class _BaseBuilder:
    joints: Mapping[str, Joint]
    actuators: Sequence[Actuator]
    context: BuildContext

    def base(self, name: str, spec: schema.AnyBaseSpec) -> Base:
        where: Location = ("bases", name)
        wheels, steering = [], []
        for keys, joint, rates in _wheels(spec):
            if (taker := self._taker((*where, *keys), joint, "velocity")) is not None:
                sign = -1.0 if joint in spec.reversed else 1.0
                x, y, yaw = (sign * rate / spec.radius for rate in rates)
                wheels.append(Wheel(taker, (x, y, yaw), self._speed_limit(joint)))
        if isinstance(spec, schema.CarBaseSpec):
            steering = [*self._steering(where, spec)]
        named = {joint for _, joint, _ in _wheels(spec)} | {*getattr(spec, "steering", ())}
        for index, joint in enumerate(spec.reversed):
            if joint not in named:
                self.context.report((*where, "reversed", index), f"'{joint}' is no wheel of it", nearest(joint, named))
        repeated = [joint for _, joint, _ in _wheels(spec)]
        if len(set(repeated)) < len(repeated):
            self.context.report(where, "a wheel is named twice", "Name each wheel once.")
        return Base(name, spec.type, tuple(wheels), tuple(steering))

    def _steering(self, where: Location, spec: schema.CarBaseSpec) -> Iterator[Steering]:
        if len(spec.steering) > 2:
            message = f"names {len(spec.steering)} joints"
            self.context.report((*where, "steering"), message, "Name one in the middle, or the left and the right one.")
        sides = (0.0,) if len(spec.steering) == 1 else (0.5 * spec.track, -0.5 * spec.track)
        for index, (joint, y) in enumerate(zip(spec.steering, sides, strict=False)):
            taker = self._taker((*where, "steering", index), joint, "position")
            if taker is not None:
                sign = -1.0 if joint in spec.reversed else 1.0
                lower, upper = sorted(sign * value for value in self._range(joint))
                yield Steering(taker, spec.wheelbase, y, sign, lower, upper)

    def _taker(self, where: Location, joint: str, channel: str) -> str | None:
        """The actuator or drive that controls the velocity or position of a joint; None, with a problem, without it."""
        owner = self.joints.get(joint)
        if owner is None or not owner.kind.coordinates:
            rotations = [name for name, one in self.joints.items() if one.type == "revolute"]
            self.context.report(where, f"there is no joint '{joint}'", nearest(joint, rotations))
            return None
        if isinstance(owner.drive, CommandedDrive) and owner.drive.controls == channel:
            return joint
        for actuator in self.actuators:
            at_joint = isinstance(actuator.port, CoordinatePort) and actuator.port.coordinate == joint
            if at_joint and actuator.servo is not None and actuator.servo.controls == channel:
                return actuator.name
        remedy = VELOCITY_REMEDY if channel == "velocity" else POSITION_REMEDY
        self.context.report(where, f"nothing controls the {channel} of '{joint}'", remedy)
        return None

    def _speed_limit(self, joint: str) -> float:
        owner = self.joints[joint]
        own = math.inf if owner.velocity_limit is None else owner.velocity_limit
        return min(own, owner.drive.velocity_limit) if isinstance(owner.drive, CommandedDrive) else own

    def _range(self, joint: str) -> tuple[float, float]:
        owner = self.joints[joint]
        if isinstance(owner.drive, CommandedDrive):
            return owner.drive.lower, owner.drive.upper
        limits = owner.limits_of(0)
        return (-math.inf, math.inf) if limits is None else (limits.lower, limits.upper)


def _wheels(spec: schema.AnyBaseSpec) -> Iterator[tuple[Location, str, tuple[float, float, float]]]:
    """The key and the joint of each wheel, and the speed of its rim in m/s for each component of the velocity."""
    match spec:
        case schema.DifferentialBaseSpec() | schema.CarBaseSpec():
            for key, side in (("left", -1.0), ("right", 1.0)):
                for index, joint in enumerate(getattr(spec, key)):
                    yield (key, index), joint, (1.0, 0.0, 0.5 * side * spec.track)
        case schema.MecanumBaseSpec():
            arm = 0.5 * (spec.track + spec.wheelbase)
            yield ("front_left",), spec.front_left, (1.0, -1.0, -arm)
            yield ("front_right",), spec.front_right, (1.0, 1.0, arm)
            yield ("rear_left",), spec.rear_left, (1.0, 1.0, -arm)
            yield ("rear_right",), spec.rear_right, (1.0, -1.0, arm)
        case _:
            assert_never(spec)
