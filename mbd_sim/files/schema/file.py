"""The mechanism file as data: one class for each kind of mapping in it.

All numbers are in SI units once read. `mbd_sim.mechanism.elements.parts` has the records that are built from these.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, StringConstraints, Tag, model_validator

from mbd_sim.base.errors import InputError
from mbd_sim.files.schema.actuators import AnyActuatorSpec, AnyBaseSpec
from mbd_sim.files.schema.constraints import AnyConstraintSpec, ContactSpec
from mbd_sim.files.schema.fields import (
    Acceleration,
    AnyNumber,
    Color,
    FrameName,
    Mass,
    MomentOfInertia,
    Name,
    Number,
    OneOrThree,
    PlainName,
    PointOrVector,
    PositiveDensity,
    PositiveTime,
    QuantityField,
    RotationSpec,
    Spec,
    Value,
    Vector,
    written_as,
)
from mbd_sim.files.schema.forces import AnyForceSpec
from mbd_sim.files.schema.joints import AnyJointSpec
from mbd_sim.files.schema.laws import TableSpec
from mbd_sim.files.schema.sensors import AnySensorSpec, Seed
from mbd_sim.files.schema.shapes import AnyShapeSpec
from mbd_sim.files.text.xml import parse_elements

FunctionHead = Annotated[str, StringConstraints(max_length=200)]  # its form is checked when functions are read


class GroundSpec(Spec):
    """The part that does not move."""

    points: dict[Name, PointOrVector] = Field(default={})


class SolidSpec(Spec):
    """What a closed mesh encloses, in the axes and the unit of its file, without its scale."""

    volume: Number
    center: tuple[Number, Number, Number]
    moments: tuple[Number, Number, Number, Number, Number, Number] = Field(
        description="second moments of volume about the center: xx, yy, zz, xy, xz, yz (xy = ∫ x y dV)"
    )


class MeshSpec(Spec):
    """A file with a surface that is drawn instead of the shapes; its URI is passed on to exported URDF.

    With a `mass` or a `density` it is a uniform solid as well.
    """

    file: Annotated[str, StringConstraints(min_length=1, max_length=1000)]
    scale: OneOrThree[Number] = 1.0
    at: Vector = (0.0, 0.0, 0.0)
    rotate: RotationSpec | None = None
    color: Color | None = None
    mass: Mass | None = Field(None, description="of the uniform solid that the mesh encloses")
    density: PositiveDensity | None = Field(None, description="of the uniform solid that the mesh encloses")
    solid: SolidSpec | None = Field(
        None, description="what the mesh encloses; computed where center and inertia of the part follow from it"
    )

    @model_validator(mode="after")
    def _one_mass(self) -> MeshSpec:
        if self.mass is not None and self.density is not None:
            raise InputError("has both mass and density", "Give one of them.")
        return self


class InertiaSpec(Spec):
    """Moments and products of inertia about the mass center, in the part's axes (I_xy = -∫ x y dm)."""

    xx: MomentOfInertia
    yy: MomentOfInertia
    zz: MomentOfInertia
    xy: MomentOfInertia = 0.0
    xz: MomentOfInertia = 0.0
    yz: MomentOfInertia = 0.0


def _no_matrix(value: object) -> object:
    if isinstance(value, list) and any(isinstance(row, list) for row in value):
        raise InputError("is a matrix", "Write it as [I_xx, I_yy, I_zz] or {xx: …, yy: …, zz: …, xy: …}.")
    return value


InertiaOrMoments = Annotated[
    Annotated[tuple[MomentOfInertia, MomentOfInertia, MomentOfInertia], Tag("list")]
    | Annotated[InertiaSpec, Tag("mapping")],
    Discriminator(written_as),
    BeforeValidator(_no_matrix),
]


class PartSpec(Spec):
    """A rigid body: its mass, mass center and inertia, given or computed from its shapes."""

    mass: Mass | None = Field(None, description="kg; shared among the shapes in proportion to their size")
    center: Vector | None = Field(None, description="mass center; computed if the part has shapes with mass")
    inertia: InertiaOrMoments | None = None
    inertia_check: bool = Field(True, description="false: accept an inertia that no rigid body can have")
    material: Annotated[str, StringConstraints(min_length=1, max_length=60)] | None = Field(
        None,
        description="such as steel, or one of 'materials': the density of the solid shapes and the meshes that have "
        "neither mass nor density",
    )
    shape: AnyShapeSpec | None = None
    shapes: list[AnyShapeSpec] | None = None
    collisions: list[AnyShapeSpec] | None = Field(
        None, description="what touches in contacts, in place of the shapes; without mass, and not drawn"
    )
    mesh: MeshSpec | None = Field(None, description="in place of 'meshes' with one entry")
    meshes: list[MeshSpec] = Field(
        [],
        description="drawn instead of the shapes, and passed on to exported URDF; center and inertia of a part with a "
        "mass, and with neither an inertia nor shapes with mass, follow from them",
    )
    points: dict[Name, PointOrVector] = Field(default={})

    @model_validator(mode="after")
    def _one_of(self) -> PartSpec:
        if self.shape is not None and self.shapes is not None:
            raise InputError("has both shape and shapes", "Move 'shape' into 'shapes'.")
        if self.mesh is not None and self.meshes:
            raise InputError("has both mesh and meshes", "Move 'mesh' into 'meshes'.")
        if self.material is not None and (self.mass is not None or self.inertia is not None):
            given = "mass" if self.mass is not None else "inertia"
            raise InputError(f"has both material and {given}", "Give one of them: a material is a density.")
        return self

    @property
    def all_meshes(self) -> list[MeshSpec]:
        """Its meshes, in whichever way they are written."""
        return [self.mesh] if self.mesh is not None else self.meshes

    @model_validator(mode="after")
    def _only_touching(self) -> PartSpec:
        for index, shape in enumerate(self.collisions or []):
            if given := [key for key in ("mass", "density", "hole") if getattr(shape, key, None)]:
                message = f"collisions[{index}]: {given[0]} has no effect on a shape that only touches"
                raise InputError(message, f"Remove '{given[0]}', or move the shape to 'shapes'.")
        return self


Tolerance = Annotated[float, QuantityField("", at_least=0, at_most=0.01)]
RestSpeed = Annotated[float, QuantityField("m/s", at_least=0)]


class IntegrationSpec(Spec):
    """The integration method and its step; contacts that approach more slowly than `rest_speed` do not rebound."""

    method: str = "auto"
    step: PositiveTime = 1e-3
    rest_speed: RestSpeed = 1e-5


def _control_blocks(text: str) -> str:
    parse_elements(text, "ros2_control")
    return text


ControlBlocks = Annotated[str, AfterValidator(_control_blocks)]


class MechanismFile(Spec):
    """A mechanism file."""

    mechanism: Name = Field(description="the mechanism's name")
    description: str = ""
    urdf: str | None = Field(None, description="a URDF or xacro file that this file extends")
    xacro: dict[str, str | bool | float] = Field({}, description="arguments of the xacro file that 'urdf' names")
    base: Literal["fixed", "free"] | None = Field(
        None, description="whether the root link of the URDF is fixed to ground or free"
    )
    parameters: dict[PlainName, Value] = Field({}, description="named numbers for use in expressions")
    ranges: dict[PlainName, tuple[AnyNumber, AnyNumber]] = Field(
        {}, description="the least and the greatest sensible value of parameters: ends of sliders"
    )
    functions: dict[FunctionHead, Value] = Field(
        {}, description="named expressions with arguments, such as 'stroke(t): 0.1*sin(5*t)'"
    )
    tables: dict[PlainName, TableSpec] = Field({}, description="functions through given points, read by table(name, x)")
    materials: dict[PlainName, PositiveDensity] = Field(
        {}, description="densities of further materials, for 'material' of parts"
    )
    tolerance: Tolerance = Field(
        1e-3,
        description="loops whose axes are parallel, or meet, within this angle in rad, and this part of their size, "
        "mean exactly that; 0: as written",
    )
    gravity: tuple[Acceleration, Acceleration, Acceleration] = (0.0, 0.0, -9.81)
    limits: Literal["stops"] | None = Field(
        None, description="stops: limits of joints that have neither a stiffness nor a restitution are rigid stops"
    )
    # Made without validation, which would build both records at every start.
    integrator: IntegrationSpec = IntegrationSpec.model_construct()
    ground: GroundSpec = GroundSpec.model_construct()
    parts: dict[FrameName, PartSpec] = Field(min_length=1)
    joints: dict[Name, AnyJointSpec] = Field(min_length=1)
    constraints: dict[Name, AnyConstraintSpec] = Field(
        default={}, description="restrictions of the motion in addition to joints"
    )
    contacts: dict[Name, ContactSpec] = Field(default={}, description="shapes that cannot penetrate each other")
    forces: dict[Name, AnyForceSpec] = Field(default={}, description="springs, dampers, forces, couples and efforts")
    actuators: dict[Name, AnyActuatorSpec] = Field(default={}, description="motors and servos, which take commands")
    bases: dict[Name, AnyBaseSpec] = Field(default={}, description="bases on wheels, whose velocity is commanded")
    sensors: dict[FrameName, AnySensorSpec] = Field(default={}, description="measurements, with their errors and rates")
    ros2_control: ControlBlocks = Field(
        "", description="<ros2_control> elements, which exported URDF and ~/robot_description repeat"
    )
    control: Literal["position", "velocity", "effort"] | None = Field(
        None,
        description="makes the blocks of ros2_control act; of several command interfaces, a joint serves this one",
    )
    sensor_seed: Seed = Field(0, description="of the noise of all sensors: a whole number")
