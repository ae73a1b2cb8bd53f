"""The mechanism file, as data: one class for each thing that a user may write.

All numbers are SI once read. These records mirror the file; `mbd_sim.mechanism.model` holds what is made of them.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    StringConstraints,
    Tag,
    WithJsonSchema,
    model_validator,
)
from pydantic_core import PydanticCustomError

from mbd_sim.mechanism.quantity import (
    Acceleration,
    Angle,
    AngularVelocity,
    Length,
    LinearDamping,
    LinearStiffness,
    Mass,
    MomentOfInertia,
    Number,
    PositiveDensity,
    PositiveForce,
    PositiveLength,
    PositiveTime,
    PositiveTorque,
    TorsionDamping,
    TorsionStiffness,
    Velocity,
)

NAME_PATTERN = r"^[A-Za-z][A-Za-z0-9_]*$"
Name = Annotated[str, StringConstraints(pattern=NAME_PATTERN, max_length=60)]


def _need(message: str, remedy: str) -> PydanticCustomError:
    return PydanticCustomError("record", "{why}", {"why": message, "remedy": remedy})


def _not_zero(numbers: tuple[float, ...]) -> tuple[float, ...]:
    if not any(numbers):
        raise _need("must not be zero", f"Give for example [{', '.join(['0'] * (len(numbers) - 1))}, 1].")
    return numbers


Vector = tuple[Length, Length, Length]
Direction = Annotated[tuple[Number, Number, Number], AfterValidator(_not_zero)]
Quaternion = Annotated[tuple[Number, Number, Number, Number], AfterValidator(_not_zero)]
Value = Annotated[Any, WithJsonSchema({"type": ["number", "string"]})]


class Record(BaseModel):
    """A mapping in the file: unknown keys are errors, and a key without value counts as not given."""

    model_config = ConfigDict(extra="forbid", frozen=True, arbitrary_types_allowed=False)

    @model_validator(mode="before")
    @classmethod
    def _given(cls, data: Any) -> Any:
        return {key: value for key, value in data.items() if value is not None} if isinstance(data, dict) else data


def _exactly_one(record: Record, *keys: str) -> None:
    given = [key for key in keys if getattr(record, key) is not None]
    if len(given) != 1:
        raise _need(f"needs exactly one of {', '.join(keys)}", "Given: " + (", ".join(given) or "none") + ".")


class Rotation(Record):
    """An orientation: `axis` and `angle`, or roll-pitch-yaw about fixed x, y, z, or a quaternion (w, x, y, z)."""

    axis: Direction | None = None
    angle: Angle | None = None
    rpy: tuple[Angle, Angle, Angle] | None = None
    quaternion: Quaternion | None = None

    @model_validator(mode="after")
    def _one_form(self) -> Rotation:
        _exactly_one(self, "axis", "rpy", "quaternion")
        if (self.axis is None) != (self.angle is None):
            raise _need("axis and angle belong together", "Give both.")
        return self


class Point(Record):
    """A named point of a part, with an orientation where a joint needs one."""

    at: Vector = (0.0, 0.0, 0.0)
    rotate: Rotation | None = None


def _written_as(value: Any) -> str:
    return "list" if isinstance(value, list | tuple) else "mapping"


PointOrVector = Annotated[
    Annotated[Vector, Tag("list")] | Annotated[Point, Tag("mapping")],
    Discriminator(_written_as),
]


class Ground(Record):
    """The part that does not move."""

    points: dict[Name, PointOrVector] = {}


class Shape(Record):
    """What all shapes share. Without `mass` or `density` a shape takes its share of the part's mass by size."""

    mass: Mass | None = Field(None, description="the shape's own mass; 0 where it is only drawn")
    hole: bool = Field(False, description="takes material away")
    color: Annotated[str, StringConstraints(pattern=r"^#[0-9a-fA-F]{6}$")] | None = None

    @model_validator(mode="after")
    def _one_mass(self) -> Shape:
        if self.mass is not None and getattr(self, "density", None) is not None:
            raise _need("has both mass and density", "Give one of them.")
        return self


class Placed(Shape):
    """A shape about its centre `at`, turned by `rotate`."""

    at: Vector = (0.0, 0.0, 0.0)
    rotate: Rotation | None = None


class AxialShape(Placed):
    """A shape about `axis` (default z)."""

    axis: Direction = (0.0, 0.0, 1.0)


class Rod(Shape):
    """A thin uniform rod between two points; `radius` is only drawn."""

    type: Literal["rod"]
    start: Vector = Field((0.0, 0.0, 0.0), alias="from")
    end: Vector = Field(alias="to")
    radius: PositiveLength | None = None

    @model_validator(mode="after")
    def _length(self) -> Rod:
        if self.start == self.end:
            raise _need("a rod needs two different ends", "Change 'from' or 'to'.")
        return self


class Particle(Placed):
    """A point mass; `radius` is only drawn."""

    type: Literal["particle"]
    radius: PositiveLength | None = None


class Disc(AxialShape):
    """A thin uniform disc."""

    type: Literal["disc"]
    radius: PositiveLength


class Ring(AxialShape):
    """A thin uniform ring (hoop)."""

    type: Literal["ring"]
    radius: PositiveLength


class Plate(AxialShape):
    """A thin uniform rectangular plate, `size` along its own x and y, normal to `axis`."""

    type: Literal["plate"]
    size: tuple[PositiveLength, PositiveLength]


class Block(Placed):
    """A uniform rectangular block, `size` along x, y, z."""

    type: Literal["block"]
    size: tuple[PositiveLength, PositiveLength, PositiveLength]
    density: PositiveDensity | None = None


class Cylinder(AxialShape):
    """A uniform solid cylinder."""

    type: Literal["cylinder"]
    radius: PositiveLength
    length: PositiveLength
    density: PositiveDensity | None = None


class Sphere(Placed):
    """A uniform solid sphere."""

    type: Literal["sphere"]
    radius: PositiveLength
    density: PositiveDensity | None = None


AnyShape = Annotated[
    Rod | Particle | Disc | Ring | Plate | Block | Cylinder | Sphere,
    Field(discriminator="type"),
]


class Inertia(Record):
    """Moments and products of inertia about the mass centre, in the part's axes (I_xy = -∫ x y dm)."""

    xx: MomentOfInertia
    yy: MomentOfInertia
    zz: MomentOfInertia
    xy: MomentOfInertia = 0.0
    xz: MomentOfInertia = 0.0
    yz: MomentOfInertia = 0.0


InertiaOrMoments = Annotated[
    Annotated[tuple[MomentOfInertia, MomentOfInertia, MomentOfInertia], Tag("list")]
    | Annotated[Inertia, Tag("mapping")],
    Discriminator(_written_as),
]


class Part(Record):
    """A rigid body: its mass, mass centre and inertia, given or computed from its shapes."""

    mass: Mass | None = Field(None, description="kg; shared among the shapes by their size")
    center: Vector | None = Field(None, description="mass centre, where it is not computed from shapes")
    inertia: InertiaOrMoments | None = None
    shape: AnyShape | None = None
    shapes: list[AnyShape] | None = None
    points: dict[Name, PointOrVector] = {}

    @model_validator(mode="after")
    def _one_of(self) -> Part:
        if self.shape is not None and self.shapes is not None:
            raise _need("has both shape and shapes", "Move 'shape' into 'shapes'.")
        return self


class Limits(Record):
    """What both kinds of limits share."""

    @model_validator(mode="after")
    def _ordered(self) -> Limits:
        lower, upper = getattr(self, "lower"), getattr(self, "upper")  # noqa: B009  (of the subclasses)
        if lower >= upper:
            raise _need(f"lower {lower:g} is not below upper {upper:g}", "Swap them.")
        return self


class AngleLimits(Limits):
    """The range of a revolute joint; with `stiffness` its ends are elastic stops."""

    lower: Angle
    upper: Angle
    stiffness: TorsionStiffness | None = None


class LengthLimits(Limits):
    """The range of a prismatic joint; with `stiffness` its ends are elastic stops."""

    lower: Length
    upper: Length
    stiffness: LinearStiffness | None = None


class Joint(Record):
    """What all joints share. `between` names two parts, or points of them as `part.point`."""

    between: tuple[str, str]


class AxisJoint(Joint):
    """A joint along or about `axis`, given in the first part's point frame."""

    axis: Direction


class RevoluteJoint(AxisJoint):
    """A hinge. Its coordinate is the right-handed angle of the second part about `axis`."""

    type: Literal["revolute"]
    position: Angle = 0.0
    velocity: AngularVelocity = 0.0
    stiffness: TorsionStiffness = 0.0
    rest: Angle = Field(0.0, description="angle at which the torsion spring is relaxed")
    damping: TorsionDamping = 0.0
    limits: AngleLimits | None = None
    effort_limit: PositiveTorque | None = None


class PrismaticJoint(AxisJoint):
    """A slider. Its coordinate is the displacement of the second part along `axis`."""

    type: Literal["prismatic"]
    position: Length = 0.0
    velocity: Velocity = 0.0
    stiffness: LinearStiffness = 0.0
    rest: Length = Field(0.0, description="displacement at which the spring is relaxed")
    damping: LinearDamping = 0.0
    limits: LengthLimits | None = None
    effort_limit: PositiveForce | None = None


class FixedJoint(Joint):
    """A weld."""

    type: Literal["fixed"]


class FreeJoint(Joint):
    """No connection: six degrees of freedom, with the pose of the second part seen from the first."""

    type: Literal["free"]
    position: Vector = (0.0, 0.0, 0.0)
    orientation: Rotation | None = None
    velocity: tuple[Velocity, Velocity, Velocity] = Field((0.0, 0.0, 0.0), description="in the first part's axes")
    angular_velocity: tuple[AngularVelocity, AngularVelocity, AngularVelocity] = Field(
        (0.0, 0.0, 0.0), description="in the second part's axes"
    )


AnyJoint = Annotated[RevoluteJoint | PrismaticJoint | FixedJoint | FreeJoint, Field(discriminator="type")]


class Integration(Record):
    """How the equations are integrated."""

    method: str = "dop853"
    step: PositiveTime = 1e-3


class MechanismFile(Record):
    """A mechanism file."""

    mechanism: Name = Field(description="the mechanism's name")
    description: str = ""
    parameters: dict[Name, Value] = Field({}, description="named numbers, which expressions may use")
    gravity: tuple[Acceleration, Acceleration, Acceleration] = (0.0, 0.0, -9.81)
    integrator: Integration = Integration()
    ground: Ground = Ground()
    parts: dict[Name, Part] = Field(min_length=1)
    joints: dict[Name, AnyJoint] = Field(min_length=1)
