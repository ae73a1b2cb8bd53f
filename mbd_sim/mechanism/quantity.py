"""The numeric fields of a mechanism file: a number, a value with a unit, or an expression.

A field of type `Length` takes `0.5`, `12 in`, `l/2`, `${l/2}` and `${l/2} mm`, and holds metres.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler, ValidationInfo
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from mbd_sim.mechanism.expression import ExpressionError, evaluate
from mbd_sim.mechanism.units import factor, si_factor

_NUMBER_WITH_UNIT = re.compile(
    r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([A-Za-zµμ°%][\w°%·*/^ ().-]*)\s*", re.ASCII
)
_TEMPLATE = re.compile(r"\s*\$\{([^{}]*)\}\s*(.*?)\s*")


def split_unit(text: str) -> tuple[str, str]:
    """An expression and its unit (`""` where none is given): `"30 deg"` is `("30", "deg")`."""
    template = _TEMPLATE.fullmatch(text)
    if template:
        return template[1], template[2]
    number = _NUMBER_WITH_UNIT.fullmatch(text)
    return (number[1], number[2].strip()) if number else (text, "")


def parse_value(value: object, names: Mapping[str, float], si_unit: str | None) -> float:
    """A finite number in SI units; a `si_unit` of None takes a unit of any dimension.

    :raises ExpressionError: not a finite number, an unknown name, or a unit that does not fit.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ExpressionError("must be a number", "Write for example 0.5, 30 deg, or l/2.")
    if isinstance(value, str):
        expression, unit = split_unit(value)
        number = evaluate(expression, names)
        if unit:
            number *= si_factor(unit) if si_unit is None else factor(unit, si_unit)
    else:
        number = float(value)
    if not math.isfinite(number):
        raise ExpressionError("must be finite")
    return number


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
        names = (info.context or {}).get("parameters", {})
        try:
            number = parse_value(value, names, self.unit or "radian")
        except ExpressionError as error:
            raise PydanticCustomError("quantity", "{why}", {"why": str(error), "remedy": error.remedy}) from error
        if self.above is not None and not number > self.above:
            raise _out_of_bounds(f"must be greater than {self.above:g}", number)
        if self.at_least is not None and not number >= self.at_least:
            raise _out_of_bounds(f"must be at least {self.at_least:g}", number)
        return number


def _out_of_bounds(why: str, number: float) -> PydanticCustomError:
    return PydanticCustomError("quantity", "{why}", {"why": f"{why}, and is {number:g}", "remedy": ""})


Number = Annotated[float, Quantity("")]
Angle = Annotated[float, Quantity("radian")]
AngularVelocity = Annotated[float, Quantity("radian/second")]
Length = Annotated[float, Quantity("meter")]
PositiveLength = Annotated[float, Quantity("meter", above=0)]
Velocity = Annotated[float, Quantity("meter/second")]
Acceleration = Annotated[float, Quantity("meter/second**2")]
PositiveMass = Annotated[float, Quantity("kilogram", above=0)]
Mass = Annotated[float, Quantity("kilogram", at_least=0)]
PositiveDensity = Annotated[float, Quantity("kilogram/meter**3", above=0)]
MomentOfInertia = Annotated[float, Quantity("kilogram*meter**2")]
PositiveTime = Annotated[float, Quantity("second", above=0)]
PositiveForce = Annotated[float, Quantity("newton", above=0)]
PositiveTorque = Annotated[float, Quantity("newton*meter", above=0)]
LinearStiffness = Annotated[float, Quantity("newton/meter", at_least=0)]
LinearDamping = Annotated[float, Quantity("newton*second/meter", at_least=0)]
TorsionStiffness = Annotated[float, Quantity("newton*meter/radian", at_least=0)]
TorsionDamping = Annotated[float, Quantity("newton*meter*second/radian", at_least=0)]
