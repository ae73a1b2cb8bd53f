"""The force elements of a mechanism file: between points of parts, or on a part."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field, StringConstraints, model_validator

from mbd_sim.base.errors import InputError
from mbd_sim.files.schema.fields import (
    AnyNumber,
    EffortField,
    ExpressionField,
    Length,
    LinearDamping,
    LinearDamping3,
    LinearStiffness,
    LinearStiffness3,
    Mass,
    PositiveLength,
    QuantityField,
    Spec,
    TorsionDamping3,
    TorsionStiffness3,
)
from mbd_sim.files.schema.laws import ForceOfElongation, ForceTable, LinearPowerSpec
from mbd_sim.mechanism.values.expression import TimeExpression

SYMMETRIC = 1e-12  # relative difference of two numbers that count as equal
CoordinateName = Annotated[str, StringConstraints(min_length=1)]
NaturalLength = Annotated[Length, QuantityField("m", at_least=0)]
Force = Annotated[TimeExpression, ExpressionField("N", state=True)]
Torque = Annotated[TimeExpression, ExpressionField("N*m", state=True)]
Effort = Annotated[TimeExpression, EffortField(None, state=True)]
Axes = Annotated[str, Field(description="ground, part (the part that the element acts on), or any part or part.point")]


def _without_gain(rows: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
    """Refuse a matrix of stiffness or damping that is not symmetric, or has a negative eigenvalue."""
    matrix = np.array(rows)
    size = float(np.max(np.abs(matrix)))
    if np.any(np.abs(matrix - matrix.T) > SYMMETRIC * size):
        raise InputError("is not symmetric", "Write the same number at both sides of the diagonal.")
    if np.linalg.eigvalsh(matrix)[0] < -SYMMETRIC * size:
        raise InputError("has a negative eigenvalue: it would give energy away", "Check its numbers.")
    return rows


Row6 = tuple[AnyNumber, AnyNumber, AnyNumber, AnyNumber, AnyNumber, AnyNumber]
Matrix6 = Annotated[tuple[Row6, Row6, Row6, Row6, Row6, Row6], AfterValidator(_without_gain)]
_STIFFNESS = ("stiffness", "rotational_stiffness", "stiffness_matrix")
_DAMPING = ("damping", "rotational_damping", "damping_matrix")
PositiveStiffness = Annotated[float, QuantityField("N/m", above=0)]


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


class LineForceSpec(Spec):
    """A force along the line between two points, which pulls them together where it is positive.

    It is an expression of their distance less `length`, x in m, of its rate x.velocity, and of joint coordinates.
    """

    type: Literal["line_force"]
    between: tuple[str, str]
    force: ForceOfElongation
    length: NaturalLength = Field(0.0, description="distance at which x is zero")


class BushingSpec(Spec):
    """An elastic connection of two points with their axes in all six directions, with dampers.

    Stiffness and damping are along and about the axes of the first point: three numbers, or one for all.
    Matrices (6, 6) in SI units replace them.
    """

    type: Literal["bushing"]
    between: tuple[str, str]
    stiffness: LinearStiffness3 = 0.0
    rotational_stiffness: TorsionStiffness3 = 0.0
    damping: LinearDamping3 = 0.0
    rotational_damping: TorsionDamping3 = 0.0
    stiffness_matrix: Matrix6 | None = None
    damping_matrix: Matrix6 | None = None

    @model_validator(mode="after")
    def _one_form(self) -> BushingSpec:
        for kind in ("stiffness", "damping"):
            both = {kind, f"rotational_{kind}"} & self.model_fields_set
            if getattr(self, f"{kind}_matrix") is not None and both:
                raise InputError(f"has {kind}_matrix and {sorted(both)[0]}", "Give one of them.")
        if not {*_STIFFNESS, *_DAMPING} & self.model_fields_set:
            raise InputError("has neither stiffness nor damping", f"Give one of {', '.join((*_STIFFNESS, *_DAMPING))}.")
        return self


class EffortSpec(Spec):
    """An effort along a joint coordinate, in N or N·m, as an expression."""

    type: Literal["effort"]
    coordinate: CoordinateName
    effort: Effort


class PotentialSpec(Spec):
    """A potential in J, as an expression of joint coordinates and the time; its forces act along the coordinates."""

    type: Literal["potential"]
    energy: Annotated[TimeExpression, ExpressionField("J", state=True, speeds=False)]


AnyForceSpec = Annotated[
    SpringSpec
    | ElasticBarSpec
    | DamperSpec
    | LineForceSpec
    | BushingSpec
    | PointForceSpec
    | CoupleSpec
    | EffortSpec
    | PotentialSpec,
    Field(discriminator="type"),
]
