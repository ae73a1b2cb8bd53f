"""The numeric fields of a mechanism file: a number, a value with a unit, or an expression.

A field of type `Length` takes `0.5`, `12 in`, `l/2`, `${l/2}`, `-${l}/2` and `${l/2} mm`, and holds metres.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler, ValidationInfo
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from mbd_sim.errors import nearest, quoted
from mbd_sim.mechanism.expression import MAX_LENGTH, TIME, ExpressionError, TimeExpression, evaluate, names_in
from mbd_sim.mechanism_file.units import factor, si_factor

# Beyond these, products such as density · r³ · r² would overflow or vanish. What may be 0 is 0 below the smallest.
LARGEST, SMALLEST = 1e40, 1e-60

_UNIT = r"([A-Za-zµμ°%][\w°%·*/^ ().-]*)"
_NUMBER_WITH_UNIT = re.compile(rf"([-+]?(?>(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?))\s*{_UNIT}", re.ASCII)
_TEMPLATE_WITH_UNIT = re.compile(rf"(.*\}})\s*{_UNIT}", re.ASCII)
_BRACED = re.compile(r"\$\{([^{}]*)\}")
_ARITHMETIC_WITH_UNIT = re.compile(rf"(.*[\w)])\s+{_UNIT}", re.ASCII)
# What texts copied from books and web pages hold in place of plain characters.
_PLAIN = str.maketrans(
    {"\u00a0": " ", "\u2009": " ", "\u202f": " ", "−": "-", "×": "*", "·": "*", "²": "**2", "³": "**3"}
)


def split_unit(text: str) -> tuple[str, str]:
    """An expression and its unit (`""` where none is given): `"30 deg"` is `("30", "deg")`.

    :raises ExpressionError: the text is too long to be a value.
    """
    if len(text) > MAX_LENGTH:
        raise ExpressionError(f"is longer than {MAX_LENGTH} characters", "Split it into parameters.")
    text = text.translate(_PLAIN).strip()
    form = _TEMPLATE_WITH_UNIT if "${" in text else _NUMBER_WITH_UNIT
    expression, unit = found.groups() if (found := form.fullmatch(text)) else (text, "")
    return _BRACED.sub(r"(\1)", expression), unit.strip()


def parse_value(value: object, names: Mapping[str, float], si_unit: str | None) -> float:
    """A finite number in SI units; a `si_unit` of None takes a unit of any dimension.

    :raises ExpressionError: not a finite number, an unknown name, or a unit that does not fit.
    """
    if value is None:
        raise ExpressionError("has no value", "Give it one.")
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ExpressionError("must be a number", "Write for example 0.5, 30 deg, or l/2.")
    if isinstance(value, str):
        expression, unit = split_unit(value)
        number = _evaluated(expression, names)
        if unit:
            number *= _factor(expression, unit, names, si_unit)
    else:
        number = float(value)
    if not math.isfinite(number):
        raise ExpressionError("must be finite", "Write a number such as 0.5 or 1e6.")
    return number


def _evaluated(expression: str, names: Mapping[str, float]) -> float:
    try:
        return evaluate(expression, names)
    except ExpressionError as error:
        form = _ARITHMETIC_WITH_UNIT.fullmatch(expression)
        if form is None:
            raise
        try:
            evaluate(form[1], names)
            si_factor(form[2])
        except ExpressionError:
            raise error from None
        braced = quoted(f"${{{form[1]}}} {form[2]}")
        raise ExpressionError(str(error), f"Put the arithmetic before a unit in braces: {braced}.") from error


def _factor(expression: str, unit: str, names: Mapping[str, float], si_unit: str | None) -> float:
    try:
        return _unit_factor(unit, si_unit)
    except ExpressionError as error:
        if unit in names:
            remedy = f"To multiply by the parameter, write {expression}*{unit}."
            raise ExpressionError(str(error), remedy) from error
        raise


@dataclass(frozen=True)
class Quantity:
    """Marks a float field as a quantity in `unit`, within bounds."""

    unit: str
    above: float | None = None
    at_least: float | None = None

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.with_info_plain_validator_function(
            self._validate, serialization=core_schema.plain_serializer_function_ser_schema(float)
        )

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        number: dict[str, Any] = {"type": "number"}
        if self.above is not None:
            number["exclusiveMinimum"] = self.above
        if self.at_least is not None:
            number["minimum"] = self.at_least
        kind = f"in {self.unit}" if self.unit else "a plain number"
        return {
            "anyOf": [number, {"type": "string"}],
            "description": f"{kind}, or a value with a unit, or an expression",
        }

    def _validate(self, value: Any, info: ValidationInfo) -> float:
        context = info.context or {}
        names, unresolved = context.get("parameters", {}), context.get("unresolved", frozenset())
        try:
            if isinstance(value, str) and unresolved and names_in(split_unit(value)[0]) & unresolved:
                return math.nan  # the parameter is reported; what uses it is not
            number = parse_value(value, names, self.unit)
            if abs(number) < SMALLEST and not (self.above is not None and number > 0.0):
                number = 0.0
            if abs(number) > LARGEST or 0.0 < abs(number) < SMALLEST:
                size = "small" if abs(number) < 1.0 else "large"
                remedy = "Check its unit and its power of ten."
                raise ExpressionError(f"is {number:.3g}, too {size} to compute with", remedy)
        except ExpressionError as error:
            raise PydanticCustomError("quantity", "{why}", {"why": str(error), "remedy": error.remedy}) from error
        if self.above is not None and not number > self.above:
            raise _out_of_bounds(f"must be greater than {self.above:g}", number, "Write a positive number.")
        if self.at_least is not None and not number >= self.at_least:
            raise _out_of_bounds(f"must be at least {self.at_least:g}", number, "Write 0 or a positive number.")
        return number


@dataclass(frozen=True)
class TimeFunction:
    """Marks a field as an expression of time in `unit`; the field holds a `TimeExpression` in SI units.

    A `unit` of None takes any; `variables` are the names that stand for something that changes.
    """

    unit: str | None
    variables: tuple[str, ...] = (TIME,)

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.with_info_plain_validator_function(self._validate)

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        unit = f"in {self.unit}, " if self.unit else ""
        return {"type": ["number", "string"], "description": f"{unit}an expression of {self._named()}"}

    def _named(self) -> str:
        return "the time t in s" if self.variables == (TIME,) else ", ".join(self.variables)

    def _validate(self, value: Any, info: ValidationInfo) -> TimeExpression:
        context = info.context or {}
        names, unresolved = dict(context.get("parameters", {})), context.get("unresolved", frozenset())
        try:
            if isinstance(value, bool) or not isinstance(value, int | float | str):
                example = "0.1*sin(5*t)" if self.variables == (TIME,) else f"0.1*{self.variables[0]}**2"
                raise ExpressionError(f"must be an expression of {self._named()}", f"Write for example {example}.")
            expression, unit = split_unit(str(value))
            used = names_in(expression)
            if hidden := [name for name in self.variables if name in names and (name in used or name == TIME)]:
                what = "time" if hidden[0] == TIME else f"variable '{hidden[0]}'"
                raise ExpressionError(f"the parameter '{hidden[0]}' hides the {what}", "Rename the parameter.")
            if used & unresolved:
                return TimeExpression("0", {})  # the parameter is reported; what uses it is not
            if unknown := sorted(used - set(names) - set(self.variables)):
                raise ExpressionError(
                    f"unknown name {quoted(unknown[0])}", nearest(unknown[0], [*names, *self.variables])
                )
            if unit:
                expression = f"({expression})*{_unit_factor(unit, self.unit)!r}"
            found = TimeExpression(expression, {name: names[name] for name in used & set(names)})
            if self.variables == (TIME,):
                found.at(0.0)
        except ExpressionError as error:
            raise PydanticCustomError("quantity", "{why}", {"why": str(error), "remedy": error.remedy}) from error
        return found


def _unit_factor(unit: str, si_unit: str | None) -> float:
    return si_factor(unit) if si_unit is None else factor(unit, si_unit)


def _out_of_bounds(why: str, number: float, remedy: str) -> PydanticCustomError:
    return PydanticCustomError("quantity", "{why}", {"why": f"{why}, and is {number:g}", "remedy": remedy})


Number = Annotated[float, Quantity("")]
Angle = Annotated[float, Quantity("rad")]
AngularVelocity = Annotated[float, Quantity("rad/s")]
Length = Annotated[float, Quantity("m")]
PositiveLength = Annotated[float, Quantity("m", above=0)]
Velocity = Annotated[float, Quantity("m/s")]
Acceleration = Annotated[float, Quantity("m/s**2")]
PositiveMass = Annotated[float, Quantity("kg", above=0)]
Mass = Annotated[float, Quantity("kg", at_least=0)]
PositiveDensity = Annotated[float, Quantity("kg/m**3", above=0)]
MomentOfInertia = Annotated[float, Quantity("kg*m**2")]
PositiveTime = Annotated[float, Quantity("s", above=0)]
PositiveForce = Annotated[float, Quantity("N", above=0)]
PositiveTorque = Annotated[float, Quantity("N*m", above=0)]
LinearStiffness = Annotated[float, Quantity("N/m", at_least=0)]
LinearDamping = Annotated[float, Quantity("N*s/m", at_least=0)]
TorsionStiffness = Annotated[float, Quantity("N*m/rad", at_least=0)]
TorsionDamping = Annotated[float, Quantity("N*m*s/rad", at_least=0)]
