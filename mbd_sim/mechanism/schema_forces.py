"""The force elements of a mechanism file: what acts between points of parts, or on a part."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from mbd_sim.mechanism.expression import TimeExpression
from mbd_sim.mechanism.quantity import Length, LinearDamping, LinearStiffness, Quantity, TimeFunction
from mbd_sim.mechanism.schema_base import Record

NaturalLength = Annotated[Length, Quantity("m", at_least=0)]
Force = Annotated[TimeExpression, TimeFunction("N")]
Torque = Annotated[TimeExpression, TimeFunction("N*m")]
Axes = Literal["ground", "part"]


class Spring(Record):
    """A spring with a damper in parallel, straight between two points; it pushes where it is shorter than `length`."""

    type: Literal["spring"]
    between: tuple[str, str]
    stiffness: LinearStiffness = 0.0
    length: NaturalLength = Field(0.0, description="natural length")
    damping: LinearDamping = 0.0


class PointForce(Record):
    """A force at a point, as expressions of time; with `axes: part` it turns with the part (a follower force)."""

    type: Literal["force"]
    at: str
    vector: tuple[Force, Force, Force]
    axes: Axes = "ground"


class Couple(Record):
    """A couple on a part, as expressions of time; with `axes: part` it turns with the part."""

    type: Literal["couple"]
    on: str
    vector: tuple[Torque, Torque, Torque]
    axes: Axes = "ground"


AnyForce = Annotated[Spring | PointForce | Couple, Field(discriminator="type")]
