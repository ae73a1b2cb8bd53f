"""Values with units, converted to SI by pint.

An angle is a dimension of its own: `Hz` is no unit of rad/s, nor `rpm` one of a rate. Where the unit of a quantity has
an angle in its denominator, as N*m/rad or the m/turn of a screw, it may be left out: N*m, mm.
"""

from __future__ import annotations

import ast
import difflib
import functools
import math
import re
from collections.abc import Callable
from typing import Any

from mbd_sim.errors import InputError, may_suggest, quoted

# Only the units of mechanics: building this registry takes 2 ms, pint's full one 0.13 s at every start.
_DEFINITIONS = """
giga- = 1e9 = G-
mega- = 1e6 = M-
kilo- = 1e3 = k-
centi- = 1e-2 = c-
deci- = 1e-1 = d-
milli- = 1e-3 = m-
micro- = 1e-6 = µ- = μ- = u-
nano- = 1e-9 = n-
meter = [length] = m = metre
second = [time] = s = sec
gram = [mass] = g
radian = [angle] = rad
pi = 3.141592653589793
degree = pi / 180 * radian = deg = °
turn = 2 * pi * radian = rev = revolution
percent = 0.01 = %
minute = 60 * second = min
hour = 3600 * second = h
hertz = 1 / second = Hz
rpm = turn / minute
newton = kilogram * meter / second ** 2 = N
joule = newton * meter = J
watt = joule / second = W
ampere = [current] = A
volt = watt / ampere = V
ohm = volt / ampere
henry = volt * second / ampere = H
pascal = newton / meter ** 2 = Pa
bar = 1e5 * pascal
liter = 1e-3 * meter ** 3 = L = litre
tonne = 1000 * kilogram = t
inch = 0.0254 * meter = in = inches
foot = 12 * inch = ft = feet
yard = 3 * foot = yd
mile = 5280 * foot = mi
pound = 0.45359237 * kilogram = lb
ounce = pound / 16 = oz
standard_gravity = 9.80665 * meter / second ** 2 = g_0 = g0
pound_force = pound * standard_gravity = lbf
slug = pound_force * second ** 2 / foot
psi = pound_force / inch ** 2
"""

# The units of most files: the SI unit of each, and the factor that pint computes, to the bit. Importing pint takes
# longer than reading such a file.
USUAL = {
    **{unit: (unit, 1.0) for unit in ("m", "kg", "s", "rad", "N", "N*m", "m/s", "rad/s", "N/m", "N*s/m")},
    **{unit: (unit, 1.0) for unit in ("N*m/rad", "N*m*s/rad", "kg*m**2", "kg/m**3", "m/s**2", "rad/s**2")},
    **{unit: (unit, 1.0) for unit in ("N*m*s", "N/m**3", "N*m/A", "V/rad", "V*s/rad")},
    **{unit: (unit, 1.0) for unit in ("Hz", "Pa", "J", "W", "A", "V", "ohm", "H")},
    "mm": ("m", 1e-3),
    "cm": ("m", 1e-2),
    "g": ("kg", 1e-3),
    "ms": ("s", 1e-3),
    "deg": ("rad", math.pi / 180.0),
    "deg/s": ("rad/s", math.pi / 180.0),
    "rpm": ("rad/s", math.pi / 30.0),
    "kHz": ("Hz", 1e3),
    "kN": ("N", 1e3),
    "mN*m": ("N*m", 1e-3),
    "kPa": ("Pa", 1e3),
    "MPa": ("Pa", 1e6),
    "bar": ("Pa", 1e5),
    "mm**2": ("m**2", 1e-6),
    "cm**2": ("m**2", 1e-4),
    "cm**3": ("m**3", 1.0000000000000002e-06),
    "L": ("m**3", 1e-3),
    "L/min": ("m**3/s", 1e-3 / 60.0),
    "mH": ("H", 1e-3),
    "g0": ("m/s**2", 9.80665),
}
_SAME = {"N*m/A": "V*s/rad"}  # the constant of a motor's torque is that of its back-EMF, which is per angle
UNIT_WORDS = (
    "m, mm, in, ft, kg, g, lb, s, ms, rad, deg, rpm, N, lbf, Pa, bar, J, W, A, V, ohm, H and products such as N*m/rad"
)
MAX_LENGTH = 60
MAX_EXPONENT = 9

_SPELLINGS = {
    r"°": "degree",
    r"%": "percent",
    r"·": "*",
    r"\^": "**",
    r"\bin\b": "inch",
    r"(?<=\w)\s+(?=\w)": "*",
}
_NAMES = sorted(
    set(re.findall(r"\b[A-Za-z]\w*(?=\s*=|\s*$)", _DEFINITIONS, re.MULTILINE)) - {"pi"}
    | {"kg", "mm", "cm", "km", "ms", "kN"}
)


@functools.cache
def _registry() -> Any:
    import pint

    registry: Any = pint.UnitRegistry(None)
    registry.load_definitions(_DEFINITIONS.strip().splitlines())
    return registry


@functools.lru_cache(maxsize=1024)
def factor(unit: str, si_unit: str) -> float:
    """The factor that converts a value in `unit` to `si_unit` (`""` for a plain number).

    :raises InputError: an unknown unit, or one of another dimension.
    """
    usual_unit, usual = USUAL.get(_power(unit), (None, 0.0))
    if usual_unit in (si_unit, si_unit.removesuffix("/rad"), si_unit.removesuffix("/turn")):
        return usual
    given = _unit(unit)
    wanted = _unit(_SAME.get(si_unit, si_unit)) if si_unit else _registry().parse_units("")
    if _angles(wanted) < 0 and not _angles(given):
        wanted = _without_angles(wanted)
    if given.dimensionality != wanted.dimensionality:
        raise _misfit(unit, si_unit, given, wanted)
    return _finite(lambda: float(_registry().Quantity(1.0, given).to(wanted).magnitude), unit)


def _angles(unit: Any) -> float:
    """The power of the angle in a unit."""
    return float(unit.dimensionality.get("[angle]", 0))


def _without_angles(unit: Any) -> Any:
    registry = _registry()
    named = {name: power for name, power in unit._units.items() if not _angles(registry.Unit(name))}
    return math.prod((registry.Unit(name) ** power for name, power in named.items()), start=registry.parse_units(""))


def _misfit(unit: str, si_unit: str, given: Any, wanted: Any) -> InputError:
    """The error for a unit of another dimension than that of `si_unit`."""
    here = f"a value in {si_unit}" if si_unit else "a plain number"
    message, example = f"the unit {quoted(unit)} does not fit: {here} is expected here", f"0.5 {si_unit}".strip()
    excess, turn = _angles(given) - _angles(wanted), _registry().parse_units("turn")
    if not excess or (given / turn ** int(excess)).dimensionality != wanted.dimensionality:
        return InputError(message, f"Write for example {example}.")
    if excess < 0 < _angles(wanted):
        remedy = f"It has no angle. Write for example {example}, or {example.replace('rad', 'rev')} for turns."
    elif excess > 0 and not _angles(wanted):
        counted = _registry().Quantity(1.0, given / turn ** int(excess)).to(wanted).magnitude
        in_turns = f"{counted:.6g} {si_unit}".strip()
        remedy = f"It has an angle. Write for example {example}; in turns, 1 {unit} is {in_turns}."
    else:
        remedy = f"It has an angle that does not belong there. Write for example {example}."
    return InputError(message, remedy)


@functools.lru_cache(maxsize=1024)
def si_factor(unit: str) -> float:
    """The factor that converts a value in `unit` to kg, m, s and rad.

    :raises InputError: an unknown unit.
    """
    if (usual := USUAL.get(_power(unit))) is not None:
        return usual[1]
    given = _unit(unit)
    grams = given.dimensionality.get("[mass]", 0)  # pint's base unit of mass is the gram
    base = _registry().Quantity
    return _finite(lambda: float(base(1.0, given).to_base_units().magnitude) * 1e-3 ** float(grams), unit)


def _power(unit: str) -> str:
    return unit.replace("^", "**")


def _finite(value: Callable[[], float], unit: str) -> float:
    try:
        return value()
    except ArithmeticError as error:
        raise InputError(
            f"the unit {quoted(unit)} is too large or too small to compute with", "Write the value in another unit."
        ) from error


def _unit(text: str) -> Any:
    """The pint unit of a product of named units. Pint gets names only: its own parser accepts far more."""
    unknown = InputError(f"unknown unit {quoted(text)}", f"Known: {UNIT_WORDS}.")
    if len(text) > MAX_LENGTH:
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


def _product(node: ast.expr) -> Any:
    match node:
        case ast.Name(id=name):
            return _named(name)
        case ast.Constant(value=1):
            return _registry().parse_units("")
        case ast.BinOp(left=left, op=ast.Mult(), right=right):
            return _product(left) * _product(right)
        case ast.BinOp(left=left, op=ast.Div(), right=right):
            return _product(left) / _product(right)
        case ast.BinOp(left=left, op=ast.Pow(), right=right):
            return _product(left) ** _exponent(right)
    raise ValueError("not a product of units")


def _exponent(node: ast.expr) -> int:
    sign, number = (-1, node.operand) if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) else (1, node)
    match number:
        case ast.Constant(value=int() as value) if value <= MAX_EXPONENT:
            return sign * value
    raise InputError(f"the power of a unit must be a whole number up to {MAX_EXPONENT}", "Write for example m**2.")


def _named(name: str) -> Any:
    import pint

    if not (_registry().parse_unit_name(name) or may_suggest()):  # saves what parse_units costs
        raise InputError(f"unknown unit {quoted(name)}", f"Known: {UNIT_WORDS}.")
    try:
        return _registry().parse_units(name)
    except (pint.errors.PintError, ValueError, TypeError, AttributeError, KeyError, AssertionError) as error:
        same = [other for other in _NAMES if other.casefold() == name.casefold()]
        same += [name[:-1]] if name.endswith("s") and name[:-1] in _NAMES else []
        halves = [(name[:cut], name[cut:]) for cut in range(1, len(name))]
        products = [f"{first}*{second}" for first, second in halves if _can_multiply(first, second)]
        close = same or products or difflib.get_close_matches(name, _NAMES, n=1, cutoff=0.6)
        remedy = (f"Did you mean '{close[0]}'? " if close else "") + f"Known: {UNIT_WORDS}."
        raise InputError(f"unknown unit {quoted(name)}", remedy) from error


def _can_multiply(first: str, second: str) -> bool:
    """Whether two words are units of different dimensions: a product of two masses is hardly intended."""
    if first not in _NAMES or second not in _NAMES:
        return False
    one, other = (_registry().parse_units(name) for name in (first, second))
    return bool(one.dimensionality != other.dimensionality)
