"""Builds the laws of springs, dampers and friction from their records in the file."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from mbd_sim.mechanism.expression import TimeExpression
from mbd_sim.mechanism.laws import ELONGATION, ElasticLaw, Expressed, Friction, PowerLaw, Varying, tabulated

if TYPE_CHECKING:
    from mbd_sim.mechanism_file.schema import law_schema as schema

LARGEST_ELONGATION = 20.0  # m or rad, up to which the potential of an expression is exact
REGULARIZATION_BELOW_ONE = 1e-2  # m/s or rad/s, of powers below 1, whose slope at rest is infinite
REGULARIZATION = 1e-30  # m/s or rad/s, of all other powers: none but for the derivatives at rest


def build_elastic_law(spec: schema.ForceCurveSpec | schema.TorqueCurveSpec) -> ElasticLaw | Varying:
    """The law of a spring in a joint."""
    return build_curve(spec.force, spec.table, -LARGEST_ELONGATION, LARGEST_ELONGATION)


def build_curve(
    force: TimeExpression | None, table: list[tuple[float, float]] | None, lower: float, upper: float
) -> ElasticLaw | Varying:
    """The law of an expression, or else of a table; the expression's potential is exact from `lower` to `upper`."""
    if force is not None and force.variables - {ELONGATION}:
        return Varying(force)
    if force is not None:
        return Expressed(force, lower, upper)
    elongations, forces = zip(*(table or ()), strict=True)
    return tabulated(elongations, forces)


def build_power_law(spec: schema.LinearPowerSpec | schema.TorsionPowerSpec) -> PowerLaw:
    """The law of a damper."""
    default = REGULARIZATION_BELOW_ONE if spec.exponent < 1.0 else REGULARIZATION
    return PowerLaw(spec.coefficient, spec.exponent, spec.regularization or default)


def build_friction(spec: schema.LinearFrictionSpec | schema.TorsionFrictionSpec) -> Friction:
    """The law of dry friction."""
    if spec.coefficient is not None:
        lever = getattr(spec, "radius", None) or 1.0
        static = spec.coefficient if spec.static_coefficient is None else spec.static_coefficient
        coefficients = lever * spec.coefficient, lever * static
        return Friction(0.0, 0.0, math.inf, spec.viscous, spec.regularization, True, *coefficients)
    assert spec.coulomb is not None
    static = spec.coulomb if spec.static is None else spec.static
    stribeck = math.inf if spec.stribeck_velocity is None else spec.stribeck_velocity
    return Friction(spec.coulomb, static, stribeck, spec.viscous, spec.regularization, spec.sticking)
