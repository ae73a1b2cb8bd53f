"""The functions of a mechanism's actuators: what is read, what is sampled, and the commands before the first one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from mbd_sim.dynamics.actuator_forces import (
    ActuatorForces,
    PortMotion,
    commands_in_effect,
    integral_of,
    servo_signals,
)
from mbd_sim.dynamics.actuator_layout import ActuatorLayout, ActuatorSlots
from mbd_sim.dynamics.servos import error_of, moved_reference, servo_output, with_reference
from mbd_sim.dynamics.spatial_algebra import is_absent
from mbd_sim.dynamics.tracing import TracedMechanism
from mbd_sim.geometry.pose import Array
from mbd_sim.integrators.between_steps import BetweenSteps, DelayLine, Sampler
from mbd_sim.mechanism.actuators import Actuator, Servo, default_command

READINGS = ("position", "velocity", "effort", "voltage", "current", "electrical", "mechanical", "copper", "friction")


@dataclass(frozen=True, eq=False)
class ActuatorFunctions:
    """The functions and the `layout` of the actuators.

    `readings(t, y, inputs)` are (9, n), see `READINGS`, in SI units; powers in W. `base_inputs` are the inputs with the
    mechanism's own parameters, without commands.
    """

    layout: ActuatorLayout
    readings: ca.Function
    between_steps: BetweenSteps
    base_inputs: Array

    def hold(self, actuators: Sequence[Actuator], y: Array, inputs: Array | None = None) -> None:
        """Set the states and the commands of all actuators to those before the first command, in place.

        :param y: the state, whose positions are those that position servos hold.
        :param inputs: by default some that are forgotten.
        """
        inputs = self.base_inputs.copy() if inputs is None else inputs
        for states in (self.layout.core, self.layout.energies, self.layout.held, self.layout.lines):
            y[states.start : states.stop] = 0.0
        positions, velocities = np.array(self.readings(0.0, y, inputs))[:2]
        for actuator, slots, x, v in zip(actuators, self.layout.slots, positions, velocities, strict=True):
            commands = {name: actuator.start.get(name, default_command(name, float(x))) for name in slots.commands}
            for channel, value in commands.items():
                inputs[slots.commands[channel]] = value
                if slots.delay:
                    y[slots.states[channel]] = value
                    y[slots.lines[channel] : slots.lines[channel] + slots.delay] = value
            if actuator.servo is None:
                continue
            if "reference" in slots.states:
                y[slots.states["reference"]] = commands[actuator.servo.controls]
            if "error" in slots.states:
                y[slots.states["error"]] = commands["velocity"] - v


def actuator_functions(traced: TracedMechanism, forces: ActuatorForces) -> ActuatorFunctions | None:
    """All functions of the actuators; None if there are none."""
    if not forces.motors:
        return None
    columns = [
        ca.vertcat(
            port.x,
            port.v,
            motor.effort,
            motor.voltage,
            motor.current,
            motor.voltage * motor.current,
            motor.effort * port.v,
            motor.copper_loss,
            motor.friction_loss,
        )
        for port, motor in zip(forces.ports, forces.motors, strict=True)
    ]
    given = [traced.state.t, traced.y, traced.inputs]
    readings = ca.Function("actuators", given, [ca.densify(ca.horzcat(*columns))], {"cse": True})
    layout, end = traced.actuators, traced.y.shape[0]
    unread = frozenset([*layout.energies, *layout.lines, *range(end - traced.audit.shape[0], end)])
    held = frozenset([*layout.held, *layout.lines])
    between_steps = BetweenSteps(tuple(_delays(traced)), tuple(_samplers(traced, forces)), held, unread)
    centers = [np.zeros(3)] * len(traced.input_layout.loaded)
    base_inputs = traced.input_layout.without_commands(centers, traced.parameters.base)
    return ActuatorFunctions(traced.actuators, readings, between_steps, base_inputs)


def _delays(traced: TracedMechanism) -> list[DelayLine]:
    return [
        DelayLine(slots.commands[channel], slots.states[channel], first, slots.delay)
        for slots in traced.actuators.slots
        for channel, first in slots.lines.items()
    ]


def _samplers(traced: TracedMechanism, forces: ActuatorForces) -> list[Sampler]:
    """One sampler for all servos with the same period."""
    values: dict[int, dict[int, ca.SX]] = {}
    actuators = zip(traced.mechanism.actuators, traced.actuators.slots, forces.ports, strict=True)
    for actuator, slots, port in actuators:
        if actuator.servo is not None:
            new = _sampled(traced, actuator, actuator.servo, slots, port)
            values.setdefault(slots.every, {}).update(new)
    given = [traced.state.t, traced.y, traced.inputs]
    found = []
    for every, new in sorted(values.items()):
        if new:
            function = ca.Function(f"sample_{every}", given, [ca.densify(ca.vertcat(*new.values()))], {"cse": True})
            found.append(Sampler(every, function, tuple(new)))
    return found


def _sampled(
    traced: TracedMechanism, actuator: Actuator, servo: Servo, slots: ActuatorSlots, port: PortMotion
) -> dict[int, ca.SX]:
    """The new values of what a servo holds, by their index in y."""
    states, new = slots.states, dict[int, ca.SX]()
    period = servo.period if servo.period is not None else traced.step
    signals = servo_signals(traced, servo, slots, port)
    if "reference" in states:
        command = commands_in_effect(traced, slots)[servo.controls]
        moved = moved_reference(servo, traced.y[states["reference"]], command, period)
        new[states["reference"]] = moved
        signals = with_reference(servo, signals, moved)
    if servo.period is None:
        return new
    rate = None
    if servo.controls == "velocity" and not is_absent(servo.kd):
        error = error_of(servo, signals)
        new[states["error"]] = error
        rate = (error - traced.y[states["error"]]) / period
    integral = integral_of(traced, slots)
    result = servo_output(servo, signals, servo.limit, integral, rate)
    new[states["output"]] = result.output
    if "integral" in states:
        new[states["integral"]] = integral + period * result.integral_rate
    return new
