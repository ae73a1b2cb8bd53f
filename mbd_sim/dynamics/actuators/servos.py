"""The laws of servos: PID with feedforward, limited output, and an integral that follows the limited output.

The integral I obeys I' = ki e + (u - v) / T with the limited output u of the sum v, and the tracking time T (Åström &
Hägglund, sec. 3.5). A sampled servo takes v from the integral of the samples before it, and holds u until the next.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca

from mbd_sim.dynamics.math.spatial import is_absent, is_finite, limited
from mbd_sim.mechanism.elements.actuators import Servo


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
