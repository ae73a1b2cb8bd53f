"""The numeric fields of a mechanism file: a `Length` accepts `0.5`, `12 in` or `l/2`, and its value is in m."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler, ValidationInfo
from pydantic_core import CoreSchema, core_schema

from mbd_sim.errors import InputError
from mbd_sim.mechanism_file.parameters import Parameters
from mbd_sim.mechanism_file.value_parser import parse_value, split_unit

# Beyond these, products such as density · r³ · r² would overflow or vanish. A smaller value that may be 0 becomes 0.
LARGEST, SMALLEST = 1e40, 1e-60


@dataclass(frozen=True)
class Quantity:
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
        try:
            return self._parsed(value, info.context or Parameters())
        except InputError as error:
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


Number = Annotated[float, Quantity("")]
AnyNumber = Annotated[float, Quantity(None)]  # with a unit of any dimension
Restitution = Annotated[float, Quantity("", at_least=0, at_most=1)]
Angle = Annotated[float, Quantity("rad")]
AngularVelocity = Annotated[float, Quantity("rad/s")]
PositiveAngularVelocity = Annotated[float, Quantity("rad/s", above=0)]
Length = Annotated[float, Quantity("m")]
PositiveLength = Annotated[float, Quantity("m", above=0)]
Lead = Annotated[float, Quantity("m/turn")]
PositiveLead = Annotated[float, Quantity("m/turn", above=0)]
Velocity = Annotated[float, Quantity("m/s")]
PositiveVelocity = Annotated[float, Quantity("m/s", above=0)]
Acceleration = Annotated[float, Quantity("m/s**2")]
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
