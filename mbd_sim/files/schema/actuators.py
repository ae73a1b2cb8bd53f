"""The actuators of a mechanism file: motors, cylinders and wheeled bases, with their servos and commands."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, BeforeValidator, Field, WithJsonSchema, model_validator

from mbd_sim.base.errors import InputError
from mbd_sim.files.schema.fields import (
    AmountFromZero,
    AnyAmount,
    AnyNumber,
    Delay,
    Frequency,
    Length,
    PositiveAmount,
    PositiveAngularVelocity,
    PositiveLead,
    PositiveLength,
    PositiveTime,
    QuantityField,
    Spec,
    TorsionDamping,
)
from mbd_sim.files.schema.laws import FrictionTorque

PositiveRatio = Annotated[float, QuantityField("", above=0)]
Efficiency = Annotated[float, QuantityField("", above=0, at_most=1)]
RotorInertia = Annotated[float, QuantityField("kg*m**2", at_least=0)]
Voltage = Annotated[float, QuantityField("V", above=0)]
Current = Annotated[float, QuantityField("A", above=0)]
Area = Annotated[float, QuantityField("m**2", above=0)]
Volume = Annotated[float, QuantityField("m**3", above=0)]
Pressure = Annotated[float, QuantityField("Pa", above=0)]
GaugePressure = Annotated[float, QuantityField("Pa")]


def _curve(rows: list[tuple[float, float]]) -> list[tuple[float, float]]:
    if len(rows) < 2:
        raise InputError("needs at least two rows", "Add one, as [speed, effort].")
    if rows[0][0] != 0.0:
        raise InputError(f"begins at {rows[0][0]:g}", "Begin with the effort at rest, as [0, effort].")
    for (before, _), (after, _) in pairwise(rows):
        if after <= before:
            raise InputError(f"{after:g} comes after {before:g}", "Sort the rows by increasing speed.")
    return rows


Curve = Annotated[list[tuple[AmountFromZero, AmountFromZero]], AfterValidator(_curve)]


class ServoSpec(Spec):
    """A controller of the position or the velocity, whose output commands the motor.

    Its gains are in units of that (V, A, N or N*m) for 1 rad or m, or 1 rad/s or m/s, of the error; `ki` is per second,
    `kd` times a second. With a `sample_rate` it is sampled, and holds its output between samples.
    """

    controls: Literal["position", "velocity"]
    kp: AmountFromZero = Field(0.0, description="output for 1 rad or m, or for 1 rad/s or m/s")
    ki: AmountFromZero = Field(0.0, description="of the integral of the error")
    kd: AmountFromZero = Field(0.0, description="of the rate of the error")
    velocity_feedforward: AnyAmount = Field(0.0, description="output for 1 rad/s or m/s of the commanded velocity")
    limit: PositiveAmount | None = Field(None, description="of the output; by default that of the motor")
    tracking_time: PositiveTime | None = Field(
        None, description="time in which the integral follows a limited output; by default kp/ki"
    )
    rate_limit: PositiveAmount | None = Field(None, description="at which the reference follows the command")
    sample_rate: Frequency | None = Field(None, description="of a sampled servo; it must divide the rate of the steps")

    @model_validator(mode="after")
    def _consistent(self) -> ServoSpec:
        if not (self.kp or self.ki):
            raise InputError("has neither kp nor ki", "Give at least one of them.")
        if self.kd and self.controls == "velocity" and self.sample_rate is None:
            message = "a continuous velocity servo has no kd: it would depend on the acceleration that it causes"
            raise InputError(message, "Add 'sample_rate', or remove 'kd'.")
        if self.tracking_time is not None and not self.ki:
            raise InputError("tracking_time has no effect without ki", "Remove it, or add 'ki'.")
        period = 0.0 if self.sample_rate is None else 1.0 / self.sample_rate
        if self.tracking_time is not None and self.tracking_time < period:
            message = f"the tracking_time of {self.tracking_time:g} s is shorter than the sample period of {period:g} s"
            raise InputError(message, f"Give at least {period:g} s.")
        return self


class ActuatorSpec(Spec):
    """The keys of all actuators: where they act, what they command, and when.

    An actuator acts on a coordinate, `joint`, or on the distance of two points, `between`.
    """

    PLACES: ClassVar[tuple[str, ...]] = ("joint", "between")

    joint: str | None = Field(None, description="a joint, or a coordinate of one such as wrist.angle")
    between: tuple[str, str] | None = Field(None, description="two points, which a positive effort pushes apart")
    servo: ServoSpec | None = None
    command: dict[Literal["position", "velocity", "effort", "voltage", "current", "opening"], AnyAmount] = Field(
        {}, description="commands before the first one; by default the start position, and zero for all others"
    )
    command_range: tuple[AnyAmount, AnyAmount] | None = Field(
        None, description="within which the command acts: of the position or velocity of a servo, else of the motor"
    )
    delay: Delay = Field(0.0, description="of all commands, a whole number of steps")

    @model_validator(mode="after")
    def _one_place(self) -> ActuatorSpec:
        given = [key for key in self.PLACES if getattr(self, key) is not None]
        if len(given) != 1:
            has = " and ".join(given) if given else f"none of {', '.join(self.PLACES)}"
            raise InputError(f"has {has}", "Give one of them.")
        return self

    @model_validator(mode="after")
    def _ranges_go_up(self) -> ActuatorSpec:
        for key in ("command_range", "effort_range"):
            pair = getattr(self, key, None)
            if pair is not None and pair[0] > pair[1]:
                raise InputError(f"{key} goes from {pair[0]:g} down to {pair[1]:g}", "Write the smaller number first.")
        return self


class MotorSpec(ActuatorSpec):
    """The keys of all motors: their gear and their rotor."""

    gear_ratio: PositiveRatio = Field(1.0, description="revolutions of the rotor for one of the gear's output")
    lead: PositiveLead | None = Field(
        None, description="travel for one revolution of the gear's output, where the actuator moves along a line"
    )
    rotor_inertia: RotorInertia = Field(0.0, description="about the rotor's axis; it adds gear_ratio² times itself")

    @model_validator(mode="after")
    def _rotor_on_a_joint(self) -> MotorSpec:
        if self.between is not None and self.rotor_inertia:
            message = "has between and rotor_inertia, which would couple all joints between the two points"
            raise InputError(message, "Model the cylinder as two parts with a prismatic joint, and name that joint.")
        return self


class EffortActuatorSpec(MotorSpec):
    """A motor that exerts the commanded effort, within its limits.

    Besides a joint and two points, it may act on a sum of coordinates, with factors as `terms`, or exert a `wrench`
    at a point, `at`. `gain` [g0, g1, g2] and `bias` [b0, b1, b2] make of a command c the effort
    (g0 + g1 x + g2 v) c + b0 + b1 x + b2 v, with position x and speed v where it acts.
    """

    PLACES: ClassVar[tuple[str, ...]] = ("joint", "between", "terms", "at")

    type: Literal["effort"]
    terms: dict[str, AnyNumber] | None = Field(None, min_length=1)
    at: str | None = None
    wrench: tuple[AnyNumber, AnyNumber, AnyNumber, AnyNumber, AnyNumber, AnyNumber] | None = Field(
        None, description="force in N and couple in N*m for a command of 1, in the axes of the point"
    )
    effort_limit: PositiveAmount | None = None
    effort_range: tuple[AnyAmount, AnyAmount] | None = Field(None, description="a limit that differs by direction")
    gain: tuple[AnyNumber, AnyNumber, AnyNumber] = (1.0, 0.0, 0.0)
    bias: tuple[AnyNumber, AnyNumber, AnyNumber] = (0.0, 0.0, 0.0)
    torque_speed: Curve | None = Field(
        None, description="[speed, effort] pairs: the largest effort of the driving motor, from speed 0 on"
    )

    @model_validator(mode="after")
    def _places_without_axis(self) -> EffortActuatorSpec:
        if (self.at is None) != (self.wrench is None):
            raise InputError("'at' and 'wrench' belong together", "Give the point, and the force and couple there.")
        if self.joint is None and self.rotor_inertia:
            raise InputError("has a rotor_inertia, but acts on no joint", "Name the joint that turns the rotor.")
        if self.at is not None and self.servo is not None:
            raise InputError("a wrench at a point has no position to control", "Leave out 'servo'.")
        if self.servo is not None and self.model_fields_set & {"gain", "bias"}:
            raise InputError("has a servo, and gain or bias", "Give the gains of the servo alone.")
        return self


class DcMotorSpec(MotorSpec):
    """A DC motor with a gear; its `control` is the voltage, or the current of an inner loop."""

    type: Literal["dc_motor"]
    torque_constant: Annotated[float, QuantityField("N*m/A", above=0)] = Field(
        description="also the constant of the back-EMF, in V*s/rad"
    )
    resistance: Annotated[float, QuantityField("ohm", above=0)]
    inductance: Annotated[float, QuantityField("H", at_least=0)] = 0.0
    voltage_limit: Voltage | None = None
    current_limit: Current | None = None
    current_bandwidth: PositiveAngularVelocity | None = Field(
        None, description="of the current loop of a motor with inductance; by default 10 resistance/inductance"
    )
    efficiency: Efficiency = Field(1.0, description="of the gear")
    friction: FrictionTorque = Field(0.0, description="dry friction of the rotor")
    damping: TorsionDamping = Field(0.0, description="viscous friction of the rotor")
    regularization: PositiveAngularVelocity = Field(
        0.1, description="speed of the rotor below which dry friction and the loss of the gear fall to zero"
    )
    control: Literal["voltage", "current", "effort"] = Field(
        "voltage", description="what is commanded; an effort is that of the current without losses"
    )

    @model_validator(mode="after")
    def _bandwidth(self) -> DcMotorSpec:
        if self.current_bandwidth is not None and not self.inductance:
            raise InputError("current_bandwidth has no effect without inductance", "Remove it, or add 'inductance'.")
        return self


class FluidCylinderSpec(ActuatorSpec):
    """The keys of hydraulic and pneumatic cylinders; pairs are of the side that extends the cylinder and the other."""

    areas: tuple[Area, Area] = Field(description="of the piston, on the side that extends the cylinder and the other")
    stroke: PositiveLength
    retracted: Length | None = Field(
        None, description="position of the joint, or distance of the points, at the start of the stroke; 0 on a joint"
    )
    dead_volumes: tuple[Volume, Volume] = Field(description="of each chamber with its hose where it is smallest")
    transition: Pressure | None = Field(None, description="pressure drop below which flow becomes laminar")

    @model_validator(mode="after")
    def _starts_somewhere(self) -> FluidCylinderSpec:
        if self.between is not None and not (self.retracted or 0.0) > 0.0:
            given = "no 'retracted'" if self.retracted is None else f"'retracted' {self.retracted:g}"
            raise InputError(f"has between and {given}", "Give the distance of the points at the start of the stroke.")
        return self

    def _require_supply(self, supply: float, end: float, key: str) -> None:
        if supply <= end:
            raise InputError(f"the supply of {supply:g} Pa is not above the {key} of {end:g} Pa", "Give more.")


class HydraulicCylinderSpec(FluidCylinderSpec):
    """A cylinder with a proportional valve and oil; pressures are relative to that of the ambient air."""

    type: Literal["hydraulic_cylinder"]
    bulk_modulus: Pressure = Field(1.4e9, description="of the oil with its air, and of the hoses")
    rated_flow: Annotated[float, QuantityField("m**3/s", above=0)] = Field(
        description="of each edge of the fully open valve, at the rated_drop"
    )
    rated_drop: Pressure = Field(3.5e6, description="of the pressure at one edge of the valve")
    supply: Pressure
    tank: GaugePressure = 0.0
    leakage: Annotated[float, QuantityField("m**3/(s*Pa)", at_least=0)] = Field(0.0, description="past the piston")
    pressures: tuple[GaugePressure, GaugePressure] | None = Field(
        None, description="in the chambers at the start; by default that of the tank"
    )

    @model_validator(mode="after")
    def _above_tank(self) -> HydraulicCylinderSpec:
        self._require_supply(self.supply, self.tank, "tank")
        return self


class PneumaticCylinderSpec(FluidCylinderSpec):
    """A cylinder with a proportional valve and air; pressures are absolute."""

    type: Literal["pneumatic_cylinder"]
    exponent: Annotated[float, QuantityField("", at_least=1, at_most=2)] = Field(
        1.0, description="polytropic exponent; 1 is isothermal, 1.4 adiabatic"
    )
    conductance: Annotated[float, QuantityField("m**3/(s*Pa)", above=0)] = Field(
        description="sonic conductance of each path through the fully open valve"
    )
    critical_ratio: Annotated[float, QuantityField("", at_least=0, at_most=0.9)] = Field(
        0.3, description="of the pressures, up to which flow is choked"
    )
    supply: Pressure
    exhaust: Pressure = Field(101325.0, description="pressure of the air around the cylinder")
    leakage: Annotated[float, QuantityField("m**3/(s*Pa)", at_least=0)] = Field(
        0.0, description="sonic conductance of the gap at the piston"
    )
    pressures: tuple[Pressure, Pressure] | None = Field(
        None, description="in the chambers at the start; by default that of the exhaust"
    )

    @model_validator(mode="after")
    def _above_exhaust(self) -> PneumaticCylinderSpec:
        self._require_supply(self.supply, self.exhaust, "exhaust")
        return self


AnyActuatorSpec = Annotated[
    EffortActuatorSpec | DcMotorSpec | HydraulicCylinderSpec | PneumaticCylinderSpec, Field(discriminator="type")
]


def _as_list(value: Any) -> Any:
    return [value] if isinstance(value, str) else value


_NAMES = {"type": "array", "items": {"type": "string"}, "minItems": 1}
JointNames = Annotated[
    list[str],
    BeforeValidator(_as_list),
    Field(min_length=1),
    WithJsonSchema({"anyOf": [{"type": "string"}, _NAMES]}),
]


class BaseSpec(Spec):
    """The keys of all bases. Wheels are named by their joints; the others by what turns them forward."""

    track: PositiveLength = Field(description="distance of the left wheels from the right ones")
    radius: PositiveLength = Field(description="of the wheels")
    reversed: list[str] = Field([], description="joints that move backward, or steer to the right, when positive")


class DifferentialBaseSpec(BaseSpec):
    """A base with wheels on both sides, which steers by their different speeds."""

    type: Literal["differential"]
    left: JointNames = Field(description="the joint of the left wheel, or a list of several")
    right: JointNames = Field(description="the joint of the right wheel, or a list of several")


class MecanumBaseSpec(BaseSpec):
    """A base with four mecanum wheels, whose rollers form an X as seen from above."""

    type: Literal["mecanum"]
    wheelbase: PositiveLength = Field(description="distance of the front wheels from the rear ones")
    front_left: str
    front_right: str
    rear_left: str
    rear_right: str


class CarBaseSpec(BaseSpec):
    """A base with driven rear wheels and steered front wheels, or one steered front wheel."""

    type: Literal["car"]
    wheelbase: PositiveLength = Field(description="distance of the front axle from the rear one")
    left: JointNames = Field(description="the joint of the left rear wheel, or a list of several")
    right: JointNames = Field(description="the joint of the right rear wheel, or a list of several")
    steering: JointNames = Field(description="the steering joint in the middle, or [left, right]")


AnyBaseSpec = Annotated[DifferentialBaseSpec | MecanumBaseSpec | CarBaseSpec, Field(discriminator="type")]
