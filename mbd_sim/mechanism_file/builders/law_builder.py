"""From the laws of a file to the records that the dynamics reads."""

from __future__ import annotations

import math

from mbd_sim.mechanism.expression import TimeExpression
from mbd_sim.mechanism.laws import ElasticLaw, Expressed, Friction, PowerLaw, tabulated
from mbd_sim.mechanism_file.schema import law_schema as schema

REACH = 20.0  # m or rad, up to where the potential of an expression is exact
SLOW = 1e-2  # m/s or rad/s, the regularization of powers below 1, which are infinitely steep at rest
ALMOST_NOTHING = 1e-9  # m/s or rad/s, that of the others


def law_of(record: schema.ForceCurveSpec | schema.TorqueCurveSpec) -> ElasticLaw:
    """The law of a spring in a joint."""
    return curve(record.force, record.table, -REACH, REACH)


def curve(
    force: TimeExpression | None, table: list[tuple[float, float]] | None, lower: float, upper: float
) -> ElasticLaw:
    """The law of an expression, or of a table; `lower` and `upper` are where the former's potential is to be exact."""
    if force is not None:
        return Expressed(force, lower, upper)
    elongations, forces = zip(*(table or ()), strict=True)
    return tabulated(elongations, forces)


def damper_of(record: schema.LinearPowerSpec | schema.TorsionPowerSpec) -> PowerLaw:
    """The law of a damper."""
    slow = record.regularization or (SLOW if record.exponent < 1.0 else ALMOST_NOTHING)
    return PowerLaw(record.coefficient, record.exponent, slow)


def friction_of(record: schema.LinearFrictionSpec | schema.TorsionFrictionSpec) -> Friction:
    """The law of dry friction."""
    static = record.coulomb if record.static is None else record.static
    stribeck = math.inf if record.stribeck_velocity is None else record.stribeck_velocity
    return Friction(record.coulomb, static, stribeck, record.viscous, record.regularization)
