"""What the records of a mechanism file are made of."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Discriminator,
    StringConstraints,
    Tag,
    WithJsonSchema,
    model_validator,
)

from mbd_sim.errors import InputError
from mbd_sim.mechanism_file.quantity import Angle, Length, Number

SUFFIX = "Spec"  # of the names of these classes, which JSON Schema leaves out
NAME_PATTERN = r"^[A-Za-z][A-Za-z0-9_]*$"
Name = Annotated[str, StringConstraints(pattern=NAME_PATTERN, max_length=60)]


def _not_zero(numbers: tuple[float, ...]) -> tuple[float, ...]:
    if not any(numbers):
        raise InputError("must not be zero", f"Give for example [{', '.join(['0'] * (len(numbers) - 1))}, 1].")
    return numbers


Vector = tuple[Length, Length, Length]
Direction = Annotated[tuple[Number, Number, Number], AfterValidator(_not_zero)]
Quaternion = Annotated[tuple[Number, Number, Number, Number], AfterValidator(_not_zero)]
Value = Annotated[Any, WithJsonSchema({"type": ["number", "string"]})]


class Spec(BaseModel):
    """A mapping in the file: unknown keys are errors, and a key without value counts as not given."""

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        arbitrary_types_allowed=False,
        model_title_generator=lambda model: model.__name__.removesuffix(SUFFIX),
    )

    @model_validator(mode="before")
    @classmethod
    def _given(cls, data: Any) -> Any:
        return {key: value for key, value in data.items() if value is not None} if isinstance(data, dict) else data


def _exactly_one(record: Spec, *keys: str) -> None:
    given = [key for key in keys if getattr(record, key) is not None]
    if len(given) != 1:
        raise InputError(f"needs exactly one of {', '.join(keys)}", "Given: " + (", ".join(given) or "none") + ".")


class RotationSpec(Spec):
    """An orientation: `axis` and `angle`, or roll-pitch-yaw about fixed x, y, z, or a quaternion (w, x, y, z)."""

    axis: Direction | None = None
    angle: Angle | None = None
    rpy: tuple[Angle, Angle, Angle] | None = None
    quaternion: Quaternion | None = None

    @model_validator(mode="after")
    def _one_form(self) -> RotationSpec:
        _exactly_one(self, "axis", "rpy", "quaternion")
        if (self.axis is None) != (self.angle is None):
            raise InputError("axis and angle belong together", "Give both.")
        return self


class PointSpec(Spec):
    """A named point of a part, with an orientation where a joint needs one."""

    at: Vector = (0.0, 0.0, 0.0)
    rotate: RotationSpec | None = None


def written_as(value: Any) -> str:
    """Whether a value that may be either is written as a list or as a mapping."""
    return "list" if isinstance(value, list | tuple) else "mapping"


PointOrVector = Annotated[
    Annotated[Vector, Tag("list")] | Annotated[PointSpec, Tag("mapping")],
    Discriminator(written_as),
]
