"""The functions of a mechanism's actuators: what is read, what is sampled, and the commands before the first one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, assert_never

import casadi as ca
import numpy as np

from mbd_sim.base.errors import MechanismError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.actuators.cylinders import CylinderOutput, displaced_energy, stored_energy
from mbd_sim.dynamics.actuators.forces import ActuatorForces, PortMotion, commands_in_effect, integral_of, servo_signals
from mbd_sim.dynamics.actuators.motors import MotorOutput, error_of, moved_reference, servo_output, with_reference
from mbd_sim.dynamics.kinematics.tracing import TracedMechanism
from mbd_sim.dynamics.layouts.actuators import ActuatorLayout, ActuatorSlots
from mbd_sim.dynamics.math.spatial import is_absent
from mbd_sim.integrators.between_steps import BetweenSteps, DelayLine, Sampler
from mbd_sim.mechanism.elements.actuators import Actuator, DcMotor, EffortMotor, FluidCylinder, Machine, Servo
from mbd_sim.mechanism.elements.joint_types import default_command
from mbd_sim.mechanism.mechanism import Mechanism

MOTOR_READINGS = (
    "position",
    "velocity",
    "effort",
    "voltage",
    "current",
    "electrical",
    "mechanical",
    "copper",
    "friction",
)
CYLINDER_READINGS = (
    "position",
    "velocity",
    "effort",
    "pressure_a",
    "pressure_b",
    "flow_a",
    "flow_b",
    "fluid",
    "throttling",
    "stored",
    "displaced",
)
STARTS = {"stored_at_start": "stored", "compression_work": "displaced"}  # states of cylinders and their start values


def reading_names(machine: Machine) -> tuple[str, ...]:
    """The names of the readings of an actuator with this machine, in order."""
    match machine:
        case EffortMotor() | DcMotor():
            return MOTOR_READINGS
        case FluidCylinder():
            return CYLINDER_READINGS
        case _:
            assert_never(machine)


ROUNDING = 1e-9  # of a stroke, by which loops may be open at the start


@dataclass(frozen=True, eq=False)
class ActuatorFunctions:
    """The functions and the `layout` of the actuators.

    `readings(t, y, inputs)` are (k, n) in SI units: in the column of each actuator its `MOTOR_READINGS` or
    `CYLINDER_READINGS`, with zeros below them. `base_inputs` are the inputs with the mechanism's own parameters,
    without commands.
    """

    layout: ActuatorLayout
    readings: ca.Function
    between_steps: BetweenSteps
    base_inputs: Array

    def hold(self, actuators: Sequence[Actuator], y: Array | ca.SX, inputs: Array | ca.SX | None = None) -> None:
        """Set the states and the commands of all actuators to those before the first command, in place.

        :param y: the state, whose positions are those that position servos hold; numbers or symbols.
        :param inputs: by default some that are forgotten.
        """
        inputs = self.base_inputs.copy() if inputs is None else inputs
        for states in (self.layout.core, self.layout.energies, self.layout.held, self.layout.lines):
            y[states.start : states.stop] = 0.0
        for actuator, slots in zip(actuators, self.layout.slots, strict=True):
            for name, value in actuator.motor.start_states.items():
                y[slots.states[name]] = value
        readings = _read(self.readings, 0.0, y, inputs)
        for number, (actuator, slots) in enumerate(zip(actuators, self.layout.slots, strict=True)):
            x, v = readings[0, number], readings[1, number]
            commands = {name: actuator.start.get(name, default_command(name, x)) for name in slots.commands}
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
        for index, stored in self.stored(0.0, y, inputs).items():
            y[index] = stored

    def stored(self, time: float, y: Array | ca.SX, inputs: Array | ca.SX) -> dict[int, Any]:
        """What each cylinder stores, in J, by the index in y of the state of the account that starts with it."""
        if not any(state in slots.states for slots in self.layout.slots for state in STARTS):
            return {}
        readings = _read(self.readings, time, y, inputs)
        return {
            slots.states[state]: readings[CYLINDER_READINGS.index(reading), actuator]
            for actuator, slots in enumerate(self.layout.slots)
            for state, reading in STARTS.items()
            if state in slots.states
        }


def _read(readings: ca.Function, time: float, y: Array | ca.SX, inputs: Array | ca.SX) -> Any:
    """The readings (k, n) as an array, or as expressions of symbols."""
    found: Any = readings(time, y, inputs)
    return found if isinstance(found, ca.SX) else np.array(found)


def actuator_functions(traced: TracedMechanism, forces: ActuatorForces) -> ActuatorFunctions:
    """All functions of the actuators."""
    columns = [
        _column(actuator, port, motor)
        for actuator, port, motor in zip(traced.mechanism.actuators, forces.ports, forces.motors, strict=True)
    ]
    rows = max(column.shape[0] for column in columns)
    table = ca.horzcat(*(ca.vertcat(column, ca.SX(rows - column.shape[0], 1)) for column in columns))
    given = [traced.state.t, traced.y, traced.inputs]
    readings = ca.Function("actuators", given, [ca.densify(table)], {"cse": True})
    layout, end = traced.actuators, traced.y.shape[0]
    unread = frozenset([*layout.energies, *layout.lines, *range(end - traced.audit.shape[0], end)])
    held = frozenset([*layout.held, *layout.lines])
    between_steps = BetweenSteps(tuple(_delays(traced)), tuple(_samplers(traced, forces)), held, unread)
    centers = [np.zeros(3)] * len(traced.input_layout.loaded)
    base_inputs = traced.input_layout.without_commands(centers, traced.parameters.base)
    return ActuatorFunctions(traced.actuators, readings, between_steps, base_inputs)


def require_within_strokes(mechanism: Mechanism, functions: ActuatorFunctions, y: Array) -> None:
    """Refuse cylinders whose piston is beyond its stroke at the start.

    :param y: the start state.
    :raises MechanismError: the cylinders are named, with the position and the ends of the stroke.
    """
    problems = []
    positions = np.array(functions.readings(0.0, y, functions.base_inputs))[0]
    for actuator, x in zip(mechanism.actuators, positions, strict=True):
        if not isinstance(cylinder := actuator.motor, FluidCylinder):
            continue
        ends = cylinder.retracted, cylinder.retracted + cylinder.stroke
        if not ends[0] - ROUNDING * cylinder.stroke <= x <= ends[1] + ROUNDING * cylinder.stroke:
            message = f"starts at {x:.6g} m, beyond its stroke from {ends[0]:.6g} m to {ends[1]:.6g} m"
            remedy = "Give another 'retracted' or 'stroke', or another start position."
            problems.append(mechanism.source.problem(("actuators", actuator.name), message, remedy))
    if problems:
        raise MechanismError(problems)


def _column(actuator: Actuator, port: PortMotion, motor: MotorOutput | CylinderOutput) -> ca.SX:
    """The readings of an actuator."""
    if isinstance(motor, MotorOutput):
        electrical, losses = motor.voltage * motor.current, (motor.copper_loss, motor.friction_loss)
        mechanical = motor.effort * port.v
        return ca.vertcat(port.x, port.v, motor.effort, motor.voltage, motor.current, electrical, mechanical, *losses)
    assert isinstance(actuator.motor, FluidCylinder)
    energies = [energy(actuator.motor, motor.pressures, port.x) for energy in (stored_energy, displaced_energy)]
    flows, powers = motor.flows, (motor.fluid_power, motor.throttling_loss)
    return ca.vertcat(port.x, port.v, motor.effort, *motor.pressures, *flows, *powers, *energies)


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
    signals = servo_signals(traced, actuator, slots, port)
    if "reference" in states:
        command = commands_in_effect(traced, slots, actuator.command_range)[servo.controls]
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
