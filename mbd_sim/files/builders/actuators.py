"""Builds the actuators of a mechanism from their records in the file: motors, cylinders and wheeled bases."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import assert_never

import numpy as np

from mbd_sim.base.errors import InputError, nearest
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.linear_algebra import product
from mbd_sim.files.builders.context import BuildContext, attachment
from mbd_sim.files.schema import actuators as schema
from mbd_sim.files.schema.actuators import HydraulicCylinderSpec, PneumaticCylinderSpec
from mbd_sim.files.schema.fields import Measured, plain
from mbd_sim.mechanism.elements.actuators import (
    Actuator,
    Base,
    CoordinatePort,
    DcMotor,
    EffortMotor,
    FluidCylinder,
    Gas,
    LinePort,
    Machine,
    Oil,
    Port,
    Servo,
    Steering,
    SumPort,
    Wheel,
    WrenchPort,
)
from mbd_sim.mechanism.elements.joint_types import CommandedDrive
from mbd_sim.mechanism.elements.parts import GROUND, Joint
from mbd_sim.mechanism.values.source import Location

TRANSITION = {"hydraulic_cylinder": 1e5, "pneumatic_cylinder": 1e3}  # Pa


def build_cylinder(
    location: Location, spec: HydraulicCylinderSpec | PneumaticCylinderSpec, port: Port, context: BuildContext
) -> FluidCylinder:
    """The cylinder of an actuator; a problem is reported to `context`."""
    if port.rotation:
        context.report(location, "a cylinder moves along a line, but acts on an angle", "Give 'between' two points.")
    if isinstance(spec, HydraulicCylinderSpec):
        fluid: Oil | Gas = Oil(spec.bulk_modulus, spec.rated_flow / math.sqrt(spec.rated_drop), spec.leakage)
        tank = spec.tank
    else:
        fluid, tank = Gas(spec.exponent, spec.conductance, spec.critical_ratio, spec.leakage), spec.exhaust
    return FluidCylinder(
        fluid=fluid,
        areas=spec.areas,
        dead_volumes=spec.dead_volumes,
        retracted=spec.retracted or 0.0,
        stroke=spec.stroke,
        supply=spec.supply,
        tank=tank,
        transition=TRANSITION[spec.type] if spec.transition is None else spec.transition,
        pressures=spec.pressures or (tank, tank),
    )


BANDWIDTH = 10.0  # times resistance/inductance, of a current loop
_COMMAND_UNITS = {"voltage": "V", "current": "A", "opening": "1"}


def build_actuators(specs: Mapping[str, schema.AnyActuatorSpec], context: BuildContext) -> tuple[Actuator, ...]:
    """The actuators of a file; invalid ones are left out and reported to `context`."""
    found = []
    drives = {name for name, joint in context.valid_joints.items() if isinstance(joint.drive, CommandedDrive)}
    for name, spec in specs.items():
        if name in drives:
            message = f"the drive of the joint '{name}' takes commands by this name too"
            context.report(("actuators", name), message, "Rename the actuator.")
        port = _port(name, spec, context)
        if port is not None:
            found.append(_actuator(name, spec, port, context))
    return tuple(found)


def actuated_joints(actuators: tuple[Actuator, ...], joints: Mapping[str, Joint]) -> list[str]:
    """The joints on whose coordinates actuators act."""
    owners = {label: joint.name for joint in joints.values() for label in joint.motion_names}
    found = []
    for actuator in actuators:
        match actuator.port:
            case CoordinatePort(coordinate=coordinate):
                found.append(owners[coordinate])
            case SumPort(factors=factors):
                found += [owners[name] for name in factors]
            case LinePort() | WrenchPort():
                pass
            case _:
                assert_never(actuator.port)
    return found


def _port(name: str, spec: schema.AnyActuatorSpec, context: BuildContext) -> Port | None:
    location: Location = ("actuators", name)
    if spec.between is not None:
        ends = context.attachments((*location, "between"), spec.between)
        return LinePort(ends[0], ends[1]) if ends else None
    if isinstance(spec, schema.EffortActuatorSpec):
        if spec.terms is not None:
            return _sum_port(location, spec.terms, spec.servo, context)
        if spec.at is not None and spec.wrench is not None:
            return _wrench_port((*location, "at"), spec.at, np.array(spec.wrench, dtype=float), context)
    return _coordinate_port((*location, "joint"), spec.joint or "", spec.servo, context)


def _wrench_port(where: Location, at: str, wrench: Array, context: BuildContext) -> WrenchPort | None:
    frame = context.frame(where, at)
    if frame is None:
        return None
    if frame[0] == GROUND:
        context.report(where, "is a point of ground, which a wrench does not move", "Name a point of a part.")
        return None
    axes = frame[1].rotation
    return WrenchPort(attachment(frame), product(axes, wrench[:3]), product(axes, wrench[3:]))


def _sum_port(
    location: Location, terms: Mapping[str, float], servo: schema.ServoSpec | None, context: BuildContext
) -> SumPort | None:
    ports = [_coordinate_port((*location, "terms", name), name, servo, context) for name in terms]
    valid = [port for port in ports if port is not None]
    return SumPort(dict(terms), all(port.rotation for port in valid)) if len(valid) == len(ports) else None


def _coordinate_port(
    where: Location, wanted: str, servo: schema.ServoSpec | None, context: BuildContext
) -> CoordinatePort | None:
    if (found := context.coordinate(where, wanted)) is None:
        return None
    joint, coordinate = found
    if joint.drive:
        message = f"'{joint.name}' is driven: its drive alone prescribes the motion"
        context.report(where, message, "Remove 'drive' from the joint, or the actuator.")
    elif joint.kind.quaternion is not None and servo is not None:
        message = f"'{joint.name}' is {joint.type}: a servo needs a joint whose coordinates are angles or lengths"
        remedy = "Leave out the servo, act 'between' two points, or use several joints."
        context.report(where, message, remedy)
    else:
        return CoordinatePort(wanted, coordinate.rotation)
    return None


def _actuator(name: str, spec: schema.AnyActuatorSpec, port: Port, context: BuildContext) -> Actuator:
    location: Location = ("actuators", name)
    angle, effort = ("rad", "N*m") if port.rotation else ("m", "N")
    motor: Machine
    match spec:
        case schema.EffortActuatorSpec():
            motor, control = _effort_motor(location, spec, port, context), "effort"
        case schema.DcMotorSpec():
            motor, control = _dc_motor(location, spec, port, context), spec.control
        case schema.HydraulicCylinderSpec() | schema.PneumaticCylinderSpec():
            motor, control = build_cylinder(location, spec, port, context), "opening"
        case _:
            assert_never(spec)
    output = {"effort": effort, **_COMMAND_UNITS}[control]
    without_servo = Actuator(name, port, motor, None, {})
    servo = None if spec.servo is None else _servo(location, spec.servo, without_servo, angle, output, context)
    actuator = Actuator(name, port, motor, servo, {}, spec.delay)
    units = {"position": angle, "velocity": f"{angle}/s", "effort": effort, **_COMMAND_UNITS}
    start: dict[str, float] = {}
    for channel, value in spec.command.items():
        if channel not in actuator.channels:
            message = f"the actuator takes no {channel}"
            context.report((*location, "command", channel), message, f"Give {' or '.join(actuator.channels)}.")
        _require(context, (*location, "command", channel), value, units[channel])
        start[channel] = plain(value)
    bounds = _range(location, spec, units[actuator.channels[0]], context)
    return Actuator(name, port, motor, servo, start, spec.delay, bounds)


def _range(location: Location, spec: schema.AnyActuatorSpec, unit: str, context: BuildContext) -> tuple[float, float]:
    """The bounds of the first command."""
    if spec.command_range is None:
        return -math.inf, math.inf
    for index, value in enumerate(spec.command_range):
        _require(context, (*location, "command_range", index), value, unit)
    return _pair(spec.command_range)


def _gear(location: Location, spec: schema.MotorSpec, port: Port, context: BuildContext) -> float:
    """The speed of the rotor in rad/s for a speed of 1 of the port."""
    if port.rotation and spec.lead is not None:
        context.report((*location, "lead"), "has no effect on an angle", "Remove it, or give 'gear_ratio'.")
    if port.rotation:
        return spec.gear_ratio
    if spec.lead is not None:
        return spec.gear_ratio * 2.0 * math.pi / spec.lead
    if isinstance(spec, schema.DcMotorSpec) or spec.rotor_inertia:
        remedy = "Add the travel for one revolution, such as 'lead: 5 mm'; that of a pinion is ${2*pi*r} m."
        context.report(location, "turns to move along a line, but has no lead", remedy)
    return spec.gear_ratio


def _effort_motor(
    location: Location, spec: schema.EffortActuatorSpec, port: Port, context: BuildContext
) -> EffortMotor:
    effort, speed = ("N*m", "rad/s") if port.rotation else ("N", "m/s")
    if spec.effort_limit is not None:
        _require(context, (*location, "effort_limit"), spec.effort_limit, effort)
    for index, value in enumerate(spec.effort_range or ()):
        _require(context, (*location, "effort_range", index), value, effort)
    for row, (at, value) in enumerate(spec.torque_speed or ()):
        _require(context, (*location, "torque_speed", row, 0), at, speed)
        _require(context, (*location, "torque_speed", row, 1), value, effort)
    return EffortMotor(
        effort_limit=_or_infinite(spec.effort_limit),
        curve=tuple((plain(at), plain(value)) for at, value in spec.torque_speed or ()),
        gear=_gear(location, spec, port, context),
        rotor_inertia=spec.rotor_inertia,
        effort_range=(-math.inf, math.inf) if spec.effort_range is None else _pair(spec.effort_range),
        gain=spec.gain,
        bias=spec.bias,
    )


def _pair(values: tuple[float, float]) -> tuple[float, float]:
    return float(values[0]), float(values[1])


def _dc_motor(location: Location, spec: schema.DcMotorSpec, port: Port, context: BuildContext) -> DcMotor:
    bandwidth = spec.current_bandwidth
    if bandwidth is None and spec.inductance:
        bandwidth = BANDWIDTH * spec.resistance / spec.inductance
    return DcMotor(
        torque_constant=spec.torque_constant,
        resistance=spec.resistance,
        inductance=spec.inductance,
        voltage_limit=_or_infinite(spec.voltage_limit),
        current_limit=_or_infinite(spec.current_limit),
        gear=_gear(location, spec, port, context),
        efficiency=spec.efficiency,
        rotor_inertia=spec.rotor_inertia,
        coulomb=spec.friction,
        viscous=spec.damping,
        regularization=spec.regularization,
        control=spec.control,
        bandwidth=bandwidth or 0.0,
    )


def _servo(
    location: Location, spec: schema.ServoSpec, actuator: Actuator, angle: str, output: str, context: BuildContext
) -> Servo:
    where = (*location, "servo")
    for key, unit in _servo_units(spec.controls == "position", angle, output):
        if (value := getattr(spec, key)) is not None:
            _require(context, (*where, key), value, unit)
    period = None if spec.sample_rate is None else 1.0 / spec.sample_rate
    tracking_time = spec.tracking_time
    limit = min(_or_infinite(spec.limit), actuator.output_limit)
    if tracking_time is None and spec.ki and spec.kp:
        tracking_time = max(spec.kp / spec.ki, period or 0.0)
    elif tracking_time is None and spec.ki and math.isfinite(limit):
        remedy = "Add 'tracking_time', the time in which the integral follows a limited output."
        context.report(where, "has ki and a limit, but neither kp nor tracking_time", remedy)
    return Servo(
        controls=spec.controls,
        kp=plain(spec.kp),
        ki=plain(spec.ki),
        kd=plain(spec.kd),
        feedforward=plain(spec.velocity_feedforward),
        limit=plain(limit),
        tracking_time=_or_infinite(tracking_time),
        rate_limit=_or_infinite(spec.rate_limit),
        period=period,
    )


def _servo_units(of_position: bool, angle: str, output: str) -> Iterator[tuple[str, str]]:
    """The units of the keys of a servo whose error is an `angle` or length, or its rate."""
    yield "kp", f"{output}/{angle}" if of_position else f"{output}*s/{angle}"
    yield "ki", f"{output}/({angle}*s)" if of_position else f"{output}/{angle}"
    yield "kd", f"{output}*s/{angle}" if of_position else f"{output}*s**2/{angle}"
    yield "velocity_feedforward", f"{output}*s/{angle}"
    yield "limit", output
    yield "rate_limit", f"{angle}/s" if of_position else f"{angle}/s**2"


def _or_infinite(value: float | None) -> float:
    return math.inf if value is None else plain(value)


def _require(context: BuildContext, location: Location, value: float, unit: str) -> None:
    if isinstance(value, Measured):
        try:
            value.require(unit)
        except InputError as error:
            context.problems.append(context.source.problem_of(location, error))


VELOCITY_REMEDY = "Give the joint an actuator with a velocity servo, or 'drive: {command: velocity, …}'."
POSITION_REMEDY = "Give the joint an actuator with a position servo, or 'drive: {command: position, …}'."


def build_bases(
    specs: Mapping[str, schema.AnyBaseSpec], actuators: Sequence[Actuator], context: BuildContext
) -> tuple[Base, ...]:
    """The bases of a file; mistakes are reported to `context`."""
    builder = _BaseBuilder(actuators, context, context.complete and not context.problems)
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
    """Builds bases one by one; whether something controls a wheel is judged if all joints and actuators are known."""

    actuators: Sequence[Actuator]
    context: BuildContext
    judges_control: bool

    @property
    def joints(self) -> Mapping[str, Joint]:
        """The valid joints by name."""
        return self.context.valid_joints

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
                self.context.report(
                    (*where, "reversed", index), f"'{joint}' is not one of its wheels", nearest(joint, named)
                )
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
        known = self.context.joints
        if owner is None and (known is None or joint in known):
            return None
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
        if self.judges_control:
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
