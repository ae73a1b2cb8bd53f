"""Actuators as plain records: motors and cylinders on a coordinate or between two points, servos, and commands.

An actuator acts along its port, with a position x and a speed v: those of a coordinate, or the distance of two points
and its rate. Its effort in N or N·m is positive where it increases x. SI units throughout.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal, assert_never

from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.channels import Channel
from mbd_sim.mechanism.cylinders import Cylinder
from mbd_sim.mechanism.records import Attachment
from mbd_sim.short_repr import short_repr

if TYPE_CHECKING:
    from mbd_sim.mechanism.records import Mechanism

Control = Literal["effort", "voltage", "current", "opening"]


@dataclass(frozen=True)
class CoordinatePort:
    """A coordinate of a joint, by its name."""

    coordinate: str
    rotation: bool


@dataclass(frozen=True, eq=False)
class LinePort:
    """The line between two points; a positive effort pushes them apart."""

    first: Attachment
    second: Attachment
    rotation: bool = False


@dataclass(frozen=True)
class SumPort:
    """A sum of coordinates with factors: an effort acts on each of them with its factor.

    Components of an angular velocity have no position, and add nothing to that of the port.
    """

    factors: Mapping[str, float]
    rotation: bool


@dataclass(frozen=True, eq=False)
class WrenchPort:
    """A point of a part on which a force and a couple act for each unit of effort, in the part's axes.

    Its speed is that along them; it has no position.
    """

    at: Attachment
    force: Array
    couple: Array
    rotation: bool = False


Port = CoordinatePort | LinePort | SumPort | WrenchPort


@dataclass(frozen=True)
class EffortMotor:
    """A motor that exerts the commanded effort, up to `effort_limit`, and up to its curve where it drives.

    `curve` are pairs of a speed |v| and the largest effort at it, linear between them and constant beyond. Where the
    motor brakes, the curve's value at rest is the limit. `gear` is the speed of the rotor in rad/s for v = 1, and
    `rotor_inertia` in kg·m² is that of the rotor about its own axis.

    An effort c that is commanded becomes (g₀ + g₁ x + g₂ v) c + b₀ + b₁ x + b₂ v with `gain` g and `bias` b, and then
    stays within the limit and the `effort_range`.
    """

    effort_limit: float = math.inf
    curve: tuple[tuple[float, float], ...] = ()
    effort_range: tuple[float, float] = (-math.inf, math.inf)
    gain: tuple[float, float, float] = (1.0, 0.0, 0.0)
    bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gear: float = 1.0
    rotor_inertia: float = 0.0
    control: ClassVar[Literal["effort"]] = "effort"
    has_states: ClassVar[bool] = False


@dataclass(frozen=True)
class DcMotor:
    """A motor with L i' = u - R i - k ω at the speed ω = `gear` v of its rotor, and the torque k i.

    `control` is what is commanded: the voltage u in V, the current i in A, or the effort that i has without losses.
    The drive keeps |i| within `current_limit` as long as |u| stays within `voltage_limit`. With an inductance, its
    current follows that commanded at the rate `bandwidth` in rad/s. `coulomb` in N·m and `viscous` in N·m·s are the
    friction of the rotor; coulomb friction is smooth below the speed `regularization` in rad/s, as the loss of a gear
    with an `efficiency` below 1 is: see `mbd_sim.dynamics.motors`.
    """

    torque_constant: float
    resistance: float
    inductance: float = 0.0
    voltage_limit: float = math.inf
    current_limit: float = math.inf
    gear: float = 1.0
    efficiency: float = 1.0
    rotor_inertia: float = 0.0
    coulomb: float = 0.0
    viscous: float = 0.0
    regularization: float = 0.1
    control: Control = "voltage"
    bandwidth: float = 0.0

    @property
    def has_states(self) -> bool:
        """Whether its current does not follow its command at once."""
        return self.inductance > 0.0


Motor = EffortMotor | DcMotor
Machine = Motor | Cylinder


@dataclass(frozen=True)
class Servo:
    """A controller of the port's position or velocity, with the motor's command: `mbd_sim.dynamics.servos`.

    Gains are in units of the output for 1 rad or m, or 1 rad/s or m/s, and per second (`ki`) or times a second (`kd`).
    `feedforward` multiplies the commanded velocity. The output stays within `limit`; beyond it, the integral follows
    with `tracking_time` in s. The reference follows the command by at most `rate_limit` per second. With a `period` in
    s the servo is sampled, otherwise it is continuous.
    """

    controls: Literal["position", "velocity"]
    kp: float
    ki: float = 0.0
    kd: float = 0.0
    feedforward: float = 0.0
    limit: float = math.inf
    tracking_time: float = math.inf
    rate_limit: float = math.inf
    period: float | None = None


@dataclass(frozen=True, eq=False)
class Actuator:
    """A motor or a cylinder at a port, perhaps with a servo. Commands act after `delay` in s, in whole steps.

    `start` are the commands before the first one, by channel, where they are not those of `default_command`. Those of
    the first channel act within `command_range`.
    """

    name: str
    port: Port
    motor: Machine
    servo: Servo | None
    start: Mapping[str, float]
    delay: float = 0.0
    command_range: tuple[float, float] = (-math.inf, math.inf)

    __repr__ = short_repr

    @property
    def control(self) -> Control:
        """What commands the motor, or the opening of the valve."""
        return self.motor.control

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The commands that it takes, in their order among the inputs.

        A velocity with commands of the position, and an effort with either, are feedforward.
        """
        if self.servo is None:
            return (self.control,)
        wanted: tuple[Channel, ...] = ("position", "velocity") if self.servo.controls == "position" else ("velocity",)
        return (*wanted, "effort") if self.control == "effort" else wanted

    @property
    def has_states(self) -> bool:
        """Whether its effort depends on more than the motion and the commands."""
        servo = self.servo
        own = servo is not None and (servo.period is not None or servo.ki > 0.0 or servo.rate_limit < math.inf)
        return self.motor.has_states or own or self.delay > 0.0

    @property
    def output_limit(self) -> float:
        """The largest size of what commands the motor."""
        match self.motor:
            case Cylinder():
                return 1.0
            case EffortMotor(effort_limit=limit, curve=curve):
                return min(limit, max((effort for _, effort in curve), default=math.inf))
            case DcMotor(control="voltage"):
                return self.motor.voltage_limit
            case DcMotor(control="current"):
                return self.motor.current_limit
            case DcMotor():
                return self.motor.current_limit * self.motor.torque_constant * self.motor.gear
            case _:
                assert_never(self.motor)


def line_ports(mechanism: Mechanism) -> dict[str, LinePort]:
    """The lines along which actuators act, by the name of the actuator."""
    return {actuator.name: actuator.port for actuator in mechanism.actuators if isinstance(actuator.port, LinePort)}


def has_actuator_states(mechanism: Mechanism) -> bool:
    """Whether the motion depends on states of actuators: currents, pressures, integrals, or what a servo holds."""
    return any(actuator.has_states for actuator in mechanism.actuators)
