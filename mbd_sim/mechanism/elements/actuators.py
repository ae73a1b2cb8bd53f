"""Actuators as plain records: motors, servos, hydraulic and pneumatic cylinders, and wheeled bases.

An actuator acts along its port, a coordinate or the line between two points. The port has a position x and a speed v:
those of the coordinate, or the distance of the points and its rate. The effort in N or N·m is positive where it
increases x. SI units throughout.

A wheeled base gives the commands of its wheels and steering joints for a velocity of the base, for rolling without
slip (Siegwart, Nourbakhsh & Scaramuzza, sec. 3.2). Its frame has x forward, y to the left and its origin in the middle
between the wheels, for a car in the middle of the axle that is not steered.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, NamedTuple, Self, assert_never

from mbd_sim.base.errors import CommandError, listed
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.linear_algebra import added
from mbd_sim.base.short_repr import record
from mbd_sim.mechanism.elements.joint_types import Channel
from mbd_sim.mechanism.elements.parts import Attachment


@dataclass(frozen=True)
class Oil:
    """A liquid with the `bulk_modulus` β in Pa, and a valve with the flow K √Δp in m³/s when it is fully open.

    `valve` is K in m³/(s·√Pa), and `leakage` in m³/(s·Pa) is the flow past the piston per pressure difference.
    """

    bulk_modulus: float
    valve: float
    leakage: float = 0.0


@dataclass(frozen=True)
class Gas:
    """An ideal gas whose changes of state have the polytropic `exponent` n; 1 is isothermal.

    `valve` and `leakage` in m³/(s·Pa) are the sonic conductances C by ISO 6358 of the fully open valve and of the gap
    at the piston, `critical_ratio` is b, the ratio of pressures up to which the flow is choked.
    """

    exponent: float
    valve: float
    critical_ratio: float
    leakage: float = 0.0


PRESSURES = ("pressure_a", "pressure_b")  # Pa, the states of a cylinder


@dataclass(frozen=True)
class FluidCylinder:
    """A piston between two chambers, and a valve that connects one of them to the supply and the other to the tank.

    Chamber A, the first of each pair, extends the cylinder and has the opening of the valve as its sign: see
    `mbd_sim.dynamics.actuators.cylinders`. `areas` of the piston are in m², `dead_volumes` at the ends of the stroke in
    m³. The piston moves from the position `retracted` of the port over the `stroke`, in m.

    Pressures in Pa are absolute with a gas, and relative to the ambient pressure with oil. `pressures` are those at the
    start, and that of the `tank` also acts on the outside of the piston with a gas. Below a pressure difference of
    `transition` in Pa the flow becomes laminar.
    """

    fluid: Oil | Gas
    areas: tuple[float, float]
    dead_volumes: tuple[float, float]
    retracted: float
    stroke: float
    supply: float
    tank: float
    transition: float
    pressures: tuple[float, float]
    control: ClassVar[Literal["opening"]] = "opening"
    electric: ClassVar[bool] = False  # whether it has a voltage and a current
    has_states: ClassVar[bool] = True
    gear: ClassVar[float] = 1.0
    rotor_inertia: ClassVar[float] = 0.0  # no rotor

    @property
    def start_states(self) -> Mapping[str, float]:
        """Its states before the first command that are not zero, by name."""
        return dict(zip(PRESSURES, self.pressures, strict=True))

    def with_start_states(self, values: Mapping[str, float]) -> FluidCylinder:
        """The same cylinder with other start states."""
        first, second = (values[name] for name in PRESSURES)
        return replace(self, pressures=(first, second))


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


class _StartsAtRest:
    """A machine whose own states are zero before the first command."""

    start_states: ClassVar[Mapping[str, float]] = {}

    def with_start_states(self, values: Mapping[str, float]) -> Self:
        """The same machine: there are no such states."""
        return self


@dataclass(frozen=True)
class EffortMotor(_StartsAtRest):
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
    electric: ClassVar[bool] = False
    has_states: ClassVar[bool] = False


@dataclass(frozen=True)
class DcMotor(_StartsAtRest):
    """A motor with L i' = u - R i - k ω at the speed ω = `gear` v of its rotor, and the torque k i.

    `control` is what is commanded: the voltage u in V, the current i in A, or the effort that i has without losses.
    The drive keeps |i| within `current_limit` as long as |u| stays within `voltage_limit`. With an inductance, its
    current follows that commanded at the rate `bandwidth` in rad/s. `coulomb` in N·m and `viscous` in N·m·s are the
    friction of the rotor; coulomb friction is smooth below the speed `regularization` in rad/s, as the loss of a gear
    with an `efficiency` below 1 is: see `mbd_sim.dynamics.actuators.motors`.
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
    electric: ClassVar[bool] = True

    @property
    def has_states(self) -> bool:
        """Whether its current does not follow its command at once."""
        return self.inductance > 0.0


Motor = EffortMotor | DcMotor
Machine = Motor | FluidCylinder


@dataclass(frozen=True)
class Servo:
    """A controller of the port's position or velocity, with the motor's command: `mbd_sim.dynamics.actuators.forces`.

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


@record
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
            case FluidCylinder():
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


BaseType = Literal["differential", "mecanum", "car"]


class Velocity(NamedTuple):
    """The velocity of a base in its own frame, in m/s, and its yaw rate in rad/s."""

    x: float
    y: float
    yaw: float

    @classmethod
    def of(cls, linear: Sequence[float], angular: Sequence[float]) -> Velocity:
        """The velocity from all components (3,) in m/s and rad/s.

        :raises CommandError: one is not finite, or leads out of the plane.
        """
        if not all(map(math.isfinite, (*linear, *angular))):
            raise CommandError("the velocity is not finite", "Give finite numbers.")
        parts = {"linear.z": linear[2], "angular.x": angular[0], "angular.y": angular[1]}
        if wrong := [name for name, value in parts.items() if value]:
            raise CommandError(f"{listed(wrong)} would lead out of the plane of the base", "Set all of them to zero.")
        return cls(linear[0], linear[1], angular[2])


@dataclass(frozen=True)
class Wheel:
    """A wheel whose speed `taker` controls, an actuator or the joint of a drive.

    `rates` are the speeds of the wheel in rad/s for a `Velocity` of 1 in each component. Speeds up to `limit` can be
    commanded.
    """

    taker: str
    rates: tuple[float, float, float]
    limit: float = math.inf


@dataclass(frozen=True)
class Steering:
    """A joint that steers a wheel at x and y in m. Its angle, positive to the left, is that of `taker` times `sign`.

    It stays between `lower` and `upper` in rad.
    """

    taker: str
    x: float
    y: float
    sign: float = 1.0
    lower: float = -math.inf
    upper: float = math.inf


@dataclass(frozen=True, slots=True)
class BaseCommands:
    """Commands by taker and channel; `limited` if they are slower, or turn less, than was wanted."""

    takers: Mapping[str, Mapping[Channel, float]]
    limited: bool


@dataclass(frozen=True)
class Base:
    """A base on wheels; that of a car has `steering`."""

    name: str
    type: BaseType
    wheels: tuple[Wheel, ...]
    steering: tuple[Steering, ...] = ()

    def commands(self, wanted: Velocity) -> BaseCommands:
        """The commands with which the base moves with a velocity.

        Where a wheel would be too fast, all are slowed down alike; where a wheel cannot be steered that far, all are
        steered less.

        :raises CommandError: the base cannot move in this direction.
        """
        if wanted.y and self.type != "mecanum":
            raise CommandError(f"this base cannot move sideways, but linear.y is {wanted.y:g}", "Set it to zero.")
        takers: dict[str, dict[Channel, float]] = {}
        moved = wanted
        if self.steering and math.isfinite(wanted.yaw / (wanted.x or math.nan)):
            curvature = self._curvature(wanted.yaw / wanted.x)
            moved = Velocity(wanted.x, 0.0, wanted.x * curvature)
            for one in self.steering:
                angle = math.atan2(curvature * one.x, 1.0 - curvature * one.y)
                takers[one.taker] = {"position": one.sign * angle}
        elif self.steering and wanted.yaw:
            raise CommandError(
                f"a car cannot turn on the spot, but angular.z is {wanted.yaw:g}", "Set linear.x as well."
            )
        speeds = [added(rate * part for rate, part in zip(wheel.rates, moved, strict=True)) for wheel in self.wheels]
        scale = min([1.0, *(wheel.limit / abs(v) for wheel, v in zip(self.wheels, speeds, strict=True) if v)])
        for wheel, speed in zip(self.wheels, speeds, strict=True):
            takers[wheel.taker] = {"velocity": speed * scale}
        return BaseCommands(takers, scale < 1.0 or (moved != wanted and not math.isclose(moved.yaw, wanted.yaw)))

    def _curvature(self, wanted: float) -> float:
        """The curvature in 1/m nearest to a wanted one at which all wheels can be steered."""
        for one in self.steering:
            for angle, nearest in ((one.lower, max), (one.upper, min)):
                if math.isfinite(angle):
                    slope = math.tan(angle)
                    wanted = nearest(wanted, slope / (one.x + one.y * slope))
        return wanted
