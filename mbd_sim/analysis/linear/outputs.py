"""What the outputs of a linear system can be: motions of joints and points, loads, sensors and actuators."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial

import casadi as ca
import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.actuators.functions import reading_names
from mbd_sim.dynamics.equations import Equations
from mbd_sim.dynamics.math.expressions import all_evaluated
from mbd_sim.dynamics.measurements import measured_values
from mbd_sim.mechanism.elements.sensors import ORIENTATION, AnySensor, ForceTorque
from mbd_sim.mechanism.mechanism import Mechanism

AXES = ("x", "y", "z")
POINT_UNITS = {
    "position": "m",
    "rotation": "rad",
    "velocity": "m/s",
    "angular_velocity": "rad/s",
    "acceleration": "m/s²",
    "angular_acceleration": "rad/s²",
}
ACTUATOR_UNITS = {
    "position": "m or rad",
    "velocity": "m/s or rad/s",
    "effort": "N or N·m",
    **dict.fromkeys(("electrical", "mechanical", "copper", "friction", "fluid", "throttling"), "W"),
    **dict.fromkeys(("pressure_a", "pressure_b"), "Pa"),
    **dict.fromkeys(("flow_a", "flow_b"), "m³/s or W"),
    "voltage": "V",
    "current": "A",
    **dict.fromkeys(("stored", "displaced"), "J"),
}


@dataclass(frozen=True, slots=True)
class LinearOutput:
    """A number with the expression of its value.

    `reaction_row` is its row in the reactions of all joints, -1 for another load that redundant joints share, or None.
    """

    name: str
    unit: str
    value: Callable[[], ca.SX]
    reaction_row: int | None = None


@dataclass(frozen=True, eq=False)
class LinearizationPoint:
    """The arguments t, y and inputs of equations as symbols, and a state (t, y, inputs) in numbers."""

    symbols: tuple[ca.SX, ca.SX, ca.SX]
    values: tuple[float, Array, Array]

    def called(self, function: ca.Function) -> ca.SX:
        """The output of a function of t, y and perhaps the inputs."""
        return function.call(list(self.symbols[: function.n_in()]))[0]

    def at(self, expression: ca.SX) -> Array:
        """The value of an expression in the state."""
        return all_evaluated(ca.Function("at", list(self.symbols), [ca.densify(expression)]), *self.values)[0]


def possible_outputs(equations: Equations, mechanism: Mechanism, state: LinearizationPoint) -> dict[str, LinearOutput]:
    """All outputs of a mechanism at a state by name, in a fixed order.

    Positions, rotations and velocities are relative to ground, accelerations of points and sensors are absolute: ground
    itself may accelerate. Vectors are in ground's axes, those of sensors in the axes of their frames.

    :param equations: with disturbances.
    :param mechanism: that of the equations, or a variant with the values among the inputs.
    """
    return {output.name: output for output in _Outputs(equations, mechanism, state).all()}


class _Outputs:
    def __init__(self, equations: Equations, mechanism: Mechanism, state: LinearizationPoint) -> None:
        self._equations, self._mechanism, self._state = equations, mechanism, state

    def all(self) -> Iterator[LinearOutput]:
        yield from self._joints()
        yield from self._loads()
        yield from self._points()
        yield from self._sensors()
        yield from self._actuators()

    def _joints(self) -> Iterator[LinearOutput]:
        equations, measurements = self._equations, self._equations.measurements
        layout, state = equations.layout, self._state
        y, driven = state.symbols[1], list(self._mechanism.driven_names)
        for name, joint in self._mechanism.joints.items():
            for number, coordinate in enumerate(joint.kind.coordinates):
                own = joint.motion_names[number]
                if joint.drive:
                    row = driven.index(own)
                    count = len(driven)
                    position, velocity = (self._entry(equations.drives, place) for place in (row, count + row))
                    yield LinearOutput(
                        f"joints.{own}.effort", coordinate.effort_unit, self._entry(equations.drives, 2 * count + row)
                    )
                    place = layout.nv + row
                else:
                    place = layout.u[name].start + number
                    position = self._position(name, number)
                    velocity = _entry_of(y, layout.nq + place)
                yield LinearOutput(f"joints.{own}.position", coordinate.unit, position)
                yield LinearOutput(f"joints.{own}.velocity", f"{coordinate.unit}/s", velocity)
                acceleration = self._entry(measurements.accelerations, place)
                yield LinearOutput(f"joints.{own}.acceleration", f"{coordinate.unit}/s²", acceleration)

    def _position(self, joint: str, number: int) -> Callable[[], ca.SX]:
        """A coordinate of a joint; those of an orientation are small rotations about the axes of the part."""
        span, offset = self._equations.layout.q[joint], self._mechanism.joints[joint].kind.quaternion
        y = self._state.symbols[1]
        if offset is None or number < offset:
            return _entry_of(y, span.start + number)
        first = span.start + offset
        w, *v = self._state.values[1][first : first + 4].tolist()
        moved = y[first : first + 4]
        turned = w * moved[1:] - ca.SX(ca.DM(v)) * moved[0] - ca.cross(ca.SX(ca.DM(v)), moved[1:])
        return _entry_of(2.0 * turned, number - offset)

    def _loads(self) -> Iterator[LinearOutput]:
        for row, name in enumerate([*self._mechanism.joints, *self._mechanism.closing]):
            for number, (quantity, unit) in enumerate((("force", "N"), ("moment", "N·m"))):
                for place, axis in enumerate(AXES, 6 * row + 3 * number):
                    value = self._entry(self._equations.reactions, place)
                    yield LinearOutput(f"joints.{name}.{quantity}.{axis}", unit, value, place)

    @cached_property
    def _motions(self) -> ca.SX:
        return self._state.called(self._equations.measurements.part_motions)

    @cached_property
    def _poses(self) -> ca.SX:
        return self._state.called(self._equations.poses)

    def _points(self) -> Iterator[LinearOutput]:
        for number, part in enumerate(self._equations.part_names):
            for name, pose in (("", None), *self._mechanism.parts[part].points.items()):
                local = np.zeros(3) if pose is None else pose.position
                frame = f"{part}.{name}" if name else part
                for quantity, unit in POINT_UNITS.items():
                    for row, axis in enumerate(AXES):
                        value = partial(self._point, number, local, quantity, row)
                        yield LinearOutput(f"points.{frame}.{quantity}.{axis}", unit, value)

    def _point(self, part: int, local: Array, quantity: str, row: int) -> ca.SX:
        return self._of_point(part, local, quantity)[row]

    def _of_point(self, part: int, local: Array, quantity: str) -> ca.SX:
        """A quantity (3,) of a point at `local` (3,) in a part."""
        pose, motion = self._poses[12 * part : 12 * part + 12], self._motions[:, part]
        rotation = ca.reshape(pose[3:], 3, 3)
        arm = rotation @ ca.DM(local)
        velocity, omega, acceleration, omega_rate = ca.vertsplit(motion, 3)
        match quantity:
            case "position":
                return pose[:3] + arm
            case "rotation":
                return turning(rotation, self._state.at(rotation))
            case "velocity":
                return velocity + ca.cross(omega, arm)
            case "angular_velocity":
                return omega
            case "acceleration":
                ground = self._state.symbols[2][self._equations.inputs.disturbances][-3:]
                return ground + acceleration + ca.cross(omega_rate, arm) + ca.cross(omega, ca.cross(omega, arm))
            case _:
                return omega_rate

    def _sensors(self) -> Iterator[LinearOutput]:
        for sensor in self._mechanism.sensors:
            row = 0
            for quantity in sensor.quantities:
                for component in quantity.components:
                    label = f".{component}" if component else ""
                    load = -1 if isinstance(sensor, ForceTorque) else None
                    value = partial(self._measured, sensor, row)
                    yield LinearOutput(f"sensors.{sensor.name}.{quantity.name}{label}", quantity.unit, value, load)
                    row += 1

    @cached_property
    def _exact(self) -> dict[str, ca.Function]:
        return self._equations.measurements.sensors(self._equations.actuators)

    def _measured(self, sensor: AnySensor, row: int) -> ca.SX:
        return self._sensor(sensor)[row]

    def _sensor(self, sensor: AnySensor) -> ca.SX:
        """The values of a sensor without its errors, delay and resolution."""
        exact = measured_values(sensor, self._state.called(self._exact[sensor.name]))
        values, first = [], 0
        for quantity in sensor.quantities:
            size = 9 if quantity is ORIENTATION else len(quantity.components)
            part = exact[first : first + size]
            if quantity is ORIENTATION:
                rotation = ca.reshape(part, 3, 3)
                place = self._state.at(rotation)
                part = ca.DM(place).T @ turning(rotation, place)
            values.append(part)
            first += size
        return ca.vertcat(*values)

    def _actuators(self) -> Iterator[LinearOutput]:
        if (functions := self._equations.actuators) is None:
            return
        for column, actuator in enumerate(self._mechanism.actuators):
            for row, reading in enumerate(reading_names(actuator.motor)):
                place = column * functions.readings.size1_out(0) + row
                unit = ACTUATOR_UNITS[reading]
                yield LinearOutput(f"actuators.{actuator.name}.{reading}", unit, self._entry(functions.readings, place))

    def _entry(self, function: ca.Function, place: int) -> Callable[[], ca.SX]:
        return lambda: ca.vec(self._state.called(function))[place]


def turning(rotation: ca.SX, place: Array) -> ca.SX:
    """The rotation vector (3,) in rad of a small rotation from `place` (3, 3) to a rotation (3, 3), in fixed axes."""
    columns = range(3)
    return 0.5 * sum((ca.cross(ca.SX(ca.DM(place[:, one])), rotation[:, one]) for one in columns), ca.SX(3, 1))


def _entry_of(vector: ca.SX, place: int) -> Callable[[], ca.SX]:
    return lambda: vector[place]
