"""The constraints of a mechanism file, in addition to the joints."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, StringConstraints, model_validator

from mbd_sim.errors import InputError
from mbd_sim.mechanism.expression import TimeExpression
from mbd_sim.mechanism_file.expression_field import ExpressionField
from mbd_sim.mechanism_file.quantity import Number, PositiveLength
from mbd_sim.mechanism_file.schema.base_schema import Direction, Spec

Coordinate = Annotated[str, StringConstraints(min_length=1)]
LengthOfTime = Annotated[TimeExpression, ExpressionField("m")]
SurfaceExpression = Annotated[TimeExpression, ExpressionField("", ("x", "y", "z", "t"))]
Z: tuple[float, float, float] = (0.0, 0.0, 1.0)


class DistanceSpec(Spec):
    """A massless rod: two points keep the distance `length`, which may be an expression of time."""

    type: Literal["distance"]
    between: tuple[str, str]
    length: LengthOfTime


class OnPlaneSpec(Spec):
    """A point stays on the plane through `plane`, whose part carries the `normal`."""

    type: Literal["on_plane"]
    point: str
    plane: str = "ground"
    normal: Direction = Z


class OnLineSpec(Spec):
    """A point stays on the line through `line`, whose part carries the `direction`."""

    type: Literal["on_line"]
    point: str
    line: str = "ground"
    direction: Direction


class OnSurfaceSpec(Spec):
    """A point stays where an expression of its x, y and z (and t) in the frame of `frame` is 0; two make a curve."""

    type: Literal["on_surface", "on_curve"]
    point: str
    frame: str = "ground"
    equation: SurfaceExpression | None = None
    equations: tuple[SurfaceExpression, SurfaceExpression] | None = None

    @model_validator(mode="after")
    def _count(self) -> OnSurfaceSpec:
        key, other = ("equation", "equations") if self.type == "on_surface" else ("equations", "equation")
        if getattr(self, key) is None or getattr(self, other) is not None:
            count = "one: equation" if key == "equation" else "two: equations"
            raise InputError(f"needs '{key}'", f"A {self.type.removeprefix('on_')} has {count}.")
        return self


class GearSpec(Spec):
    """Two gear wheels in mesh: the second rotates by -r₁/r₂ times the first, or by r₁/r₂ if one has internal teeth."""

    type: Literal["gear"]
    joints: tuple[Coordinate, Coordinate]
    radii: tuple[PositiveLength, PositiveLength]
    internal: bool = False


class RackSpec(Spec):
    """A rack on a pinion, or a cable on a drum: a displacement is `radius` times the angle of another joint."""

    type: Literal["rack"]
    pinion: Coordinate
    rack: Coordinate
    radius: PositiveLength
    reverse: bool = Field(False, description="the rack moves backward when the pinion rotates forward")


class CouplingSpec(Spec):
    """A linear relation between joint coordinates: the sum of `terms` (factors by coordinate) equals `value`."""

    type: Literal["coupling"]
    terms: dict[Coordinate, Number] = Field(min_length=2)
    value: Annotated[TimeExpression, ExpressionField(None)] = TimeExpression("0", {})


class RollingSpec(Spec):
    """A wheel with an `axis`, or a ball without one, rolls on a plane without slipping; `wheel` is its center."""

    type: Literal["rolling"]
    wheel: str
    axis: Direction | None = None
    radius: PositiveLength
    plane: str = "ground"
    normal: Direction = Z


class KnifeEdgeSpec(Spec):
    """A blade at a point does not move sideways to its `direction` (in its part), in a plane with this `normal`."""

    type: Literal["knife_edge"]
    at: str
    direction: Direction
    plane: str = "ground"
    normal: Direction = Z


class CableSpec(Spec):
    """A taut massless cable from point to point over small frictionless pulleys; its total length is prescribed."""

    type: Literal["cable"]
    through: list[str] = Field(min_length=2)
    length: LengthOfTime


AnyConstraintSpec = Annotated[
    DistanceSpec
    | OnPlaneSpec
    | OnLineSpec
    | OnSurfaceSpec
    | GearSpec
    | RackSpec
    | CouplingSpec
    | RollingSpec
    | KnifeEdgeSpec
    | CableSpec,
    Field(discriminator="type"),
]
