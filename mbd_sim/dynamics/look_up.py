"""Tables of expressions as CasADi expressions."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from mbd_sim.dynamics.piecewise import select
from mbd_sim.mechanism.tables import Curve, Surface, Table, hermite


def looked_up(table: Table, *at: Any) -> ca.SX:
    """The value of a table: see `Curve` and `Surface`."""
    places = [ca.SX(value) for value in at]
    return _on_curve(table, *places) if isinstance(table, Curve) else _on_surface(table, *places)


def _on_curve(curve: Curve, x: ca.SX) -> ca.SX:
    if curve.period is not None:
        x = x - curve.period * ca.floor((x - curve.x[0]) / curve.period)
    pieces = curve.pieces
    rows = np.column_stack([pieces.origins, pieces.coefficients])
    origin, c0, c1, c2, c3 = ca.vertsplit(select(x, pieces.knots, rows))
    d = x - origin
    return c0 + d * (c1 + d * (c2 + d * c3))


def _on_surface(surface: Surface, x: ca.SX, y: ca.SX) -> ca.SX:
    columns = ca.SX(ca.DM(surface.nodes)) @ _weights(surface.y, y)
    return ca.dot(_weights(surface.x, x), columns)


def _weights(knots: Sequence[float], x: ca.SX) -> ca.SX:
    """The weights (2 n,) of the value and the slope at each knot; beyond all knots, those of a straight line."""
    last = len(knots) - 1
    reached = [ca.SX(1), *(x >= knot for knot in knots), ca.SX(0)]
    inside = [here - next_ for here, next_ in pairwise(reached)]  # below all knots, in each interval, above all knots
    rows = [(knots[0], 1.0), *((one, other - one) for one, other in pairwise(knots)), (knots[last], 1.0)]
    origin, width = ca.vertsplit(select(x, np.array(knots), np.array(rows)))
    d = x - origin
    straight, cubic = (ca.SX(1), d), hermite(d, width)
    found = []
    for index in range(last + 1):
        for order in range(2):
            terms = [ca.if_else(inside[index + 1], cubic[order], 0.0)] if index < last else []
            terms += [ca.if_else(inside[index], cubic[2 + order], 0.0)] if index > 0 else []
            terms += [ca.if_else(inside[0], straight[order], 0.0)] if index == 0 else []
            terms += [ca.if_else(inside[last + 1], straight[order], 0.0)] if index == last else []
            found.append(sum(terms[1:], terms[0]))
    return ca.vertcat(*found)
