"""The force elements of a mechanism file: between points of parts, or on a part."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, StringConstraints, model_validator

from mbd_sim.errors import InputError
from mbd_sim.mechanism.expression import TimeExpression
from mbd_sim.mechanism_file.expression_field import ExpressionField
from mbd_sim.mechanism_file.quantity import (
    Length,
    LinearDamping,
    LinearStiffness,
    Mass,
    PositiveLength,
    Quantity,
)
from mbd_sim.mechanism_file.schema.base_schema import Spec
from mbd_sim.mechanism_file.schema.law_schema import ForceOfElongation, ForceTable, LinearPowerSpec

CoordinateName = Annotated[str, StringConstraints(min_length=1)]
NaturalLength = Annotated[Length, Quantity("m", at_least=0)]
Force = Annotated[TimeExpression, ExpressionField("N", state=True)]
Torque = Annotated[TimeExpression, ExpressionField("N*m", state=True)]
Effort = Annotated[TimeExpression, ExpressionField(None, state=True)]
Axes = Annotated[str, Field(description="ground, part (the part that the element acts on), or any part or part.point")]
PositiveStiffness = Annotated[float, Quantity("N/m", above=0)]


class SpringSpec(Spec):
    """A spring with a damper in parallel, straight between two points; it pushes where it is shorter than `length`.

    `force`, an expression of the elongation x in m, its rate x.velocity and joint coordinates, or `table` replaces
    `stiffness`.
    """

    type: Literal["spring"]
    between: tuple[str, str]
    stiffness: LinearStiffness = 0.0
    force: ForceOfElongation | None = None
    table: ForceTable | None = None
    length: NaturalLength = Field(0.0, description="natural length")
    damping: LinearDamping = 0.0
    mass: Mass = Field(0.0, description="mass of the spring itself; one end must be on ground")

    @model_validator(mode="after")
    def _one_law(self) -> SpringSpec:
        given = [key for key in ("stiffness", "force", "table") if key in self.model_fields_set]
        if len(given) > 1:
            raise InputError(f"has {' and '.join(given)}", "Give one of them.")
        return self


class ElasticBarSpec(Spec):
    """An elastic bar, straight between two points, with the strain of Green and St. Venant or with small strain.

    Its stiffness is E A / length.
    """

    type: Literal["elastic_bar"]
    between: tuple[str, str]
    stiffness: PositiveStiffness
    length: PositiveLength
    strain: Literal["green", "small"] = "green"
    damping: LinearDamping = 0.0


class DamperSpec(LinearPowerSpec):
    """A damper between two points: along their line, or against their relative velocity in every direction."""

    type: Literal["damper"]
    between: tuple[str, str]
    along: Literal["line", "velocity"] = "line"


class PointForceSpec(Spec):
    """A force at a point, as expressions, in the axes of ground, its part (a follower force) or another."""

    type: Literal["force"]
    at: str
    vector: tuple[Force, Force, Force]
    axes: Axes = "ground"


class CoupleSpec(Spec):
    """A couple on a part, as expressions, in the axes of ground, its part or another."""

    type: Literal["couple"]
    on: str
    vector: tuple[Torque, Torque, Torque]
    axes: Axes = "ground"


class EffortSpec(Spec):
    """An effort along a joint coordinate, in N or N·m, as an expression."""

    type: Literal["effort"]
    coordinate: CoordinateName
    effort: Effort


AnyForceSpec = Annotated[
    SpringSpec | ElasticBarSpec | DamperSpec | PointForceSpec | CoupleSpec | EffortSpec, Field(discriminator="type")
]
