"""Motors: their effort, current and losses from their command and the speed of their port; servos, which command them.

A gear with the efficiency η < 1 passes on η of a torque that drives, and takes 1/η of one that brakes. Near rest this
loss, like the friction of the rotor, falls to zero with tanh(ω/ω₀), so that the torque does not jump.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import casadi as ca

from mbd_sim.dynamics.math.spatial import between, is_absent, is_finite, is_symbolic, limited, within
from mbd_sim.mechanism.elements.actuators import Servo

if TYPE_CHECKING:
    from mbd_sim.mechanism.elements.actuators import DcMotor, EffortMotor


@dataclass(frozen=True, eq=False)
class MotorOutput:
    """What a motor does at a moment.

    `effort` acts along the port, in N or N·m. `voltage` in V and `current` in A are zero for effort motors.
    `current_rate` in A/s is that of a current which is a state. The losses are in W.
    """

    effort: ca.SX
    voltage: ca.SX
    current: ca.SX
    current_rate: ca.SX | None
    copper_loss: ca.SX
    friction_loss: ca.SX


def _affine(coefficients: tuple[float, float, float], position: ca.SX, speed: ca.SX) -> ca.SX:
    constant, of_position, of_speed = coefficients
    return constant + of_position * position + of_speed * speed


def effort_motor(motor: EffortMotor, command: ca.SX, position: ca.SX, speed: ca.SX) -> MotorOutput:
    """The commanded effort with gain and bias, within the limits."""
    if motor.gain != (1.0, 0.0, 0.0):
        command = _affine(motor.gain, position, speed) * command
    if any(motor.bias):
        command += _affine(motor.bias, position, speed)
    effort = within(limited(command, motor.effort_limit), motor.effort_range)
    if motor.curve:
        forward, backward = (_interpolated(motor.curve, ca.fmax(v, 0.0)) for v in (speed, -speed))
        effort = between(effort, -backward, forward)
    zero = ca.SX(1, 1)
    return MotorOutput(effort, zero, zero, None, zero, zero)


def _interpolated(curve: Sequence[tuple[float, float]], speed: ca.SX) -> ca.SX:
    """The value of a curve at a speed that is not negative: linear between its points, constant beyond the last one."""
    value = ca.SX(curve[0][1])
    for (start, before), (end, after) in pairwise(curve):
        value += (after - before) / (end - start) * between(speed - start, 0.0, end - start)
    return value


def dc_motor(motor: DcMotor, command: ca.SX, current: ca.SX, speed: ca.SX) -> MotorOutput:
    """A DC motor; `current` is its state in A, which is not read without an inductance."""
    omega = motor.gear * speed
    back_emf = motor.torque_constant * omega
    if is_absent(motor.inductance):
        voltage = _voltage(motor, command, ca.SX(1, 1), back_emf, motor.resistance)
        current = (voltage - back_emf) * (1.0 / motor.resistance)
        if motor.control != "voltage" and not is_finite(motor.voltage_limit):  # the quotient would round
            current = _wanted_current(motor, command)
        rate = None
    else:
        drop = back_emf + motor.resistance * current
        voltage = _voltage(motor, command, current, drop, motor.inductance * motor.bandwidth)
        rate = (voltage - drop) * (1.0 / motor.inductance)
    torque, loss = _geared(motor, motor.torque_constant * current, omega)
    return MotorOutput(motor.gear * torque, voltage, current, rate, motor.resistance * current**2, loss)


def _wanted_current(motor: DcMotor, command: ca.SX) -> ca.SX:
    wanted = command / (motor.torque_constant * motor.gear) if motor.control == "effort" else command
    return limited(wanted, motor.current_limit)


def _voltage(motor: DcMotor, command: ca.SX, current: ca.SX, base: ca.SX, slope: float | ca.SX) -> ca.SX:
    """The voltage of the drive in V. At `base` + `slope` (i - `current`) the current is, or approaches, i."""
    if motor.control != "voltage":
        voltage = base + slope * (_wanted_current(motor, command) - current)
    elif is_finite(motor.current_limit):
        lower, upper = (base + slope * (sign * motor.current_limit - current) for sign in (-1.0, 1.0))
        voltage = between(command, lower, upper)
    else:
        voltage = command
    return limited(voltage, motor.voltage_limit)


def _geared(motor: DcMotor, torque: ca.SX, omega: ca.SX) -> tuple[ca.SX, ca.SX]:
    """The torque of the motor in N·m after friction and the loss of its gear, at its rotor, and the power of both."""
    loss = ca.SX(1, 1)
    lossless = not is_symbolic(motor.efficiency) and motor.efficiency == 1.0
    direction = ca.SX(0) if lossless and is_absent(motor.coulomb) else ca.tanh(omega / motor.regularization)
    if not is_absent(motor.coulomb):
        loss += motor.coulomb * direction
    if not is_absent(motor.viscous):
        loss += motor.viscous * omega
    if not lossless:
        net = torque - loss
        share = ca.if_else(net * omega > 0.0, 1.0 - motor.efficiency, 1.0 / motor.efficiency - 1.0)
        loss += share * ca.fabs(net) * direction
    return torque - loss, loss * omega


@dataclass(frozen=True, eq=False)
class ServoSignals:
    """What a servo reads: position and speed of its port, the commands, and the limit of its output.

    `position` and `velocity` of the command are in rad or m and rad/s or m/s; `effort` is added to the output.
    """

    x: ca.SX
    v: ca.SX
    position: ca.SX
    velocity: ca.SX
    effort: ca.SX


@dataclass(frozen=True, eq=False)
class ServoOutput:
    """The `error`, the limited `output`, and the rate of the integral in 1/s of the output's unit."""

    error: ca.SX
    output: ca.SX
    integral_rate: ca.SX


def with_reference(servo: Servo, signals: ServoSignals, reference: ca.SX) -> ServoSignals:
    """The signals of a servo with another reference of what is controlled."""
    if servo.controls == "position":
        return replace(signals, position=reference)
    return replace(signals, velocity=reference)


def error_of(servo: Servo, signals: ServoSignals) -> ca.SX:
    """What the servo makes zero."""
    return signals.position - signals.x if servo.controls == "position" else signals.velocity - signals.v


def servo_output(
    servo: Servo, signals: ServoSignals, limit: float | ca.SX, integral: ca.SX, error_rate: ca.SX | None = None
) -> ServoOutput:
    """The output of a servo.

    :param limit: of the output.
    :param error_rate: of a velocity servo; that of a position servo is the error of its speed.
    """
    error = error_of(servo, signals)
    total = servo.kp * error
    if not is_absent(servo.ki):
        total += integral
    if not is_absent(servo.kd):
        rate = signals.velocity - signals.v if error_rate is None else error_rate
        total += servo.kd * rate
    if not is_absent(servo.feedforward):
        total += servo.feedforward * signals.velocity
    total += signals.effort
    output = limited(total, limit)
    rate = servo.ki * error
    if has_tracking(servo, limit):
        rate += (output - total) / servo.tracking_time
    return ServoOutput(error, output, rate)


def has_tracking(servo: Servo, limit: float | ca.SX) -> bool:
    """Whether the integral follows a limited output."""
    return is_finite(limit) and is_finite(servo.tracking_time)


def moved_reference(servo: Servo, reference: ca.SX, command: ca.SX, period: float) -> ca.SX:
    """The reference after a sample, which follows the command by at most the rate limit."""
    return reference + limited(command - reference, servo.rate_limit * period)
