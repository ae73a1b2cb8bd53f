"""The laws of springs, dampers and friction in numbers, for Kane's equations: written independently of the engine."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PchipInterpolator

from mbd_sim.mechanism.values.expression import evaluate
from mbd_sim.mechanism.values.laws import Expressed
from mbd_sim.mechanism.values.tables import Piecewise


def elastic(law, x):
    """The force of a law against an elongation, and the energy that it stores. Tables are interpolated by SciPy."""
    if isinstance(law, Expressed):

        def f(place):
            return evaluate(law.force.text, {**law.force.names, "x": place})

        nodes, weights = np.polynomial.legendre.leggauss(60)
        return f(x), 0.5 * x * sum(w * f(0.5 * x * (1.0 + node)) for node, w in zip(nodes, weights, strict=True))
    if isinstance(law, Piecewise):
        values = [law.coefficients[1][0], *(row[0] for row in law.coefficients[2:])]
        table = PchipInterpolator(law.knots, values)
        slope, energy = table.derivative(), table.antiderivative()

        def straight_beyond(place):
            inside = min(max(place, law.knots[0]), law.knots[-1])
            d = place - inside
            stored = energy(inside) + table(inside) * d + 0.5 * slope(inside) * d**2
            return float(table(inside) + slope(inside) * d), float(stored)

        return straight_beyond(x)[0], straight_beyond(x)[1] - straight_beyond(0.0)[1]
    return law.stiffness * x, 0.5 * law.stiffness * x**2


def power_law(law, v):
    """The force along a velocity of any dimension of a damper C |v|^p, regularized at rest."""
    smooth = np.sqrt(np.dot(v, v) + (law.regularization**2 if law.exponent != 1.0 else 0.0))
    return law.coefficient * smooth ** (law.exponent - 1.0) * v


def dry_friction(law, v):
    """The friction that opposes a speed (Stribeck)."""
    more = (law.static - law.coulomb) * np.exp(-((v / law.stribeck_velocity) ** 2))
    return (law.coulomb + more) * np.tanh(v / law.regularization) + law.viscous * v
