"""The joints of a mechanism file, with their drives.

A drive is an expression of the time, or the record of a drive that follows commands.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from mbd_sim.base.errors import InputError
from mbd_sim.files.schema.fields import (
    Angle,
    AngleOfTime,
    AngularVelocity,
    Direction,
    Lead,
    Length,
    LengthOfTime,
    LinearDamping,
    LinearStiffness,
    PointSpec,
    PositiveAngularVelocity,
    PositiveForce,
    PositiveTorque,
    PositiveVelocity,
    QuantityField,
    RotationSpec,
    Spec,
    TorsionDamping,
    TorsionDamping3,
    TorsionStiffness,
    TorsionStiffness3,
    Vector,
    Velocity,
)
from mbd_sim.files.schema.laws import (
    AngleLimitsSpec,
    ForceCurveSpec,
    LengthLimitsSpec,
    LinearFrictionSpec,
    LinearPowerSpec,
    TorqueCurveSpec,
    TorsionFrictionSpec,
    TorsionPowerSpec,
)


class CommandedDriveSpec(Spec):
    """A drive that follows commands of its position or of its velocity.

    Position, velocity and acceleration are continuous.
    """

    command: Literal["position", "velocity"]
    bandwidth: Annotated[float, QuantityField("rad/s", above=0)] = Field(
        description="with which it follows, without limits"
    )

    @model_validator(mode="after")
    def _in_range(self) -> CommandedDriveSpec:
        lower, upper, start = (getattr(self, key) for key in ("lower", "upper", "position"))
        if lower is not None and upper is not None and lower >= upper:
            remedy = "Swap them." if lower > upper else "Give a larger upper limit, or a 'fixed' joint."
            raise InputError(f"lower {lower:g} is not below upper {upper:g}", remedy)
        if (lower is not None and start < lower) or (upper is not None and start > upper):
            raise InputError(f"the position {start:g} is beyond its own limits", "Give a position between them.")
        return self


class AngleDriveSpec(CommandedDriveSpec):
    """A drive of an angle that follows commands."""

    position: Angle = Field(0.0, description="at the start")
    velocity_limit: PositiveAngularVelocity | None = None
    acceleration_limit: Annotated[float, QuantityField("rad/s**2", above=0)] | None = None
    lower: Angle | None = Field(None, description="which the position does not fall below, whatever is commanded")
    upper: Angle | None = Field(None, description="which the position does not exceed, whatever is commanded")


class LengthDriveSpec(CommandedDriveSpec):
    """A drive of a displacement that follows commands."""

    position: Length = Field(0.0, description="at the start")
    velocity_limit: PositiveVelocity | None = None
    acceleration_limit: Annotated[float, QuantityField("m/s**2", above=0)] | None = None
    lower: Length | None = Field(None, description="which the position does not fall below, whatever is commanded")
    upper: Length | None = Field(None, description="which the position does not exceed, whatever is commanded")


def _form(value: Any) -> str:
    """Whether a drive is written as a `mapping` or as an `expression`."""
    return "mapping" if isinstance(value, dict | CommandedDriveSpec) else "expression"


AngleDrive = Annotated[
    Annotated[AngleOfTime, Tag("expression")] | Annotated[AngleDriveSpec, Tag("mapping")], Discriminator(_form)
]
LengthDrive = Annotated[
    Annotated[LengthOfTime, Tag("expression")] | Annotated[LengthDriveSpec, Tag("mapping")], Discriminator(_form)
]


Stiffness6 = tuple[
    LinearStiffness, LinearStiffness, LinearStiffness, TorsionStiffness, TorsionStiffness, TorsionStiffness
]
Damping6 = tuple[LinearDamping, LinearDamping, LinearDamping, TorsionDamping, TorsionDamping, TorsionDamping]


def _require_expressions(value: Any) -> Any:
    """Refuse drives of several coordinates that follow commands.

    :raises InputError: with the joints to use instead.
    """
    if any(isinstance(one, dict) for one in (value if isinstance(value, list | tuple) else [value])):
        raise InputError(
            "only drives of joints with one coordinate follow commands",
            "Use prismatic and revolute joints in a row, with parts of mass 0 between them and a drive each; or write "
            "expressions of the time t.",
        )
    return value


NOT_COMMANDED = BeforeValidator(_require_expressions)


class JointSpec(Spec):
    """The keys of all joints. `between` names two parts, or points of them as `part.point`.

    When loops are assembled, given start values are kept; with `guess` they are only the initial guess. A joint with
    `cut` closes a loop and has no coordinate.
    """

    between: tuple[str, str]
    guess: bool = Field(False, description="the start position is only the initial guess for assembling loops")
    cut: bool = Field(False, description="cut this joint instead of another one of its loop")
    compliance: Annotated[float, QuantityField("", above=0)] = Field(
        1.0, description="relative compliance, by which redundant joints share the load"
    )


class DriveableJointSpec(JointSpec):
    """A joint that moves under forces, or as a `drive` prescribes: by expressions of the time t, or by commands."""

    @model_validator(mode="after")
    def _driven_or_free(self) -> DriveableJointSpec:
        free = {
            "position",
            "velocity",
            "stiffness",
            "rest",
            "damping",
            "limits",
            "effort_limit",
            "velocity_limit",
            "guess",
            "cut",
        }
        free |= {"spring", "damper", "friction"}
        if getattr(self, "drive") is not None and (both := sorted(free & self.model_fields_set)):  # noqa: B009
            raise InputError(
                f"has a drive and {', '.join(both)}", "The drive alone prescribes the motion: remove the other keys."
            )
        if {"stiffness", "spring"} <= self.model_fields_set:
            raise InputError("has stiffness and spring", "Give one of them.")
        return self


class RevoluteJointSpec(DriveableJointSpec):
    """A hinge. Its coordinate is the right-handed angle of the second part about `axis` (in the first part's frame)."""

    type: Literal["revolute"]
    axis: Direction
    position: Angle = 0.0
    velocity: AngularVelocity = 0.0
    stiffness: TorsionStiffness = 0.0
    rest: Angle = Field(0.0, description="angle at which the torsion spring is relaxed")
    damping: TorsionDamping = 0.0
    spring: TorqueCurveSpec | None = None
    damper: TorsionPowerSpec | None = None
    friction: TorsionFrictionSpec | None = None
    limits: AngleLimitsSpec | None = None
    effort_limit: PositiveTorque | None = None
    velocity_limit: PositiveAngularVelocity | None = Field(
        None, description="not simulated; passed on to exported URDF"
    )
    drive: AngleDrive | None = None


class PrismaticJointSpec(DriveableJointSpec):
    """A slider. Its coordinate is the displacement of the second part along `axis` (in the first part's frame)."""

    type: Literal["prismatic"]
    axis: Direction
    position: Length = 0.0
    velocity: Velocity = 0.0
    stiffness: LinearStiffness = 0.0
    rest: Length = Field(0.0, description="displacement at which the spring is relaxed")
    damping: LinearDamping = 0.0
    spring: ForceCurveSpec | None = None
    damper: LinearPowerSpec | None = None
    friction: LinearFrictionSpec | None = None
    limits: LengthLimitsSpec | None = None
    effort_limit: PositiveForce | None = None
    velocity_limit: PositiveVelocity | None = Field(None, description="not simulated; passed on to exported URDF")
    drive: LengthDrive | None = None


class ScrewJointSpec(DriveableJointSpec):
    """A screw: a hinge that moves `lead` meters along its axis for each turn about it."""

    type: Literal["screw"]
    axis: Direction
    lead: Lead
    position: Angle = 0.0
    velocity: AngularVelocity = 0.0
    stiffness: TorsionStiffness = 0.0
    rest: Angle = 0.0
    damping: TorsionDamping = 0.0
    limits: AngleLimitsSpec | None = None
    effort_limit: PositiveTorque | None = None
    drive: AngleDrive | None = None


class CylindricalJointSpec(DriveableJointSpec):
    """A slider that also rotates. Its coordinates are the displacement along and the angle about `axis`."""

    type: Literal["cylindrical"]
    axis: Direction
    position: tuple[Length, Angle] = (0.0, 0.0)
    velocity: tuple[Velocity, AngularVelocity] = (0.0, 0.0)
    stiffness: tuple[LinearStiffness, TorsionStiffness] = (0.0, 0.0)
    rest: tuple[Length, Angle] = (0.0, 0.0)
    damping: tuple[LinearDamping, TorsionDamping] = (0.0, 0.0)
    limits: tuple[LengthLimitsSpec | None, AngleLimitsSpec | None] | None = None
    drive: Annotated[tuple[LengthOfTime, AngleOfTime] | None, NOT_COMMANDED] = None


class UniversalJointSpec(DriveableJointSpec):
    """A Cardan joint: a rotation about the first axis, then about the second, which the first one carries along."""

    type: Literal["universal"]
    axes: tuple[Direction, Direction]
    position: tuple[Angle, Angle] = (0.0, 0.0)
    velocity: tuple[AngularVelocity, AngularVelocity] = (0.0, 0.0)
    stiffness: tuple[TorsionStiffness, TorsionStiffness] = (0.0, 0.0)
    rest: tuple[Angle, Angle] = (0.0, 0.0)
    damping: tuple[TorsionDamping, TorsionDamping] = (0.0, 0.0)
    limits: tuple[AngleLimitsSpec | None, AngleLimitsSpec | None] | None = None
    drive: Annotated[tuple[AngleOfTime, AngleOfTime] | None, NOT_COMMANDED] = None


class PlanarJointSpec(DriveableJointSpec):
    """A part that slides and rotates on a plane with normal `axis`, with coordinates x, y and the angle about `axis`.

    `x_axis` is the direction of x; the y direction is axis × x_axis.
    """

    type: Literal["planar"]
    axis: Direction
    x_axis: Direction | None = None
    position: tuple[Length, Length, Angle] = (0.0, 0.0, 0.0)
    velocity: tuple[Velocity, Velocity, AngularVelocity] = (0.0, 0.0, 0.0)
    stiffness: tuple[LinearStiffness, LinearStiffness, TorsionStiffness] = (0.0, 0.0, 0.0)
    rest: tuple[Length, Length, Angle] = (0.0, 0.0, 0.0)
    damping: tuple[LinearDamping, LinearDamping, TorsionDamping] = (0.0, 0.0, 0.0)
    limits: tuple[LengthLimitsSpec | None, LengthLimitsSpec | None, AngleLimitsSpec | None] | None = None
    drive: Annotated[tuple[LengthOfTime, LengthOfTime, AngleOfTime] | None, NOT_COMMANDED] = None


class TurningJointSpec(JointSpec):
    """A joint whose orientation has no coordinates that could have limits."""

    @model_validator(mode="before")
    @classmethod
    def _unlimited(cls, data: Any) -> Any:
        if isinstance(data, dict) and "limits" in data:
            raise InputError(
                f"a {data.get('type')} joint has no limits: no coordinates describe its orientation",
                "Remove 'limits'. Bound the motion of its points with 'distance', 'on_plane' or 'on_surface' and "
                "'bound', or use a joint with coordinates, such as universal.",
            )
        return data


class SphericalJointSpec(TurningJointSpec):
    """A ball joint, regular in every orientation."""

    type: Literal["spherical"]
    orientation: RotationSpec | None = None
    angular_velocity: tuple[AngularVelocity, AngularVelocity, AngularVelocity] = Field(
        (0.0, 0.0, 0.0), description="in the second part's axes"
    )
    stiffness: TorsionStiffness3 = 0.0
    rest: RotationSpec | None = Field(None, description="orientation at which the springs are relaxed")
    damping: TorsionDamping3 = 0.0


class FixedJointSpec(JointSpec):
    """A weld."""

    type: Literal["fixed"]


class FreeJointSpec(TurningJointSpec):
    """No connection: six degrees of freedom, with the pose of the second part relative to the first."""

    type: Literal["free"]
    position: Vector = (0.0, 0.0, 0.0)
    orientation: RotationSpec | None = None
    velocity: tuple[Velocity, Velocity, Velocity] = Field((0.0, 0.0, 0.0), description="in the first part's axes")
    angular_velocity: tuple[AngularVelocity, AngularVelocity, AngularVelocity] = Field(
        (0.0, 0.0, 0.0), description="in the second part's axes"
    )
    stiffness: Stiffness6 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    rest: PointSpec | None = Field(None, description="pose at which the springs are relaxed")
    damping: Damping6 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


AnyJointSpec = Annotated[
    RevoluteJointSpec
    | PrismaticJointSpec
    | ScrewJointSpec
    | CylindricalJointSpec
    | UniversalJointSpec
    | PlanarJointSpec
    | SphericalJointSpec
    | FixedJointSpec
    | FreeJointSpec,
    Field(discriminator="type"),
]
