"""A value as written in a mechanism file, as a number in SI units: `0.5`, `12 in`, `l/2`, `-${l}/2`, `${l/2} mm`."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import cast

from mbd_sim.base.errors import InputError, quoted
from mbd_sim.base.geometry.batch import Batch, is_finite
from mbd_sim.files.text.units import factor, si_factor
from mbd_sim.mechanism.values.expression import MAX_LENGTH, evaluate
from mbd_sim.mechanism.values.names import QUOTED

_UNIT = r"([A-Za-zµμ°%][\w°%·*/^ ().-]*)"
_NUMBER_WITH_UNIT = re.compile(rf"([-+]?(?>(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?))\s*{_UNIT}", re.ASCII)
_TEMPLATE_WITH_UNIT = re.compile(rf"(.*\}})\s*{_UNIT}", re.ASCII)
_QUOTED_OR_NOT = re.compile(rf"({QUOTED})|([^'\"]+|.)", re.DOTALL)
_BRACED = re.compile(r"\$\{([^{}]*)\}")
_ARITHMETIC_WITH_UNIT = re.compile(rf"(.*[\w)])\s+{_UNIT}", re.ASCII)
# Text copied from books and web pages has these characters in place of ASCII.
_PLAIN = str.maketrans(
    {
        "\u00a0": " ",
        "\u2009": " ",
        "\u202f": " ",
        "−": "-",
        "×": "*",
        "·": "*",
        "²": "**2",
        "³": "**3",
        "≤": "<=",
        "≥": ">=",
    }
)


def split_unit(text: str) -> tuple[str, str]:
    """Split a value into its expression and its unit (`""` if there is none): `"30 deg"` gives `("30", "deg")`.

    :raises InputError: the text is too long to be a value.
    """
    if len(text) > MAX_LENGTH:
        raise InputError(f"is longer than {MAX_LENGTH} characters", "Split it into parameters.")
    text = _QUOTED_OR_NOT.sub(lambda found: found[1] or found[2].translate(_PLAIN), text).strip()
    form = _TEMPLATE_WITH_UNIT if "${" in text else _NUMBER_WITH_UNIT
    expression, unit = found.groups() if (found := form.fullmatch(text)) else (text, "")
    return _BRACED.sub(r"(\1)", expression), unit.strip()


def parse_value(
    value: object, names: Mapping[str, float], si_unit: str | None, functions: Callable[[str], str] = str
) -> float:
    """The finite number in SI units that a value stands for; with `si_unit` None, a unit of any dimension is accepted.

    :param names: the values of the parameters that an expression may refer to.
    :param functions: replaces the calls of the file's functions in an expression.
    :raises InputError: not a finite number, an unknown name, or a unit of the wrong dimension.
    """
    if value is None:
        raise InputError("has no value", "Give it a value.")
    if isinstance(value, bool) or not isinstance(value, int | float | str | Batch):
        raise InputError("must be a number", "Write for example 0.5, 30 deg, or l/2.")
    if isinstance(value, str):
        expression, unit = split_unit(value)
        number = _evaluated(functions(expression), names)
        if unit:
            number *= _factor(expression, unit, names, si_unit)
    else:
        number = cast(float, value) if isinstance(value, Batch) else float(value)
    if not is_finite(number):
        raise InputError("must be finite", "Write a number such as 0.5 or 1e6.")
    return number


def unit_factor(unit: str, si_unit: str | None) -> float:
    """The factor that converts a value in `unit` to SI units; with `si_unit` None, of any dimension.

    :raises InputError: the unit is unknown, or of another dimension than `si_unit`.
    """
    return si_factor(unit) if si_unit is None else factor(unit, si_unit)


def _evaluated(expression: str, names: Mapping[str, float]) -> float:
    try:
        return evaluate(expression, names)
    except InputError as error:
        form = _ARITHMETIC_WITH_UNIT.fullmatch(expression)
        if form is None:
            raise
        try:
            evaluate(form[1], names)
            si_factor(form[2])
        except InputError:
            raise error from None
        braced = quoted(f"${{{form[1]}}} {form[2]}")
        raise InputError(error.message, f"Put the arithmetic before a unit in braces: {braced}.") from error


def _factor(expression: str, unit: str, names: Mapping[str, float], si_unit: str | None) -> float:
    try:
        return unit_factor(unit, si_unit)
    except InputError as error:
        if unit in names:
            remedy = f"To multiply by the parameter, write {expression}*{unit}."
            raise InputError(error.message, remedy) from error
        raise


def is_number(text: str) -> bool:
    """Whether a value without its unit is a plain number, and no expression."""
    try:
        float(text)
    except ValueError:
        return False
    return True
