"""The shapes of the parts in a mechanism file."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from mbd_sim.base.errors import InputError
from mbd_sim.files.schema.fields import (
    Color,
    Direction,
    Mass,
    Name,
    PositiveDensity,
    PositiveLength,
    RotationSpec,
    Spec,
    Vector,
)


class ShapeSpec(Spec):
    """The keys of all shapes. Shapes without `mass` and `density` share the part's mass in proportion to their size."""

    mass: Mass | None = Field(None, description="mass of the shape; 0 if it is only drawn")
    hole: bool = Field(False, description="removes material")
    color: Color | None = None
    name: Name | None = Field(None, description="name by which contacts refer to this shape, as part.name")

    @model_validator(mode="after")
    def _one_mass(self) -> ShapeSpec:
        if self.mass is not None and getattr(self, "density", None) is not None:
            raise InputError("has both mass and density", "Give one of them.")
        return self


class PlacedShapeSpec(ShapeSpec):
    """A shape centered at `at` and rotated by `rotate`."""

    at: Vector = (0.0, 0.0, 0.0)
    rotate: RotationSpec | None = None


class AxialShapeSpec(PlacedShapeSpec):
    """A shape about `axis` (default z)."""

    axis: Direction = (0.0, 0.0, 1.0)


class RodSpec(ShapeSpec):
    """A thin uniform rod between two points; `radius` is only for drawing."""

    type: Literal["rod"]
    start: Vector = Field((0.0, 0.0, 0.0), alias="from")
    end: Vector = Field(alias="to")
    radius: PositiveLength | None = None

    @model_validator(mode="after")
    def _length(self) -> RodSpec:
        if self.start == self.end:
            raise InputError("a rod needs two different ends", "Change 'from' or 'to'.")
        return self


class ParticleSpec(PlacedShapeSpec):
    """A point mass; `radius` is only for drawing."""

    type: Literal["particle"]
    radius: PositiveLength | None = None


class DiscSpec(AxialShapeSpec):
    """A thin uniform disc."""

    type: Literal["disc"]
    radius: PositiveLength


class RingSpec(AxialShapeSpec):
    """A thin uniform ring (hoop)."""

    type: Literal["ring"]
    radius: PositiveLength


class PlateSpec(AxialShapeSpec):
    """A thin uniform rectangular plate, `size` along its own x and y, normal to `axis`."""

    type: Literal["plate"]
    size: tuple[PositiveLength, PositiveLength]


class BlockSpec(PlacedShapeSpec):
    """A uniform rectangular block, `size` along x, y, z."""

    type: Literal["block"]
    size: tuple[PositiveLength, PositiveLength, PositiveLength]
    density: PositiveDensity | None = None


class CylinderSpec(AxialShapeSpec):
    """A uniform solid cylinder."""

    type: Literal["cylinder"]
    radius: PositiveLength
    length: PositiveLength
    density: PositiveDensity | None = None


class SphereSpec(PlacedShapeSpec):
    """A uniform solid sphere."""

    type: Literal["sphere"]
    radius: PositiveLength
    density: PositiveDensity | None = None


AnyShapeSpec = Annotated[
    RodSpec | ParticleSpec | DiscSpec | RingSpec | PlateSpec | BlockSpec | CylinderSpec | SphereSpec,
    Field(discriminator="type"),
]
