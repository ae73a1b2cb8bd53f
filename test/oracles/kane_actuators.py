"""The efforts of actuators in numpy, for Kane's equations: from commands, states, and the motion of the port."""

from __future__ import annotations

import math

import numpy as np

from mbd_sim.mechanism.elements.actuators import DcMotor, EffortMotor, FluidCylinder, Gas


def effort(actuator, commands, states, x, v):
    """The effort of an actuator at the position x and the speed v of its port.

    :param commands: by channel; `states` are the current, the pressures and the integral of its servo.
    """
    first, (lower, upper) = actuator.channels[0], actuator.command_range
    commands = {**commands, first: max(lower, min(upper, commands.get(first, 0.0)))}
    command = commands.get(actuator.control, 0.0)
    if actuator.servo is not None:
        command = servo_output(actuator.servo, commands, states.get("integral", 0.0), x, v)
    match actuator.motor:
        case EffortMotor():
            return motor_effort(actuator.motor, command, x, v)
        case DcMotor():
            return geared_torque(actuator.motor, motor_current(actuator.motor, command, states, v), v)
        case FluidCylinder():
            outside = actuator.motor.tank if isinstance(actuator.motor.fluid, Gas) else 0.0
            pressures = np.array([states["pressure_a"], states["pressure_b"]]) - outside
            return pressures @ (np.array(actuator.motor.areas) * [1.0, -1.0])
    raise AssertionError(actuator.motor)


def servo_output(servo, commands, integral, x, v):
    """The output of a continuous servo."""
    rate = commands.get("velocity", 0.0)
    error = commands["position"] - x if servo.controls == "position" else rate - v
    damping = servo.kd * (rate - v) if servo.controls == "position" else 0.0
    total = servo.kp * error + integral + damping + servo.feedforward * rate + commands.get("effort", 0.0)
    return max(-servo.limit, min(servo.limit, total))


def motor_effort(motor, command, x, v):
    """The command with gain and bias within the limits of the motor; while it drives, within the curve at its speed."""
    motion = np.array([1.0, x, v])
    command = (motion @ motor.gain) * command + motion @ motor.bias
    command = min(max(command, motor.effort_range[0]), motor.effort_range[1])
    wanted = math.copysign(min(abs(command), motor.effort_limit), command)
    if not motor.curve:
        return wanted
    speeds, limits = zip(*motor.curve, strict=True)
    most = np.interp(abs(v), speeds, limits) if wanted * v > 0.0 else limits[0]
    return math.copysign(min(abs(wanted), most), wanted)


def motor_current(motor, command, states, v):
    """The current of a DC motor: its state, or without an inductance that at which the voltages balance."""
    if "current" in states:
        return states["current"]
    k, resistance, omega = motor.torque_constant, motor.resistance, motor.gear * v
    if motor.control == "voltage":
        current = (command - k * omega) / resistance
    else:
        current = command if motor.control == "current" else command / (k * motor.gear)
    current = max(-motor.current_limit, min(motor.current_limit, current))
    lowest, highest = ((sign * motor.voltage_limit - k * omega) / resistance for sign in (-1.0, 1.0))
    return max(lowest, min(highest, current))


def geared_torque(motor, current, v):
    """The effort that a current exerts on the port of a DC motor: less friction and the loss of the gear."""
    omega = motor.gear * v
    direction = math.tanh(omega / motor.regularization)
    net = motor.torque_constant * current - motor.coulomb * direction - motor.viscous * omega
    drives = net * omega > 0.0
    lost = 1.0 - motor.efficiency if drives else 1.0 / motor.efficiency - 1.0
    return motor.gear * (net - lost * abs(net) * direction)
