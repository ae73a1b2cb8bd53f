"""The base class of the records of a mechanism file, and its fields: a `Length` accepts `0.5`, `12 in` or `l/2`, in m.

Some fields hold an expression of variables, such as a force as a function of the time.

The dimension of others depends on other keys, such as that of the `effort_limit` of an actuator, which is in N on a
slider and in N·m on a hinge. Such values keep their unit, and are checked once the dimension is known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from itertools import chain
from typing import Annotated, Any, Literal, TypeVar, cast

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    StringConstraints,
    Tag,
    TypeAdapter,
    ValidationInfo,
    WithJsonSchema,
    model_validator,
)
from pydantic_core import CoreSchema, core_schema

from mbd_sim.base.errors import InputError, nearest, quoted
from mbd_sim.base.geometry.batch import Batch
from mbd_sim.files.text.parameters import Parameters
from mbd_sim.files.text.spelling import FORMER_KEYS
from mbd_sim.files.text.units import parse_value, split_unit, unit_factor
from mbd_sim.mechanism.values.expression import TIME, StateName, TimeExpression, names_in, require_valid, tables_in
from mbd_sim.mechanism.values.names import FRAME_PATTERN, LONGEST_NAME, NAME_PATTERN, PLAIN_PATTERN

# Beyond these, products such as density · r³ · r² would overflow or vanish. A smaller value that may be 0 becomes 0.
LARGEST, SMALLEST = 1e40, 1e-60
UNKNOWN = TimeExpression("0", {})  # in place of an expression whose problem is reported already


@dataclass(frozen=True)
class QuantityField:
    """Marks a float field as a quantity in the SI unit `unit`, within bounds; with `unit` None, of any dimension."""

    unit: str | None
    above: float | None = None
    at_least: float | None = None
    at_most: float | None = None

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.with_info_plain_validator_function(
            self._validate, serialization=core_schema.plain_serializer_function_ser_schema(float)
        )

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        number: dict[str, Any] = {"type": "number", **({} if self.unit is None else {"x-unit": self.unit})}
        if self.above is not None:
            number["exclusiveMinimum"] = self.above
        if self.at_least is not None:
            number["minimum"] = self.at_least
        if self.at_most is not None:
            number["maximum"] = self.at_most
        kind = f"in {self.unit}" if self.unit else "a plain number"
        return {
            "anyOf": [number, {"type": "string"}],
            "description": f"{kind}, or a value with a unit, or an expression",
        }

    def _validate(self, value: Any, info: ValidationInfo) -> float:
        parameters = info.context or Parameters()
        try:
            return self._parsed(value, parameters)
        except InputError as error:
            if parameters.lenient:
                return math.nan
            raise InputError(error.message, error.remedy, value) from error

    def _parsed(self, value: Any, parameters: Parameters) -> float:
        if isinstance(value, str) and parameters.unknown_in(value):
            return math.nan  # the problem is reported at the parameter, not at each use of it
        if isinstance(value, str):
            expression, _ = split_unit(value)
            if parameters.ambiguous:
                parameters.require_clear(parameters.functions.expanded(expression))
            parameters.require_unit(expression, self.unit)
        number = parse_value(value, parameters.values, self.unit, parameters.functions.expanded)
        if abs(number) < SMALLEST and not (self.above is not None and number > 0.0):
            number = 0.0
        if abs(number) > LARGEST or 0.0 < abs(number) < SMALLEST:
            size = "small" if abs(number) < 1.0 else "large"
            raise InputError(f"is {number:.3g}, too {size} to compute with", "Check its unit and its power of ten.")
        found = "" if isinstance(value, int | float) else f", but is {number:g}"  # a number is shown as the value
        if self.above is not None and not number > self.above:
            raise InputError(f"must be greater than {self.above:g}{found}", "Write a positive number.")
        if self.at_least is not None and not number >= self.at_least:
            remedy = "a positive number" if self.at_least == 0.0 else "a larger number"
            raise InputError(f"must be at least {self.at_least:g}{found}", f"Write {self.at_least:g} or {remedy}.")
        if self.at_most is not None and not number <= self.at_most:
            raise InputError(f"must be at most {self.at_most:g}{found}", f"Write {self.at_most:g} or a smaller number.")
        return number


Number = Annotated[float, QuantityField("")]
AnyNumber = Annotated[float, QuantityField(None)]  # with a unit of any dimension
Restitution = Annotated[float, QuantityField("", at_least=0, at_most=1)]
Angle = Annotated[float, QuantityField("rad")]
AngularVelocity = Annotated[float, QuantityField("rad/s")]
PositiveAngularVelocity = Annotated[float, QuantityField("rad/s", above=0)]
Length = Annotated[float, QuantityField("m")]
PositiveLength = Annotated[float, QuantityField("m", above=0)]
Lead = Annotated[float, QuantityField("m/turn")]
PositiveLead = Annotated[float, QuantityField("m/turn", above=0)]
Velocity = Annotated[float, QuantityField("m/s")]
PositiveVelocity = Annotated[float, QuantityField("m/s", above=0)]
Acceleration = Annotated[float, QuantityField("m/s**2")]
Mass = Annotated[float, QuantityField("kg", at_least=0)]
PositiveDensity = Annotated[float, QuantityField("kg/m**3", above=0)]
MomentOfInertia = Annotated[float, QuantityField("kg*m**2")]
PositiveTime = Annotated[float, QuantityField("s", above=0)]
Delay = Annotated[float, QuantityField("s", at_least=0)]
Frequency = Annotated[float, QuantityField("Hz", above=0)]
PositiveForce = Annotated[float, QuantityField("N", above=0)]
PositiveTorque = Annotated[float, QuantityField("N*m", above=0)]
LinearStiffness = Annotated[float, QuantityField("N/m", at_least=0)]
LinearDamping = Annotated[float, QuantityField("N*s/m", at_least=0)]
TorsionStiffness = Annotated[float, QuantityField("N*m/rad", at_least=0)]
TorsionDamping = Annotated[float, QuantityField("N*m*s/rad", at_least=0)]


@dataclass(frozen=True)
class ExpressionField:
    """Marks a field as an expression in the SI unit `unit`; the field holds a `TimeExpression` in SI units.

    With `unit` None, a unit of any dimension is accepted. `variables` are the names that vary while the mechanism
    moves: the time t in s if nothing else is given. With `state`, the time, and joint coordinates and speeds by name
    vary too; parameters hide the time then unless it is among the variables, and the short names of coordinates.
    Without `speeds`, only coordinates do.
    """

    unit: str | None
    variables: tuple[str, ...] = (TIME,)
    state: bool = False
    speeds: bool = True

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.with_info_plain_validator_function(self._validate)

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        unit = f"in {self.unit}, " if self.unit else ""
        found: dict[str, Any] = {"type": ["number", "string"], **({"x-unit": self.unit} if self.unit else {})}
        return {**found, "description": f"{unit}an expression of {self._variables_in_words()}"}

    def _variables_in_words(self) -> str:
        own = "the time t in s" if self.variables == (TIME,) else ", ".join(self.variables)
        joints = " and of joint coordinates such as crank" + (" and crank.velocity" if self.speeds else "")
        return own + joints if self.state else own

    def _validate(self, value: Any, info: ValidationInfo) -> TimeExpression:
        parameters = info.context or Parameters()
        try:
            return self._in_unit_of(info, parameters)._parsed(value, parameters)
        except InputError as error:
            if parameters.lenient:
                return UNKNOWN
            raise InputError(error.message, error.remedy, value) from error

    def _in_unit_of(self, info: ValidationInfo, parameters: Parameters) -> ExpressionField:
        """This field in the unit that other fields of the same record require."""
        return self

    def _parsed(self, value: Any, parameters: Parameters) -> TimeExpression:
        values = parameters.values
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            example = "0.1*sin(5*t)" if self.variables == (TIME,) else f"0.1*{self.variables[0]}**2"
            message = f"must be an expression of {self._variables_in_words()}"
            raise InputError(message, f"Write for example {example}.")
        if isinstance(value, str) and parameters.unknown_in(value):
            return UNKNOWN  # the problem is reported at the parameter, not at each use of it
        expression, unit = split_unit(str(value))
        parameters.require_unit(expression, None if unit else self.unit)
        expression = parameters.functions.expanded(expression)
        parameters.require_clear(expression, self.state)
        used = names_in(expression, values)
        if hidden := [name for name in self.variables if name in values and (name in used or name == TIME)]:
            what = "time" if hidden[0] == TIME else f"variable '{hidden[0]}'"
            raise InputError(f"the parameter '{hidden[0]}' hides the {what}", "Rename the parameter.")
        tables = tables_in(expression)
        if tables & parameters.unreadable_tables:
            return UNKNOWN
        state = self._state_names(expression, sorted(used), parameters)
        if unit:
            expression = f"({expression})*{unit_factor(unit, self.unit)!r}"
        found = {name: parameters.tables[name] for name in sorted(tables) if name in parameters.tables}
        result = TimeExpression(expression, parameters.among(used), found, state)
        require_valid(expression, (*result.names, *result.variables), parameters.tables)
        if self.variables == (TIME,) and not state:
            result.at(0.0)  # raises where it has no finite value at the start
        return result

    def _state_names(self, text: str, used: list[str], parameters: Parameters) -> tuple[StateName, ...]:
        """Those of the used names that are neither parameters nor variables, as coordinates and speeds.

        :raises InputError: they are not, or the expression cannot depend on them.
        """
        values, coordinates = parameters.values, parameters.coordinates
        others = [name for name in used if name not in values and name not in self.variables]
        if self.state:
            others = [name for name in others if name != TIME]
        found = [coordinates.resolve(name) for name in others]
        for name, state in zip(others, found, strict=True):
            if state is None:
                known = chain(values, self.variables, coordinates.suggestions if self.state else ())
                remedy = coordinates.remedy_for_missing_quotes(text) if self.state else ""
                raise InputError(f"unknown name {quoted(name)}", remedy or nearest(name, known))
            if not self.state:
                message = f"{quoted(name)} is a joint coordinate, on which this expression cannot depend"
                raise InputError(message, f"It can depend on {self._variables_in_words()}.")
            if state.speed and not self.speeds:
                message = f"{quoted(name)} is a speed, and this expression can depend on coordinates only"
                raise InputError(message, f"Write {state.coordinate}, or use a force.")
        return tuple(state for state in found if state is not None)


class EffortField(ExpressionField):
    """Marks a field as an effort along the joint coordinate that the field `coordinate` before it names."""

    def _in_unit_of(self, info: ValidationInfo, parameters: Parameters) -> ExpressionField:
        named = info.data.get("coordinate") if info.data else None
        return replace(self, unit=parameters.coordinates.effort_units.get(str(named), self.unit))


AngleOfTime = Annotated[TimeExpression, ExpressionField("rad")]
LengthOfTime = Annotated[TimeExpression, ExpressionField("m")]


class Measured(float):
    """A number in SI units that was `written` in `unit`; both are empty without one."""

    unit: str = ""
    written: str = ""

    def require(self, si_unit: str) -> None:
        """Check the dimension of the unit.

        :raises InputError: it is another one than that of `si_unit`.
        """
        if self.unit:
            try:
                unit_factor(self.unit, si_unit)
            except InputError as error:
                raise InputError(error.message, error.remedy, self.written) from error


def plain(value: Any) -> Any:
    """The number without its unit; a batch of numbers as it is."""
    return value if isinstance(value, Batch) else float(value)


class MeasuredField(QuantityField):
    """Marks a field as a quantity whose unit is checked later; its value is `Measured`."""

    def _parsed(self, value: Any, parameters: Parameters) -> float:
        parsed: Any = super()._parsed(value, parameters)
        if isinstance(parsed, Batch):
            return cast(float, parsed)  # its unit is checked with the numbers of single variants
        number = Measured(parsed)
        if isinstance(value, str) and not parameters.unknown_in(value):
            expression, unit = split_unit(value)
            number.unit, number.written = unit or parameters.unit_of(expression), value
        return number


AnyAmount = Annotated[float, MeasuredField(None)]
PositiveAmount = Annotated[float, MeasuredField(None, above=0)]
AmountFromZero = Annotated[float, MeasuredField(None, at_least=0)]


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
    """A named point of a part, with an orientation if a joint needs one.

    In place of `at`, a `dxf` drawing can have it: as the only point, circle or block on a `layer`.
    """

    at: Vector = (0.0, 0.0, 0.0)
    rotate: RotationSpec | None = None
    dxf: str = Field("", description="path of a drawing, relative to this file")
    layer: str = ""
    unit: str = Field("", description="of the drawing, such as mm, if it does not say it itself")
    origin: tuple[float, float] | str = Field((0.0, 0.0), description="of the part in the drawing, or its layer")
    plane: Literal["xy", "xz", "yz"] = "xy"


def written_as(value: Any) -> str:
    """Whether a value is written as a `list` or as a `mapping`."""
    return "list" if isinstance(value, list | tuple) else "mapping"


def list_or_word(value: Any) -> str:
    """Whether a value is written as a `list` or as a `word`."""
    return "list" if isinstance(value, list | tuple) else "word"


def list_or_number(value: Any) -> str:
    """Whether a value is written as a `list` or as a `number`."""
    return "list" if isinstance(value, list | tuple) else "number"


PointOrVector = Annotated[
    Annotated[Vector, Tag("list")] | Annotated[PointSpec, Tag("mapping")],
    Discriminator(written_as),
]

NumberType = TypeVar("NumberType")
# Three numbers, or one for all of them.
OneOrThree = Annotated[
    Annotated[NumberType, Tag("number")] | Annotated[tuple[NumberType, NumberType, NumberType], Tag("list")],
    Discriminator(list_or_number),
]
LinearStiffness3 = OneOrThree[LinearStiffness]
TorsionStiffness3 = OneOrThree[TorsionStiffness]
LinearDamping3 = OneOrThree[LinearDamping]
TorsionDamping3 = OneOrThree[TorsionDamping]
