"""The efforts of all actuators on the links, and the rates of their states."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import assert_never

import casadi as ca
import numpy as np

from mbd_sim.dynamics.actuators.cylinders import CylinderOutput, cylinder_output
from mbd_sim.dynamics.actuators.motors import (
    MotorOutput,
    ServoSignals,
    dc_motor,
    effort_motor,
    servo_output,
    with_reference,
)
from mbd_sim.dynamics.forces.elements import ElementForces
from mbd_sim.dynamics.forces.joints import JointForces
from mbd_sim.dynamics.kinematics.links import speed_rows
from mbd_sim.dynamics.kinematics.tracing import TracedMechanism
from mbd_sim.dynamics.kinematics.wrenches import AppliedWrenches
from mbd_sim.dynamics.layouts.actuators import ActuatorSlots
from mbd_sim.dynamics.math.spatial import constant, is_finite, is_symbolic, within
from mbd_sim.mechanism.elements.actuators import (
    PRESSURES,
    Actuator,
    CoordinatePort,
    DcMotor,
    EffortMotor,
    FluidCylinder,
    LinePort,
    Servo,
    SumPort,
    WrenchPort,
)
from mbd_sim.mechanism.elements.joint_types import Channel


@dataclass(frozen=True, eq=False)
class PortMotion:
    """The position and the speed of a port; `direction` (3,) is that of its effort, in ground's axes, and `couple`."""

    x: ca.SX
    v: ca.SX
    direction: ca.SX | None = None
    couple: ca.SX | None = None


@dataclass(frozen=True, eq=False)
class ActuatorForces:
    """What the actuators do, in the order of the file.

    `rates` are those of their states, in the order of `ActuatorLayout`. `ports` and `motors` have an entry for each.
    """

    ports: Sequence[PortMotion]
    motors: Sequence[MotorOutput | CylinderOutput]
    rates: ca.SX


def actuator_forces(traced: TracedMechanism) -> ActuatorForces:
    """The efforts, currents, pressures and losses of all actuators."""
    layout = traced.actuators
    rates = ca.SX(layout.size, 1)
    first = traced.layout.nq + traced.layout.nv
    ports, motors = [], []
    for actuator, slots in zip(traced.mechanism.actuators, layout.slots, strict=True):
        port = port_motion(traced, actuator)
        command, integral_rate = _motor_command(traced, actuator, slots, port)
        motor = _output(traced, actuator, slots, command, port)
        found = {"integral": integral_rate, **_rates(motor, port.v)}
        for name, rate in found.items():
            if rate is not None and name in slots.states:
                rates[slots.states[name] - first] = rate
        ports.append(port)
        motors.append(motor)
    return ActuatorForces(ports, motors, rates)


def with_actuators(
    traced: TracedMechanism, joints: JointForces, elements: ElementForces, actuators: ActuatorForces
) -> tuple[JointForces, ElementForces]:
    """The forces of joints and elements with those of the actuators, whose power is that of applied forces."""
    own, power = ca.SX(joints.own), joints.applied_power
    applied = AppliedWrenches(traced.links, traced.motions, traced.poses)
    rows = speed_rows(traced.links)
    for actuator, port, motor in zip(traced.mechanism.actuators, actuators.ports, actuators.motors, strict=True):
        match actuator.port:
            case CoordinatePort(coordinate=name):
                own[rows[name]] += motor.effort
            case SumPort(factors=factors):
                for name, factor in factors.items():
                    own[rows[name]] += factor * motor.effort
            case LinePort() | WrenchPort():
                add_effort(applied, actuator.port, port, motor.effort)
            case _:
                assert_never(actuator.port)
        power += motor.effort * port.v
    wrenches = [ca.sparsify(one + more) for one, more in zip(elements.wrenches, applied.wrenches, strict=True)]
    return replace(joints, own=own, applied_power=power), replace(elements, wrenches=wrenches)


def add_effort(applied: AppliedWrenches, port: LinePort | WrenchPort, motion: PortMotion, effort: ca.SX) -> None:
    """Apply the effort of an actuator to the parts on which it acts."""
    assert motion.direction is not None
    if isinstance(port, LinePort):
        applied.add_force(port.second, effort * motion.direction)
        applied.add_force(port.first, -effort * motion.direction)
        return
    assert motion.couple is not None
    applied.add_force(port.at, effort * motion.direction)
    if np.any(port.couple):
        applied.add_couple(port.at, effort * motion.couple)


def port_motion(traced: TracedMechanism, actuator: Actuator) -> PortMotion:
    """The motion of the port of an actuator."""
    match actuator.port:
        case CoordinatePort(coordinate=name):
            return PortMotion(*_coordinate(traced, name))
        case SumPort(factors=factors):
            terms = [(factor, *_coordinate(traced, name)) for name, factor in factors.items()]
            position, speed = (sum((c * one[i] for c, *one in terms), ca.SX(1, 1)) for i in (0, 1))
            return PortMotion(position, speed)
        case LinePort(first=first, second=second):
            applied = AppliedWrenches(traced.links, traced.motions, traced.poses)
            start, end = applied.motion_of(first), applied.motion_of(second)
            line = end.position - start.position
            length = ca.sqrt(ca.dot(line, line))
            return PortMotion(length, ca.dot(line, end.velocity - start.velocity) / length, line / length)
        case WrenchPort(at=at, force=force, couple=couple):
            applied = AppliedWrenches(traced.links, traced.motions, traced.poses)
            motion, axes = applied.motion_of(at), applied.rotation(at.part)
            direction, turning = axes @ constant(force), axes @ constant(couple)
            speed = ca.dot(direction, motion.velocity) + ca.dot(turning, motion.omega)
            return PortMotion(ca.SX(1, 1), speed, direction, turning)
        case _:
            assert_never(actuator.port)


def _coordinate(traced: TracedMechanism, name: str) -> tuple[ca.SX, ca.SX]:
    """The position and the speed of a coordinate; the position is 0 for a component of an angular velocity."""
    for link in traced.links:
        joint = link.joint
        if name in joint.coordinate_names:
            offset = joint.coordinate_names.index(name)
            turns = joint.kind.quaternion is not None and joint.kind.coordinates[offset].rotation
            position = ca.SX(1, 1) if turns else traced.state.q[link.q.start + offset]
            return position, traced.state.u[link.u.start + offset]
    raise ValueError(f"an actuator acts on '{name}', which is not a coordinate")


def commands_in_effect(
    traced: TracedMechanism, slots: ActuatorSlots, bounds: tuple[float, float]
) -> Mapping[Channel, ca.SX]:
    """The commands of an actuator by channel, after their delay; the first one within its bounds."""
    if slots.delay:
        found = {channel: traced.y[slots.states[channel]] for channel in slots.commands}
    else:
        found = {channel: traced.inputs[index] for channel, index in slots.commands.items()}
    first = next(iter(found))
    return {**found, first: within(found[first], bounds)}


def servo_signals(traced: TracedMechanism, actuator: Actuator, slots: ActuatorSlots, port: PortMotion) -> ServoSignals:
    """What the servo of an actuator reads; with a rate limit, its reference."""
    assert actuator.servo is not None
    zero, given = ca.SX(1, 1), commands_in_effect(traced, slots, actuator.command_range)
    wanted: dict[Channel, ca.SX] = {"position": zero, "velocity": zero, "effort": zero, **given}
    signals = ServoSignals(port.x, port.v, wanted["position"], wanted["velocity"], wanted["effort"])
    if "reference" in slots.states:
        return with_reference(actuator.servo, signals, traced.y[slots.states["reference"]])
    return signals


def integral_of(traced: TracedMechanism, slots: ActuatorSlots) -> ca.SX:
    """The integral of a servo; zero without one."""
    return traced.y[slots.states["integral"]] if "integral" in slots.states else ca.SX(1, 1)


def _motor_command(
    traced: TracedMechanism, actuator: Actuator, slots: ActuatorSlots, port: PortMotion
) -> tuple[ca.SX, ca.SX | None]:
    """What commands the motor, and the rate of the integral of a continuous servo."""
    servo = actuator.servo
    if servo is None:
        return commands_in_effect(traced, slots, actuator.command_range)[actuator.control], None
    if servo.period is not None:
        return traced.y[slots.states["output"]], None
    signals = servo_signals(traced, actuator, slots, port)
    result = servo_output(servo, signals, servo.limit, integral_of(traced, slots))
    return result.output, result.integral_rate


def _output(
    traced: TracedMechanism, actuator: Actuator, slots: ActuatorSlots, command: ca.SX, port: PortMotion
) -> MotorOutput | CylinderOutput:
    match actuator.motor:
        case EffortMotor() as motor:
            return effort_motor(motor, command, port.x, port.v)
        case DcMotor() as motor:
            current = traced.y[slots.states["current"]] if "current" in slots.states else ca.SX(1, 1)
            return dc_motor(_without_repeated_limit(motor, actuator.servo), command, current, port.v)
        case FluidCylinder() as cylinder:
            pressures = [traced.y[slots.states[name]] for name in PRESSURES]
            return cylinder_output(cylinder, command, pressures, port.x, port.v)
        case _:
            assert_never(actuator.motor)


def _without_repeated_limit(motor: DcMotor, servo: Servo | None) -> DcMotor:
    """The motor without the limit of its voltage, if its servo commands no larger one and nothing else changes it."""
    if servo is None or motor.control != "voltage" or is_finite(motor.current_limit):
        return motor
    if is_symbolic(servo.limit) or is_symbolic(motor.voltage_limit) or servo.limit > motor.voltage_limit:
        return motor
    return replace(motor, voltage_limit=math.inf)


def _rates(motor: MotorOutput | CylinderOutput, speed: ca.SX) -> dict[str, ca.SX | None]:
    """The rates of a motor's or cylinder's own states, and those of its energies in W."""
    if isinstance(motor, CylinderOutput):
        return {
            **dict(zip(PRESSURES, motor.pressure_rates, strict=True)),
            "fluid_work": motor.fluid_power,
            "mechanical_work": motor.effort * speed,
            "compression_work": motor.compression,
        }
    return {
        "current": motor.current_rate,
        "electrical_work": motor.voltage * motor.current,
        "mechanical_work": motor.effort * speed,
        "copper_loss": motor.copper_loss,
        "friction_loss": motor.friction_loss,
    }
