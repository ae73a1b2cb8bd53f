"""The actuators of a mechanism file: motors, their servos, and their commands."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from mbd_sim.errors import InputError
from mbd_sim.mechanism_file.measured import AmountFromZero, AnyAmount, PositiveAmount
from mbd_sim.mechanism_file.quantity import PositiveLength, PositiveTime, Quantity, TorsionDamping
from mbd_sim.mechanism_file.schema.base_schema import Spec
from mbd_sim.mechanism_file.schema.law_schema import FrictionTorque, PositiveAngularVelocity

PositiveRatio = Annotated[float, Quantity("", above=0)]
Efficiency = Annotated[float, Quantity("", above=0, at_most=1)]
RotorInertia = Annotated[float, Quantity("kg*m**2", at_least=0)]
Voltage = Annotated[float, Quantity("V", above=0)]
Current = Annotated[float, Quantity("A", above=0)]
Frequency = Annotated[float, Quantity("Hz", above=0)]
Delay = Annotated[float, Quantity("s", at_least=0)]


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

    joint: str | None = Field(None, description="a joint, or a coordinate of one such as wrist.angle")
    between: tuple[str, str] | None = Field(None, description="two points, which a positive effort pushes apart")
    gear_ratio: PositiveRatio = Field(1.0, description="revolutions of the rotor for one of the gear's output")
    lead: PositiveLength | None = Field(
        None, description="travel for one revolution of the gear's output, where the actuator moves along a line"
    )
    rotor_inertia: RotorInertia = Field(0.0, description="about the rotor's axis; it adds gear_ratio² times itself")
    servo: ServoSpec | None = None
    command: dict[Literal["position", "velocity", "effort", "voltage", "current"], AnyAmount] = Field(
        {}, description="commands before the first one; by default the start position, and zero for all others"
    )
    delay: Delay = Field(0.0, description="of all commands, a whole number of steps")

    @model_validator(mode="after")
    def _one_place(self) -> ActuatorSpec:
        if (self.joint is None) == (self.between is None):
            given = "both joint and between" if self.joint is not None else "neither joint nor between"
            raise InputError(f"has {given}", "Give one of them.")
        if self.between is not None and self.rotor_inertia:
            message = "has between and rotor_inertia, which would couple all joints between the two points"
            raise InputError(message, "Model the cylinder as two parts with a prismatic joint, and name that joint.")
        return self


class EffortActuatorSpec(ActuatorSpec):
    """A motor that exerts the commanded effort, within its limits."""

    type: Literal["effort"]
    effort_limit: PositiveAmount | None = None
    torque_speed: Curve | None = Field(
        None, description="[speed, effort] pairs: the largest effort of the driving motor, from speed 0 on"
    )


class DcMotorSpec(ActuatorSpec):
    """A DC motor with a gear; its `control` is the voltage, or the current of an inner loop."""

    type: Literal["dc_motor"]
    torque_constant: Annotated[float, Quantity("N*m/A", above=0)] = Field(
        description="also the constant of the back-EMF, in V*s/rad"
    )
    resistance: Annotated[float, Quantity("ohm", above=0)]
    inductance: Annotated[float, Quantity("H", at_least=0)] = 0.0
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


AnyActuatorSpec = Annotated[EffortActuatorSpec | DcMotorSpec, Field(discriminator="type")]
