"""The fields of a mechanism file that hold an expression of variables, such as a force as a function of the time."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain
from typing import Any

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler, ValidationInfo
from pydantic_core import CoreSchema, core_schema

from mbd_sim.errors import InputError, nearest, quoted
from mbd_sim.mechanism.expression import TIME, TimeExpression, names_in
from mbd_sim.mechanism_file.parameters import Parameters
from mbd_sim.mechanism_file.value_parser import split_unit, unit_factor


@dataclass(frozen=True)
class ExpressionField:
    """Marks a field as an expression in the SI unit `unit`; the field holds a `TimeExpression` in SI units.

    With `unit` None, a unit of any dimension is accepted. `variables` are the names that vary while the mechanism
    moves: the time t in s if nothing else is given.
    """

    unit: str | None
    variables: tuple[str, ...] = (TIME,)

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.with_info_plain_validator_function(self._validate)

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        unit = f"in {self.unit}, " if self.unit else ""
        return {"type": ["number", "string"], "description": f"{unit}an expression of {self._variables_in_words()}"}

    def _variables_in_words(self) -> str:
        return "the time t in s" if self.variables == (TIME,) else ", ".join(self.variables)

    def _validate(self, value: Any, info: ValidationInfo) -> TimeExpression:
        try:
            return self._parsed(value, info.context or Parameters())
        except InputError as error:
            raise InputError(error.message, error.remedy, value) from error

    def _parsed(self, value: Any, parameters: Parameters) -> TimeExpression:
        values = parameters.values
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            example = "0.1*sin(5*t)" if self.variables == (TIME,) else f"0.1*{self.variables[0]}**2"
            message = f"must be an expression of {self._variables_in_words()}"
            raise InputError(message, f"Write for example {example}.")
        if isinstance(value, str) and parameters.unknown_in(value):
            return TimeExpression("0", {})  # the problem is reported at the parameter, not at each use of it
        expression, unit = split_unit(str(value))
        expression = parameters.functions.expanded(expression)
        used = names_in(expression, values)
        if hidden := [name for name in self.variables if name in values and (name in used or name == TIME)]:
            what = "time" if hidden[0] == TIME else f"variable '{hidden[0]}'"
            raise InputError(f"the parameter '{hidden[0]}' hides the {what}", "Rename the parameter.")
        if unknown := sorted(name for name in used if name not in values and name not in self.variables):
            raise InputError(f"unknown name {quoted(unknown[0])}", nearest(unknown[0], chain(values, self.variables)))
        if unit:
            expression = f"({expression})*{unit_factor(unit, self.unit)!r}"
        result = TimeExpression(expression, parameters.among(used))
        if self.variables == (TIME,):
            result.at(0.0)  # raises where it has no finite value at the start
        return result
