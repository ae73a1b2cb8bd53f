"""The drives of joints: expressions of the time, or records of drives that follow commands."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from mbd_sim.errors import InputError
from mbd_sim.mechanism.expression import TimeExpression
from mbd_sim.mechanism_file.expression_field import ExpressionField
from mbd_sim.mechanism_file.quantity import Angle, Length, Quantity
from mbd_sim.mechanism_file.schema.base_schema import Spec
from mbd_sim.mechanism_file.schema.law_schema import PositiveAngularVelocity, PositiveVelocity

AngleOfTime = Annotated[TimeExpression, ExpressionField("rad")]
LengthOfTime = Annotated[TimeExpression, ExpressionField("m")]


class CommandedDriveSpec(Spec):
    """A drive that follows commands of its position or of its velocity.

    Position, velocity and acceleration are continuous.
    """

    command: Literal["position", "velocity"]
    bandwidth: Annotated[float, Quantity("rad/s", above=0)] = Field(description="with which it follows, without limits")

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
    acceleration_limit: Annotated[float, Quantity("rad/s**2", above=0)] | None = None
    lower: Angle | None = Field(None, description="which the position does not fall below, whatever is commanded")
    upper: Angle | None = Field(None, description="which the position does not exceed, whatever is commanded")


class LengthDriveSpec(CommandedDriveSpec):
    """A drive of a displacement that follows commands."""

    position: Length = Field(0.0, description="at the start")
    velocity_limit: PositiveVelocity | None = None
    acceleration_limit: Annotated[float, Quantity("m/s**2", above=0)] | None = None
    lower: Length | None = Field(None, description="which the position does not fall below, whatever is commanded")
    upper: Length | None = Field(None, description="which the position does not exceed, whatever is commanded")


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


def _form(value: Any) -> str:
    """Whether a drive is written as a `mapping` or as an `expression`."""
    return "mapping" if isinstance(value, dict | CommandedDriveSpec) else "expression"


AngleDrive = Annotated[
    Annotated[AngleOfTime, Tag("expression")] | Annotated[AngleDriveSpec, Tag("mapping")], Discriminator(_form)
]
LengthDrive = Annotated[
    Annotated[LengthOfTime, Tag("expression")] | Annotated[LengthDriveSpec, Tag("mapping")], Discriminator(_form)
]
