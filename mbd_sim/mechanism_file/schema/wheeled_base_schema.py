"""The wheeled bases of a mechanism file."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, WithJsonSchema

from mbd_sim.mechanism_file.quantity import PositiveLength
from mbd_sim.mechanism_file.schema.base_schema import Spec


def _as_list(value: Any) -> Any:
    return [value] if isinstance(value, str) else value


_NAMES = {"type": "array", "items": {"type": "string"}, "minItems": 1}
JointNames = Annotated[
    list[str],
    BeforeValidator(_as_list),
    Field(min_length=1),
    WithJsonSchema({"anyOf": [{"type": "string"}, _NAMES]}),
]


class BaseSpec(Spec):
    """The keys of all bases. Wheels are named by their joints; the others by what turns them forward."""

    track: PositiveLength = Field(description="distance of the left wheels from the right ones")
    radius: PositiveLength = Field(description="of the wheels")
    reversed: list[str] = Field([], description="joints that move backward, or steer to the right, when positive")


class DifferentialBaseSpec(BaseSpec):
    """A base with wheels on both sides, which steers by their different speeds."""

    type: Literal["differential"]
    left: JointNames = Field(description="the joint of the left wheel, or a list of several")
    right: JointNames = Field(description="the joint of the right wheel, or a list of several")


class MecanumBaseSpec(BaseSpec):
    """A base with four mecanum wheels, whose rollers form an X as seen from above."""

    type: Literal["mecanum"]
    wheelbase: PositiveLength = Field(description="distance of the front wheels from the rear ones")
    front_left: str
    front_right: str
    rear_left: str
    rear_right: str


class CarBaseSpec(BaseSpec):
    """A base with driven rear wheels and steered front wheels, or one steered front wheel."""

    type: Literal["car"]
    wheelbase: PositiveLength = Field(description="distance of the front axle from the rear one")
    left: JointNames = Field(description="the joint of the left rear wheel, or a list of several")
    right: JointNames = Field(description="the joint of the right rear wheel, or a list of several")
    steering: JointNames = Field(description="the steering joint in the middle, or [left, right]")


AnyBaseSpec = Annotated[DifferentialBaseSpec | MecanumBaseSpec | CarBaseSpec, Field(discriminator="type")]
