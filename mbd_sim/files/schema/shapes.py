"""The shapes of the parts in a mechanism file."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Discriminator, Field, StringConstraints, Tag, model_validator

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.batch import Batch, array
from mbd_sim.base.geometry.convex_hull import convex_hull
from mbd_sim.files.schema.fields import (
    Angle,
    Color,
    Direction,
    Length,
    Mass,
    Name,
    Number,
    PositiveDensity,
    PositiveLength,
    QuantityField,
    RotationSpec,
    Spec,
    Vector,
    written_as,
)
from mbd_sim.mechanism.elements.parts import MOST_CORNERS


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


class ConeSpec(AxialShapeSpec):
    """A uniform solid cone, whose base has its center at `at`; `axis` leads from there to the tip."""

    type: Literal["cone"]
    radius: PositiveLength
    length: PositiveLength
    density: PositiveDensity | None = None


class CapsuleSpec(AxialShapeSpec):
    """A uniform solid cylinder with half a ball on each end; `length` is between the centers of these."""

    type: Literal["capsule"]
    radius: PositiveLength
    length: PositiveLength
    density: PositiveDensity | None = None


class SphereSpec(PlacedShapeSpec):
    """A uniform solid sphere."""

    type: Literal["sphere"]
    radius: PositiveLength
    density: PositiveDensity | None = None


class EllipsoidSpec(PlacedShapeSpec):
    """A uniform solid ellipsoid, `radii` along x, y, z."""

    type: Literal["ellipsoid"]
    radii: tuple[PositiveLength, PositiveLength, PositiveLength]
    density: PositiveDensity | None = None


FileName = Annotated[str, StringConstraints(min_length=1, max_length=1000)]


class HullSpec(PlacedShapeSpec):
    """A uniform solid, the convex hull of points or of the mesh in a file, which are given in a frame at `at`."""

    type: Literal["hull"]
    points: list[Vector] | None = Field(None, min_length=1, max_length=1000, description="those inside do not count")
    file: FileName | None = None
    scale: tuple[Number, Number, Number] = (1.0, 1.0, 1.0)
    density: PositiveDensity | None = None

    @model_validator(mode="after")
    def _points(self) -> HullSpec:
        if (self.points is None) == (self.file is None):
            raise InputError("needs either 'points' or a 'file'", "Give one of them.")
        if 0.0 in self.scale:
            raise InputError("has a scale of 0, which leaves nothing of it", "Write positive numbers.")
        if self.points is not None:
            self.polyhedron  # noqa: B018  (reports degenerate points)
        return self

    @cached_property
    def polyhedron(self) -> tuple[Any, tuple[tuple[int, ...], ...]]:
        """The corners (n, 3) in m in its frame, and the faces as places in these, counterclockwise from outside.

        :raises InputError: the points lie in a plane, or the hull has too many corners.
        """
        if self.points is None:  # the problem is reported where the type is not 'hull', so that the file is not read
            return np.full((1, 3), np.nan), ()
        points = array(self.points) * array(self.scale)
        first = points.values[0] if isinstance(points, Batch) else points
        if not np.all(np.isfinite(first)):
            return points, ()  # the problem is reported where the numbers are
        hull = convex_hull(first, MOST_CORNERS)
        if hull.beyond:
            message = f"has more than {MOST_CORNERS} corners"
            raise InputError(message, "Leave out some, or give a 'file', of whose mesh those farthest out are taken.")
        if isinstance(points, Batch):
            others = [convex_hull(values, MOST_CORNERS) for values in points.values]
            points.require(np.array([(one.corners, one.faces) == (hull.corners, hull.faces) for one in others]))
        return points[list(hull.corners)], hull.faces


PlanePoint = tuple[Length, Length]
WholeNumber = Annotated[float, QuantityField("", at_least=1)]
_CURVES = ("through", "center", "radius", "involute")


class StrokeSpec(Spec):
    """A piece of an outline to a point: a line, an arc, the involute of a circle, or a tabulated curve.

    The point is given by `to`, in `polar` coordinates, or as the last one of a `curve`. An arc leads `through` a third
    point, around a `center`, or has a `radius`, positive where it turns to the left; the latter two turn by less than
    half a turn. The `involute` of a circle with this radius around `center` leads through both ends. A `curve` leads
    through all of its points. `round` is the radius of the arc that replaces the corner at the point.
    """

    to: PlanePoint | None = None
    polar: tuple[Length, Angle] | None = Field(None, description="in place of 'to': radius and angle about the origin")
    through: PlanePoint | None = None
    center: PlanePoint | None = None
    radius: Length | None = None
    involute: PositiveLength | None = None
    curve: list[PlanePoint] | None = Field(None, min_length=2, max_length=500, description="in place of 'to'")
    round: PositiveLength | None = None

    @model_validator(mode="after")
    def _one_curve(self) -> StrokeSpec:
        if [self.to, self.polar, self.curve].count(None) != 2:
            raise InputError("needs one of to, polar, curve", "Give the point to which the piece leads.")
        given = [key for key in (*_CURVES, "curve") if getattr(self, key) is not None]
        if len(given) > 1 and given != ["center", "involute"]:
            raise InputError(f"has {' and '.join(given)}", "Give one of them.")
        return self


PlanePointOrStroke = Annotated[
    Annotated[PlanePoint, Tag("list")] | Annotated[StrokeSpec, Tag("mapping")], Discriminator(written_as)
]


class ProfileSpec(Spec):
    """The closed outline on a layer of a DXF drawing; further outlines within it are holes.

    The `origin` of the drawing is given in its unit, or by the layer of a point or a circle.
    """

    dxf: FileName = Field(description="path of the drawing, relative to this file")
    layer: Name
    unit: str = Field("", description="of the drawing, such as mm, if it does not say it itself")
    origin: tuple[float, float] | str = (0.0, 0.0)


class OutlineSpec(PlacedShapeSpec):
    """A uniform body with the outline of a chain of lines and curves, in a plane through `at`.

    The chain is given by `points`, or by the `profile` of a drawing.

    Without a `thickness` it is a thin plate, and if it is not `closed` a wall
    without mass, whose material is on the left. The chain can be repeated around the origin of its plane.
    """

    type: Literal["outline"]
    plane: Literal["xy", "xz", "yz"] = "xy"
    points: list[PlanePointOrStroke] = Field([], description="or a profile")
    profile: ProfileSpec | None = Field(None, description="outline of a DXF drawing, in place of the points")
    closed: bool = True
    repeat: WholeNumber = Field(1.0, description="how often the chain is passed, each time turned further by 1/repeat")
    thickness: PositiveLength | None = None
    density: PositiveDensity | None = None

    @model_validator(mode="after")
    def _consistent(self) -> OutlineSpec:
        if len(self.points) < 2 and self.profile is None:
            raise InputError("needs at least two 'points', or a 'profile'", "Write points: [[0, 0], [1, 0], [0, 1]].")
        if not float(self.repeat).is_integer():
            raise InputError("repeat must be a whole number", "Write for example 12.", self.repeat)
        if not self.closed and self.mass != 0.0:
            raise InputError("an outline that is not closed has no mass", "Add 'mass: 0'.")
        if not self.closed and self.repeat > 1.0:
            raise InputError("an outline that is not closed cannot be repeated", "Remove one of the two.")
        if self.density is not None and self.thickness is None:
            raise InputError("a density needs a thickness", "Add 'thickness', or give 'mass'.")
        return self


AnyShapeSpec = Annotated[
    RodSpec
    | ParticleSpec
    | DiscSpec
    | RingSpec
    | PlateSpec
    | BlockSpec
    | CylinderSpec
    | ConeSpec
    | CapsuleSpec
    | SphereSpec
    | EllipsoidSpec
    | HullSpec
    | OutlineSpec,
    Field(discriminator="type"),
]
