"""Values with units, as in a mechanism file, converted to SI: `0.5`, `12 in`, `l/2`, `-${l}/2`, `${l/2} mm`.

An angle is a dimension of its own: `Hz` is no unit of rad/s, nor `rpm` one of a rate. Where the unit of a quantity has
an angle in its denominator, as N*m/rad or the m/turn of a screw, it may be left out: N*m, mm.
"""

from __future__ import annotations

import ast
import difflib
import functools
import math
import re
from collections.abc import Callable, Iterator, Mapping
from typing import cast

from mbd_sim.base.errors import InputError, may_suggest, quoted
from mbd_sim.base.geometry.batch import Batch, is_finite
from mbd_sim.mechanism.values.expression import MAX_LENGTH, evaluate
from mbd_sim.mechanism.values.names import QUOTED

_PREFIX_NAMES = {
    "giga G": 1e9,
    "mega M": 1e6,
    "kilo k": 1e3,
    "centi c": 1e-2,
    "deci d": 1e-1,
    "milli m": 1e-3,
    "micro μ u": 1e-6,
    "nano n": 1e-9,
}
# The names of each unit, and its definition: a factor of a product of units. Base units have no product.
_DEFINITIONS: dict[str, tuple[float, str]] = {
    "meter m metre": (1.0, ""),
    "second s sec": (1.0, ""),
    "gram g": (1.0, ""),
    "radian rad": (1.0, ""),
    "ampere A": (1.0, ""),
    "pi": (math.pi, "1"),
    "degree deg": (1.0 / 180.0, "pi*rad"),
    "turn rev revolution": (2, "pi*rad"),
    "percent": (0.01, "1"),
    "minute min": (60, "s"),
    "hour h": (3600, "s"),
    "hertz Hz": (1.0, "1/s"),
    "rpm": (1.0, "turn/minute"),
    "newton N": (1.0, "kg*m/s**2"),
    "joule J": (1.0, "N*m"),
    "watt W": (1.0, "J/s"),
    "volt V": (1.0, "W/A"),
    "ohm": (1.0, "V/A"),
    "henry H": (1.0, "V*s/A"),
    "pascal Pa": (1.0, "N/m**2"),
    "bar": (1e5, "Pa"),
    "liter L litre": (1e-3, "m**3"),
    "tonne t": (1000, "kg"),
    "inch in inches": (0.0254, "m"),
    "foot ft feet": (12, "inch"),
    "yard yd": (3, "ft"),
    "mile mi": (5280, "ft"),
    "pound lb": (0.45359237, "kg"),
    "ounce oz": (1.0 / 16.0, "lb"),
    "standard_gravity g_0 g0": (9.80665, "m/s**2"),
    "pound_force lbf": (1.0, "lb*g0"),
    "slug": (1.0, "lbf*s**2/ft"),
    "psi": (1.0, "lbf/inch**2"),
}
_SAME = {"N*m/A": "V*s/rad"}  # the constant of a motor's torque is that of its back-EMF, which is per angle
UNIT_WORDS = (
    "m, mm, in, ft, kg, g, lb, s, ms, rad, deg, rpm, N, lbf, Pa, bar, J, W, A, V, ohm, H and products such as N*m/rad"
)
LONGEST_UNIT = 60
MAX_EXPONENT = 9

_SPELLINGS = {
    r"°": "degree",
    r"%": "percent",
    r"·": "*",
    r"\^": "**",
    r"\bin\b": "inch",
    r"(?<=\w)\s+(?=\w)": "*",
}
_PREFIXES = {"": 1.0} | {name: scale for names, scale in _PREFIX_NAMES.items() for name in names.split()}
_UNITS = {name: (names.split()[0], *known) for names, known in _DEFINITIONS.items() for name in names.split()}
_NAMES = sorted(set(_UNITS) - {"pi"} | {"kg", "kilogram", "mm", "cm", "km", "ms", "kN"})

_Powers = dict[tuple[float, str], int]  # of units, by the factor of their prefix and their first name


@functools.lru_cache(maxsize=1024)
def factor(unit: str, si_unit: str) -> float:
    """The factor that converts a value in `unit` to `si_unit` (`""` for a plain number).

    :raises InputError: an unknown unit, or one of another dimension.
    """
    given = _unit(unit)
    wanted = _unit(_SAME.get(si_unit, si_unit) or "1")
    if _angles(wanted) < 0 and not _angles(given):
        wanted = {key: power for key, power in wanted.items() if not _angles({key: 1})}
    if _dimension(given) != _dimension(wanted):
        raise _misfit(unit, si_unit, given, wanted)
    return _finite(unit, _times(given, wanted, -1))


@functools.lru_cache(maxsize=1024)
def si_factor(unit: str) -> float:
    """The factor that converts a value in `unit` to kg, m, s and rad.

    :raises InputError: an unknown unit.
    """
    given = _unit(unit)
    return _finite(unit, given) * 1e-3 ** _dimension(given).get("gram", 0)


def _finite(text: str, unit: _Powers) -> float:
    """The factor to base units. Its bits, and those of the values in recordings, depend on the order of the product."""
    powers: dict[float, int] = {}
    for scale, _, power in _expanded(unit):
        powers[scale] = powers.get(scale, 0) + power
    try:
        return math.prod(scale**power for scale, power in sorted(powers.items(), key=lambda item: item[1] < 0))
    except ArithmeticError as error:
        raise InputError(
            f"the unit {quoted(text)} is too large or too small to compute with", "Write the value in another unit."
        ) from error


def _dimension(unit: _Powers) -> dict[str, int]:
    """The powers of the base units."""
    found: dict[str, int] = {}
    for _, name, power in _expanded(unit):
        found[name] = found.get(name, 0) + power
    return {name: power for name, power in found.items() if name and power}


def _angles(unit: _Powers) -> int:
    return _dimension(unit).get("radian", 0)


def _expanded(unit: _Powers, times: int = 1) -> Iterator[tuple[float, str, int]]:
    """The factors and the base units in the definition of a unit, and their powers."""
    for (prefix, name), power in unit.items():
        _, scale, product = _UNITS[name]
        yield prefix, "" if product else name, power * times
        if product:
            yield scale, "", power * times
            yield from _expanded(_unit(product), power * times)


def _misfit(unit: str, si_unit: str, given: _Powers, wanted: _Powers) -> InputError:
    """The error for a unit of another dimension than that of `si_unit`."""
    here = f"a value in {si_unit}" if si_unit else "a plain number"
    message, example = f"the unit {quoted(unit)} does not fit: {here} is expected here", f"0.5 {si_unit}".strip()
    excess = _angles(given) - _angles(wanted)
    without = _times(given, _unit("turn"), -excess)
    if not excess or _dimension(without) != _dimension(wanted):
        return InputError(message, f"Write for example {example}.")
    if excess < 0 < _angles(wanted):
        remedy = f"It has no angle. Write for example {example}, or {example.replace('rad', 'rev')} for turns."
    elif excess > 0 and not _angles(wanted):
        in_turns = f"{_finite(unit, _times(without, wanted, -1)):.6g} {si_unit}".strip()
        remedy = f"It has an angle. Write for example {example}; in turns, 1 {unit} is {in_turns}."
    else:
        remedy = f"It has an angle that does not belong there. Write for example {example}."
    return InputError(message, remedy)


def _times(unit: _Powers, other: _Powers, power: int = 1) -> _Powers:
    """The product of a unit and a power of another one."""
    powers = dict(unit)
    for key, own in other.items():
        powers[key] = powers.get(key, 0) + own * power
    return {key: power for key, power in powers.items() if power}


@functools.lru_cache(maxsize=1024)
def _unit(text: str) -> _Powers:
    """A product of named units, never changed."""
    unknown = InputError(f"unknown unit {quoted(text)}", f"Known: {UNIT_WORDS}.")
    if len(text) > LONGEST_UNIT:
        raise unknown
    spelled = text
    for pattern, replacement in _SPELLINGS.items():
        spelled = re.sub(pattern, replacement, spelled)
    try:
        return _product(ast.parse(spelled.strip(), mode="eval").body)
    except InputError:
        raise
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise unknown from error


def _product(node: ast.expr) -> _Powers:
    match node:
        case ast.Name(id=name):
            return _named(name)
        case ast.Constant(value=1):
            return {}
        case ast.BinOp(left=left, op=ast.Mult(), right=right):
            return _times(_product(left), _product(right))
        case ast.BinOp(left=left, op=ast.Div(), right=right):
            return _times(_product(left), _product(right), -1)
        case ast.BinOp(left=left, op=ast.Pow(), right=right):
            return _times({}, _product(left), _exponent(right))
    raise ValueError("not a product of units")


def _exponent(node: ast.expr) -> int:
    sign, number = (-1, node.operand) if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) else (1, node)
    match number:
        case ast.Constant(value=int() as value) if value <= MAX_EXPONENT:
            return sign * value
    raise InputError(f"the power of a unit must be a whole number up to {MAX_EXPONENT}", "Write for example m**2.")


def _named(name: str) -> _Powers:
    for suffix in ("", "s"):
        for prefix, scale in _PREFIXES.items():
            inner = name.removeprefix(prefix).removesuffix(suffix)
            if f"{prefix}{inner}{suffix}" == name and inner in _UNITS and len(inner) > len(suffix):
                return {(scale, _UNITS[inner][0]): 1}
    message, known = f"unknown unit {quoted(name)}", f"Known: {UNIT_WORDS}."
    if not may_suggest():
        raise InputError(message, known)
    same = [other for other in _NAMES if other.casefold() == name.casefold()]
    same += [name[:-1]] if name.endswith("s") and name[:-1] in _NAMES else []
    halves = [(name[:cut], name[cut:]) for cut in range(1, len(name))]
    products = [f"{first}*{second}" for first, second in halves if _can_multiply(first, second)]
    close = same or products or difflib.get_close_matches(name, _NAMES, n=1, cutoff=0.6)
    raise InputError(message, (f"Did you mean '{close[0]}'? " if close else "") + known)


def _can_multiply(first: str, second: str) -> bool:
    """Whether two words are units of different dimensions: a product of two masses is hardly intended."""
    known = first in _NAMES and second in _NAMES
    return known and _dimension(_named(first)) != _dimension(_named(second))


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
