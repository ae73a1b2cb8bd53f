"""Laws of springs, dampers and friction as CasADi expressions of the elongation or the speed."""

from __future__ import annotations

import casadi as ca
import numpy as np

from mbd_sim.dynamics.piecewise import integral, panels_of, select
from mbd_sim.dynamics.spatial_algebra import vanishes
from mbd_sim.dynamics.time_functions import function_of
from mbd_sim.mechanism.laws import (
    ELONGATION,
    ElasticLaw,
    Expressed,
    Friction,
    Linear,
    Piecewise,
    PowerLaw,
)


def elastic(law: ElasticLaw, x: ca.SX) -> tuple[ca.SX, ca.SX]:
    """The force f(x) in N or N·m, against the elongation x where positive, and its potential ∫ f from 0 in J."""
    match law:
        case Linear(stiffness=k):
            return k * x, 0.5 * k * x**2
        case Piecewise():
            rows = np.column_stack([law.origins, law.coefficients, law.energies])
            origin, c0, c1, c2, c3, start = ca.vertsplit(select(x, law.knots, rows))
            d = x - origin
            energy = start + d * (c0 + d * (c1 / 2.0 + d * (c2 / 3.0 + d * c3 / 4.0)))
            return c0 + d * (c1 + d * (c2 + d * c3)), energy
        case Expressed(force=force, lower=lower, upper=upper):

            def f(place: ca.SX) -> ca.SX:
                return function_of(force, {ELONGATION: place})

            return f(x), integral(f, panels_of(f, lower, upper), x)


def power_law(law: PowerLaw, speed_squared: ca.SX) -> tuple[ca.SX, ca.SX]:
    """F / v, what a speed is to be multiplied with, and Rayleigh's dissipation function ∫ F dv in W."""
    coefficient, p, slow = law.coefficient, law.exponent, law.regularization
    if p == 1.0:
        return ca.SX(coefficient), 0.5 * coefficient * speed_squared
    square = speed_squared + slow**2
    loss = (square ** (0.5 * (p + 1.0)) - slow ** (p + 1.0)) / (p + 1.0)
    return coefficient * square ** (0.5 * (p - 1.0)), coefficient * loss


def friction(law: Friction, speed: ca.SX) -> ca.SX:
    """The force or torque of dry friction against the speed, in N or N·m, positive with it."""
    size = ca.SX(law.coulomb)
    if not vanishes(law.static - law.coulomb):
        size += (law.static - law.coulomb) * ca.exp(-((speed / law.stribeck_velocity) ** 2))
    return size * ca.tanh(speed / law.regularization) + law.viscous * speed
