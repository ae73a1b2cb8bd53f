"""Laws of springs, dampers and friction as CasADi expressions of the elongation or the speed."""

from __future__ import annotations

import math
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any, assert_never

import casadi as ca
import numpy as np

from mbd_sim.dynamics.math.expressions import function_of
from mbd_sim.dynamics.math.piecewise import DECADES, select
from mbd_sim.dynamics.math.spatial import is_absent
from mbd_sim.mechanism.values.expression import TimeExpression
from mbd_sim.mechanism.values.laws import (
    ELONGATION,
    ElasticLaw,
    Expressed,
    Friction,
    GreenStrain,
    Linear,
    PowerLaw,
    Varying,
)
from mbd_sim.mechanism.values.tables import Piecewise

if TYPE_CHECKING:
    from mbd_sim.dynamics.math.distant_potentials import DistantPotential
    from mbd_sim.dynamics.math.piecewise import PotentialTable


def elastic(law: ElasticLaw, x: ca.SX) -> tuple[ca.SX, ca.SX]:
    """The force f(x) in N or N·m and its potential ∫ f from 0 to x in J, which `distant_potential` completes.

    :param x: elongation in m or rad. A positive force pulls it back.
    """
    match law:
        case Linear(stiffness=k):
            return k * x, 0.5 * k * x**2
        case Piecewise():
            rows = np.column_stack([law.origins, law.coefficients, law.energies])
            origin, c0, c1, c2, c3, start = ca.vertsplit(select(x, law.knots, rows))
            d = x - origin
            energy = start + d * (c0 + d * (c1 / 2.0 + d * (c2 / 3.0 + d * c3 / 4.0)))
            return c0 + d * (c1 + d * (c2 + d * c3)), energy
        case Expressed():
            from mbd_sim.dynamics.math.piecewise import potential

            force = partial(_force, law.force)
            return force(x), potential(force, _table(law), x)
        case _:
            assert_never(law)


def distant_potential(law: ElasticLaw | GreenStrain | Varying) -> DistantPotential | None:
    """What the potential of `elastic` lacks far from 0; None if it lacks nothing up to 1e5 times the law's range."""
    if not isinstance(law, Expressed):
        return None
    from mbd_sim.dynamics.math.distant_potentials import DistantPotential

    table = _table(law)
    (lower, upper), far = table.ends, 10.0**DECADES
    if lower <= far * law.lower and upper >= far * law.upper:
        return None
    return DistantPotential(partial(_force, law.force), table)


def _force(expression: TimeExpression, elongation: ca.SX) -> ca.SX:
    return function_of(expression, {ELONGATION: elongation})


def _table(law: Expressed) -> PotentialTable:
    force = law.force
    return _cached_table(force.text, tuple(force.names.items()), tuple(force.tables.items()), law.lower, law.upper)


@lru_cache(maxsize=64)
def _cached_table(
    text: str, names: tuple[tuple[str, float], ...], tables: tuple[tuple[str, Any], ...], lower: float, upper: float
) -> PotentialTable:
    from mbd_sim.dynamics.math.piecewise import table_of

    return table_of(partial(_force, TimeExpression(text, dict(names), dict(tables))), lower, upper)


def power_law(law: PowerLaw, speed_squared: ca.SX) -> tuple[ca.SX, ca.SX]:
    """F / v, the factor of the speed or velocity, and Rayleigh's dissipation function ∫ F dv in W."""
    coefficient, p, slow = law.coefficient, law.exponent, law.regularization
    if p == 1.0:
        return ca.SX(coefficient), 0.5 * coefficient * speed_squared
    square = speed_squared + slow**2
    dissipation = (square ** (0.5 * (p + 1.0)) - slow ** (p + 1.0)) / (p + 1.0)
    return coefficient * square ** (0.5 * (p - 1.0)), coefficient * dissipation


def friction(law: Friction, speed: ca.SX) -> ca.SX:
    """The force or torque of dry friction in N or N·m. It opposes the speed and has the speed's sign here."""
    return dry_friction(law, speed) * ca.tanh(speed / law.regularization) + law.viscous * speed


def dry_friction(law: Friction, speed: ca.SX) -> ca.SX:
    """The size of dry friction in motion, in N or N·m, without its viscous part."""
    size = ca.SX(law.coulomb)
    if law.sticks and law.stribeck_velocity == math.inf:
        return size
    if not is_absent(law.static - law.coulomb):
        size += (law.static - law.coulomb) * ca.exp(-((speed / law.stribeck_velocity) ** 2))
    return size
