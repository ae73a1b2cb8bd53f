"""The fields of a mechanism file that hold an expression of variables, such as a force as a function of the time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import chain
from typing import Annotated, Any

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler, ValidationInfo
from pydantic_core import CoreSchema, core_schema

from mbd_sim.errors import InputError, nearest, quoted
from mbd_sim.mechanism.expression import TIME, StateName, TimeExpression, names_in, require_valid, tables_in
from mbd_sim.mechanism_file.parameters import Parameters
from mbd_sim.mechanism_file.value_parser import split_unit, unit_factor


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
            return TimeExpression("0", {})  # the problem is reported at the parameter, not at each use of it
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
            return TimeExpression("0", {})
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
