"""The readings of actuators: commands, efforts, currents, pressures, powers, and the account of their energies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import assert_never

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.short_repr import short_repr
from mbd_sim.dynamics.actuators.functions import CYLINDER_READINGS, MOTOR_READINGS
from mbd_sim.dynamics.layouts.actuators import ActuatorLayout
from mbd_sim.mechanism.elements.actuators import Actuator, CoordinatePort, DcMotor, EffortMotor, FluidCylinder, Motor
from mbd_sim.mechanism.elements.joint_types import Channel


@dataclass(frozen=True, slots=True)
class ActuatorEnergies:
    """The account of an actuator since the start, in J: electrical = mechanical + losses + change of the stored energy.

    `stored` is that of the inductance. `residual` is what is missing: the error of the integration. For effort motors,
    of which the electrical side is not modeled, the electrical work is that on the mechanism.
    """

    electrical_work: float
    mechanical_work: float
    copper_loss: float
    friction_loss: float
    stored: float
    residual: float

    __repr__ = short_repr


@dataclass(frozen=True, slots=True)
class ActuatorState:
    """An actuator at a moment.

    `commands` are those in effect, after their delay, by channel: rad or m, rad/s or m/s, N·m or N, V, A. `position`
    and `velocity` are those of its coordinate, or of the distance of its points; `effort` is what it exerts along it.
    `voltage` in V and `current` in A are None for effort motors. Powers and losses are in W: `electrical` flows in,
    `mechanical` out; `copper_loss` is R i², and `friction_loss` that of the rotor's friction and the gear.
    """

    commands: Mapping[Channel, float]
    position: float
    velocity: float
    effort: float
    voltage: float | None
    current: float | None
    electrical: float
    mechanical: float
    copper_loss: float
    friction_loss: float
    energies: ActuatorEnergies

    __repr__ = short_repr


@dataclass(frozen=True, slots=True)
class CylinderEnergies:
    """The account of a cylinder since the start, in J: fluid = mechanical + throttling + change of the stored energy.

    `fluid_work` is the energy of the fluid from the supply less that of the fluid to the tank, `throttling_loss` is
    that in the valve and past the piston, integrated by parts. `stored` is the change of the energy of the fluid in the
    chambers: see `mbd_sim.dynamics.actuators.cylinders`. `residual` is what is missing: the error of the integration.
    """

    fluid_work: float
    mechanical_work: float
    throttling_loss: float
    stored: float
    residual: float

    __repr__ = short_repr


@dataclass(frozen=True, slots=True)
class CylinderState:
    """A cylinder at a moment.

    `commands`, `position`, `velocity` and `effort` are as in `ActuatorState`; `pressures` in Pa and `flows` through the
    valve into the chamber that extends the cylinder, and into the other one: in m³/s for oil, and for a gas R T times
    the mass flow, in W. Powers and losses are in W: `fluid` flows in, `mechanical` out.
    """

    commands: Mapping[Channel, float]
    position: float
    velocity: float
    effort: float
    pressures: tuple[float, float]
    flows: tuple[float, float]
    fluid: float
    mechanical: float
    throttling_loss: float
    energies: CylinderEnergies

    __repr__ = short_repr


AnyActuatorState = ActuatorState | CylinderState


def states_of_actuators(
    actuators: Sequence[Actuator], layout: ActuatorLayout, columns: Array, y: Array, inputs: Array
) -> dict[str, AnyActuatorState]:
    """Each actuator by name.

    :param columns: (n, k) the readings of each actuator, see `ActuatorFunctions`.
    :param y: the state, `inputs` those of the equations.
    """
    found: dict[str, AnyActuatorState] = {}
    for actuator, slots, row in zip(actuators, layout.slots, columns.tolist(), strict=True):
        where, source = (slots.states, y) if slots.delay else (slots.commands, inputs)
        commands = {channel: float(source[where[channel]]) for channel in slots.commands}
        energies = {name: float(y[index]) for name, index in slots.energies.items()}
        match actuator.motor:
            case EffortMotor() | DcMotor():
                found[actuator.name] = _motor_state(actuator.motor, commands, energies, row)
            case FluidCylinder():
                found[actuator.name] = _cylinder_state(commands, energies, row)
            case _:
                assert_never(actuator.motor)
    return found


def _motor_state(
    motor: Motor, commands: Mapping[Channel, float], energies: Mapping[str, float], row: Sequence[float]
) -> ActuatorState:
    read = dict(zip(MOTOR_READINGS, row, strict=False))
    return ActuatorState(
        commands=commands,
        position=read["position"],
        velocity=read["velocity"],
        effort=read["effort"],
        voltage=read["voltage"] if motor.electric else None,
        current=read["current"] if motor.electric else None,
        electrical=read["electrical"] if motor.electric else read["mechanical"],
        mechanical=read["mechanical"],
        copper_loss=read["copper"],
        friction_loss=read["friction"],
        energies=_account(motor, energies, read["current"]),
    )


def _cylinder_state(
    commands: Mapping[Channel, float], energies: Mapping[str, float], row: Sequence[float]
) -> CylinderState:
    read = dict(zip(CYLINDER_READINGS, row, strict=True))
    fluid, mechanical = energies["fluid_work"], energies["mechanical_work"]
    stored = read["stored"] - energies["stored_at_start"]
    loss = fluid - stored - (read["displaced"] - energies["compression_work"])
    return CylinderState(
        commands=commands,
        position=read["position"],
        velocity=read["velocity"],
        effort=read["effort"],
        pressures=(read["pressure_a"], read["pressure_b"]),
        flows=(read["flow_a"], read["flow_b"]),
        fluid=read["fluid"],
        mechanical=read["effort"] * read["velocity"],
        throttling_loss=read["throttling"],
        energies=CylinderEnergies(fluid, mechanical, loss, stored, fluid - mechanical - loss - stored),
    )


def efforts_on(actuators: Sequence[Actuator], columns: Array, coordinates: Sequence[str]) -> Array:
    """The efforts of actuators on each of the coordinates, in N and N·m.

    :param columns: (n, k) the readings of each actuator, see `ActuatorFunctions`.
    """
    efforts = np.zeros(len(coordinates))
    for actuator, row in zip(actuators, columns, strict=True):
        if isinstance(actuator.port, CoordinatePort):
            efforts[coordinates.index(actuator.port.coordinate)] += row[MOTOR_READINGS.index("effort")]
    return efforts


def _account(motor: Motor, energies: Mapping[str, float], current: float) -> ActuatorEnergies:
    mechanical = energies["mechanical_work"]
    if isinstance(motor, EffortMotor):
        return ActuatorEnergies(mechanical, mechanical, 0.0, 0.0, 0.0, 0.0)
    electrical, copper = energies["electrical_work"], energies["copper_loss"]
    friction = energies.get("friction_loss", 0.0)
    stored = 0.5 * motor.inductance * current**2
    return ActuatorEnergies(
        electrical, mechanical, copper, friction, stored, electrical - mechanical - copper - friction - stored
    )
