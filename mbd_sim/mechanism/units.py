"""Values with units, converted to SI by pint."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING

from mbd_sim.mechanism.expression import ExpressionError

if TYPE_CHECKING:
    import pint

# The units of mechanics only: building pint's full registry costs 0.13 s at every start, this one 2 ms.
_DEFINITIONS = """
giga- = 1e9 = G-
mega- = 1e6 = M-
kilo- = 1e3 = k-
centi- = 1e-2 = c-
deci- = 1e-1 = d-
milli- = 1e-3 = m-
micro- = 1e-6 = µ- = μ- = u-
meter = [length] = m = metre
second = [time] = s = sec
gram = [mass] = g
radian = [] = rad
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
pascal = newton / meter ** 2 = Pa
liter = 1e-3 * meter ** 3 = L = litre
tonne = 1000 * kilogram = t
inch = 0.0254 * meter = in
foot = 12 * inch = ft
yard = 3 * foot = yd
mile = 5280 * foot = mi
pound = 0.45359237 * kilogram = lb
ounce = pound / 16 = oz
standard_gravity = 9.80665 * meter / second ** 2 = g_0 = g0
pound_force = pound * standard_gravity = lbf
slug = pound_force * second ** 2 / foot
"""

UNIT_WORDS = "m, mm, in, ft, kg, g, lb, slug, s, ms, rad, deg, rpm, N, lbf, J, W and products such as N*m/rad"


@functools.cache
def _registry() -> pint.UnitRegistry:
    import pint

    registry = pint.UnitRegistry(None)
    registry.load_definitions(_DEFINITIONS.strip().splitlines())
    return registry


@functools.cache
def factor(unit: str, si_unit: str) -> float:
    """What a value in `unit` is multiplied by to be in `si_unit`.

    :raises ExpressionError: an unknown unit, or one of another dimension.
    """
    import pint

    registry = _registry()
    try:
        given = registry.parse_units(unit.replace("·", "*"))
    except (pint.errors.PintError, ValueError, TypeError, AttributeError, KeyError) as error:
        raise ExpressionError(f"unknown unit '{unit}'", f"Known: {UNIT_WORDS}.") from error
    wanted = registry.parse_units(si_unit)
    if given.dimensionality != wanted.dimensionality:
        raise ExpressionError(f"'{unit}' is not a unit of the quantity that stands here", f"Give it in {si_unit}.")
    return float(registry.Quantity(1.0, given).to(wanted).magnitude)


@functools.cache
def si_factor(unit: str) -> float:
    """What a value in `unit` is multiplied by to be in kg, m, s, rad.

    :raises ExpressionError: an unknown unit.
    """
    import pint

    try:
        quantity = _registry().Quantity(1.0, unit.replace("·", "*")).to_base_units()
    except (pint.errors.PintError, ValueError, TypeError, AttributeError, KeyError) as error:
        raise ExpressionError(f"unknown unit '{unit}'", f"Known: {UNIT_WORDS}.") from error
    grams = quantity.dimensionality.get("[mass]", 0)  # pint's base unit of mass is the gram
    return float(quantity.magnitude) * 1e-3 ** float(grams)
