"""The drives of joints: expressions of the time, or records of drives that follow commands."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from mbd_sim.errors import InputError
from mbd_sim.mechanism_file.expression_field import AngleOfTime, LengthOfTime
from mbd_sim.mechanism_file.quantity import Angle, Length, PositiveAngularVelocity, PositiveVelocity, Quantity
from mbd_sim.mechanism_file.schema.base_schema import Spec


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


def _form(value: Any) -> str:
    """Whether a drive is written as a `mapping` or as an `expression`."""
    return "mapping" if isinstance(value, dict | CommandedDriveSpec) else "expression"


AngleDrive = Annotated[
    Annotated[AngleOfTime, Tag("expression")] | Annotated[AngleDriveSpec, Tag("mapping")], Discriminator(_form)
]
LengthDrive = Annotated[
    Annotated[LengthOfTime, Tag("expression")] | Annotated[LengthDriveSpec, Tag("mapping")], Discriminator(_form)
]
