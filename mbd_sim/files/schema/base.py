"""The base class and the common fields of the records of a mechanism file."""

from __future__ import annotations

from functools import cache
from typing import Annotated, Any

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Discriminator,
    StringConstraints,
    Tag,
    TypeAdapter,
    WithJsonSchema,
    model_validator,
)

from mbd_sim.base.errors import InputError
from mbd_sim.files.schema.fields import (
    Angle,
    Length,
    LinearDamping,
    LinearStiffness,
    Number,
    TorsionDamping,
    TorsionStiffness,
)
from mbd_sim.files.text.spelling import FORMER_KEYS
from mbd_sim.mechanism.values.names import FRAME_PATTERN, LONGEST_NAME, NAME_PATTERN, PLAIN_PATTERN

SUFFIX = "Spec"  # of the class names; the JSON Schema omits it
Name = Annotated[str, StringConstraints(pattern=NAME_PATTERN, max_length=LONGEST_NAME)]
FrameName = Annotated[str, StringConstraints(pattern=FRAME_PATTERN, max_length=LONGEST_NAME)]
PlainName = Annotated[str, StringConstraints(pattern=PLAIN_PATTERN, max_length=60)]
Color = Annotated[str, StringConstraints(pattern=r"^#[0-9a-fA-F]{6}$")]


def _not_zero(numbers: tuple[float, ...]) -> tuple[float, ...]:
    if not any(numbers):
        raise InputError("must not be zero", f"Write for example [{', '.join(['0'] * (len(numbers) - 1))}, 1].")
    return numbers


Vector = tuple[Length, Length, Length]
Direction = Annotated[tuple[Number, Number, Number], AfterValidator(_not_zero)]
Quaternion = Annotated[tuple[Number, Number, Number, Number], AfterValidator(_not_zero)]
Value = Annotated[Any, WithJsonSchema({"type": ["number", "string"]})]


class Spec(BaseModel):
    """A mapping in the file. Unknown keys are errors; a key without value counts as absent."""

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        arbitrary_types_allowed=False,
        defer_build=True,
        model_title_generator=lambda model: model.__name__.removesuffix(SUFFIX),
    )

    @model_validator(mode="before")
    @classmethod
    def _given(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        known = {name for key, field in cls.model_fields.items() for name in (key, field.alias)}
        given = {cls._current_key(key, data): value for key, value in data.items()}
        return {key: value for key, value in given.items() if value is not None or key not in known}

    @classmethod
    def _current_key(cls, key: str, data: dict[str, Any]) -> str:
        current = FORMER_KEYS.get(key, key)
        return current if current in cls.model_fields and current not in data else key


@cache
def validator_of(kind: Any) -> TypeAdapter[Any]:
    """What reads values of a type, and knows its schema."""
    return TypeAdapter(kind)


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
    """A named point of a part, with an orientation if a joint needs one."""

    at: Vector = (0.0, 0.0, 0.0)
    rotate: RotationSpec | None = None


def written_as(value: Any) -> str:
    """Whether a value is written as a `list` or as a `mapping`."""
    return "list" if isinstance(value, list | tuple) else "mapping"


def list_or_number(value: Any) -> str:
    """Whether a value is written as a `list` or as a `number`."""
    return "list" if isinstance(value, list | tuple) else "number"


PointOrVector = Annotated[
    Annotated[Vector, Tag("list")] | Annotated[PointSpec, Tag("mapping")],
    Discriminator(written_as),
]

# Three numbers, or one for all of them.
LinearStiffness3 = Annotated[
    Annotated[LinearStiffness, Tag("number")]
    | Annotated[tuple[LinearStiffness, LinearStiffness, LinearStiffness], Tag("list")],
    Discriminator(list_or_number),
]
TorsionStiffness3 = Annotated[
    Annotated[TorsionStiffness, Tag("number")]
    | Annotated[tuple[TorsionStiffness, TorsionStiffness, TorsionStiffness], Tag("list")],
    Discriminator(list_or_number),
]
LinearDamping3 = Annotated[
    Annotated[LinearDamping, Tag("number")]
    | Annotated[tuple[LinearDamping, LinearDamping, LinearDamping], Tag("list")],
    Discriminator(list_or_number),
]
TorsionDamping3 = Annotated[
    Annotated[TorsionDamping, Tag("number")]
    | Annotated[tuple[TorsionDamping, TorsionDamping, TorsionDamping], Tag("list")],
    Discriminator(list_or_number),
]
