"""The efforts of all actuators on the links, and the rates of their states."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import assert_never

import casadi as ca

from mbd_sim.dynamics.actuator_layout import PRESSURES, ActuatorSlots
from mbd_sim.dynamics.applied_wrenches import AppliedWrenches
from mbd_sim.dynamics.cylinders import CylinderOutput, cylinder_output
from mbd_sim.dynamics.element_forces import ElementForces
from mbd_sim.dynamics.joint_forces import JointForces
from mbd_sim.dynamics.motors import MotorOutput, dc_motor, effort_motor
from mbd_sim.dynamics.rotors import speed_rows
from mbd_sim.dynamics.servos import ServoSignals, servo_output, with_reference
from mbd_sim.dynamics.spatial_algebra import is_finite, is_symbolic
from mbd_sim.dynamics.tracing import TracedMechanism
from mbd_sim.mechanism.actuators import (
    Actuator,
    CoordinatePort,
    DcMotor,
    EffortMotor,
    LinePort,
    Servo,
)
from mbd_sim.mechanism.channels import Channel
from mbd_sim.mechanism.cylinders import Cylinder


@dataclass(frozen=True, eq=False)
class PortMotion:
    """The position and the speed of a port; `line` (3,) is the unit vector of its effort on the second point."""

    x: ca.SX
    v: ca.SX
    line: ca.SX | None = None


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
            case LinePort(first=first, second=second):
                assert port.line is not None
                applied.add_force(second, motor.effort * port.line)
                applied.add_force(first, -motor.effort * port.line)
            case _:
                assert_never(actuator.port)
        power += motor.effort * port.v
    wrenches = [ca.sparsify(one + more) for one, more in zip(elements.wrenches, applied.wrenches, strict=True)]
    return replace(joints, own=own, applied_power=power), replace(elements, wrenches=wrenches)


def port_motion(traced: TracedMechanism, actuator: Actuator) -> PortMotion:
    """The motion of the port of an actuator."""
    match actuator.port:
        case CoordinatePort(coordinate=name):
            for link in traced.links:
                if name in link.joint.coordinate_names:
                    offset = link.joint.coordinate_names.index(name)
                    return PortMotion(traced.state.q[link.q.start + offset], traced.state.u[link.u.start + offset])
            raise ValueError(f"actuator {actuator.name} acts on '{name}', which is not a coordinate")
        case LinePort(first=first, second=second):
            applied = AppliedWrenches(traced.links, traced.motions, traced.poses)
            start, end = applied.motion_of(first), applied.motion_of(second)
            line = end.position - start.position
            length = ca.sqrt(ca.dot(line, line))
            return PortMotion(length, ca.dot(line, end.velocity - start.velocity) / length, line / length)
        case _:
            assert_never(actuator.port)


def commands_in_effect(traced: TracedMechanism, slots: ActuatorSlots) -> Mapping[Channel, ca.SX]:
    """The commands of an actuator by channel, after their delay."""
    if slots.delay:
        return {channel: traced.y[slots.states[channel]] for channel in slots.commands}
    return {channel: traced.inputs[index] for channel, index in slots.commands.items()}


def servo_signals(traced: TracedMechanism, servo: Servo, slots: ActuatorSlots, port: PortMotion) -> ServoSignals:
    """What the servo of an actuator reads; with a rate limit, its reference."""
    zero, given = ca.SX(1, 1), commands_in_effect(traced, slots)
    wanted: dict[Channel, ca.SX] = {"position": zero, "velocity": zero, "effort": zero, **given}
    signals = ServoSignals(port.x, port.v, wanted["position"], wanted["velocity"], wanted["effort"])
    if "reference" in slots.states:
        return with_reference(servo, signals, traced.y[slots.states["reference"]])
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
        return commands_in_effect(traced, slots)[actuator.control], None
    if servo.period is not None:
        return traced.y[slots.states["output"]], None
    signals = servo_signals(traced, servo, slots, port)
    result = servo_output(servo, signals, servo.limit, integral_of(traced, slots))
    return result.output, result.integral_rate


def _output(
    traced: TracedMechanism, actuator: Actuator, slots: ActuatorSlots, command: ca.SX, port: PortMotion
) -> MotorOutput | CylinderOutput:
    match actuator.motor:
        case EffortMotor() as motor:
            return effort_motor(motor, command, port.v)
        case DcMotor() as motor:
            current = traced.y[slots.states["current"]] if "current" in slots.states else ca.SX(1, 1)
            return dc_motor(_without_repeated_limit(motor, actuator.servo), command, current, port.v)
        case Cylinder() as cylinder:
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
