"""Values whose dimension depends on other keys: they keep their unit, and are checked once that is known.

The `effort_limit` of an actuator is in N on a slider and in N·m on a hinge.
"""

from __future__ import annotations

from typing import Annotated, Any, cast

from mbd_sim.errors import InputError
from mbd_sim.geometry.batch import Batch
from mbd_sim.mechanism_file.parameters import Parameters
from mbd_sim.mechanism_file.quantity import Quantity
from mbd_sim.mechanism_file.value_parser import split_unit, unit_factor


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


class MeasuredQuantity(Quantity):
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


AnyAmount = Annotated[float, MeasuredQuantity(None)]
PositiveAmount = Annotated[float, MeasuredQuantity(None, above=0)]
AmountFromZero = Annotated[float, MeasuredQuantity(None, at_least=0)]
