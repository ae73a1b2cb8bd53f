"""The readings of actuators: commands, efforts, currents, powers, and the account of their energies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from mbd_sim.dynamics.actuator_functions import READINGS
from mbd_sim.dynamics.actuator_layout import ActuatorLayout
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.actuators import Actuator, Channel, CoordinatePort, DcMotor


class ActuatorEnergies(NamedTuple):
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


class ActuatorState(NamedTuple):
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


def actuator_states(
    actuators: Sequence[Actuator], layout: ActuatorLayout, columns: Array, y: Array, inputs: Array
) -> dict[str, ActuatorState]:
    """Each actuator by name.

    :param columns: (n, 9) the readings of each actuator, see `READINGS`.
    :param y: the state, `inputs` those of the equations.
    """
    found = {}
    for actuator, slots, row in zip(actuators, layout.slots, columns.tolist(), strict=True):
        read = dict(zip(READINGS, row, strict=True))
        where, source = (slots.states, y) if slots.delay else (slots.commands, inputs)
        commands = {channel: float(source[where[channel]]) for channel in slots.commands}
        energies = {name: float(y[index]) for name, index in slots.energies.items()}
        is_electric = isinstance(actuator.motor, DcMotor)
        found[actuator.name] = ActuatorState(
            commands=commands,
            position=read["position"],
            velocity=read["velocity"],
            effort=read["effort"],
            voltage=read["voltage"] if is_electric else None,
            current=read["current"] if is_electric else None,
            electrical=read["electrical"] if is_electric else read["mechanical"],
            mechanical=read["mechanical"],
            copper_loss=read["copper"],
            friction_loss=read["friction"],
            energies=_account(actuator, energies, read["current"]),
        )
    return found


def efforts_on(actuators: Sequence[Actuator], columns: Array, coordinates: Sequence[str]) -> Array:
    """The efforts of actuators on each of the coordinates, in N and N·m.

    :param columns: (n, 9) the readings of each actuator, see `READINGS`.
    """
    efforts = np.zeros(len(coordinates))
    for actuator, row in zip(actuators, columns, strict=True):
        if isinstance(actuator.port, CoordinatePort):
            efforts[coordinates.index(actuator.port.coordinate)] += row[READINGS.index("effort")]
    return efforts


def _account(actuator: Actuator, energies: Mapping[str, float], current: float) -> ActuatorEnergies:
    mechanical = energies["mechanical_work"]
    if not isinstance(actuator.motor, DcMotor):
        return ActuatorEnergies(mechanical, mechanical, 0.0, 0.0, 0.0, 0.0)
    electrical, copper, friction = (
        energies["electrical_work"],
        energies["copper_loss"],
        energies.get("friction_loss", 0.0),
    )
    stored = 0.5 * actuator.motor.inductance * current**2
    return ActuatorEnergies(
        electrical, mechanical, copper, friction, stored, electrical - mechanical - copper - friction - stored
    )
