"""Whether nonholonomic constraints can be integrated after all (Frobenius; Géradin & Rixen, sec. 1.3)."""

from __future__ import annotations

import casadi as ca
import numpy as np

from mbd_sim.dynamics.assembly import null_space
from mbd_sim.dynamics.equations import Equations
from mbd_sim.mechanism.model import Array

VANISHING = 1e-9  # of the derivatives themselves, what their skew part may be


def integrable_rows(equations: Equations) -> dict[int, bool]:
    """For each nonholonomic row, by its index, whether its differential form is closed on what the rows allow.

    A form ω = a(x) dx, with x of the coordinates and the time, comes from a function of position exactly where dω
    vanishes on all pairs of directions that the constraints allow. That is tested in the configurations around the
    start.
    """
    rows = [index for index, row in enumerate(equations.rows) if row.position is None]
    if not rows:
        return {}
    nq, nv = equations.layout.nq, equations.layout.nv
    t, q, u = ca.SX.sym("t"), ca.SX.sym("q", nq), ca.SX.sym("u", nv)
    y = ca.vertcat(q, u, ca.SX.zeros(equations.start_state.size - nq - nv))
    velocity = equations.violation(t, y)[:, 1]
    q_rates = equations.rates.call([t, y, ca.SX.zeros(nv)])[0][:nq]
    to_rates = ca.jacobian(q_rates, u)
    gradient = ca.jacobian(velocity, u)
    drift = ca.substitute([velocity], [u], [ca.SX.zeros(nv)])[0]
    inverse = ca.solve(to_rates.T @ to_rates, to_rates.T)
    forms = ca.horzcat(gradient @ inverse, drift)
    x = ca.vertcat(q, t)
    turning = [ca.jacobian(forms[index, :].T, x) for index in rows]
    look = ca.Function("forms", [t, q], [gradient, drift, to_rates, *turning])
    closed = dict.fromkeys(rows, True)
    for moment, at in equations.start.nearby:
        g, b, n, *curls = (np.array(value) for value in look(moment, at))
        allowed = _directions(g, b, n)
        for index, curl in zip(rows, curls, strict=True):
            skew = allowed.T @ (curl - curl.T) @ allowed
            size = _largest(curl) * max(_largest(allowed), 1.0) ** 2
            closed[index] &= _largest(skew) <= VANISHING * max(size, 1.0)
    return closed


def _largest(values: Array) -> float:
    return float(np.max(np.abs(values), initial=0.0))


def _directions(gradient: Array, drift: Array, to_rates: Array) -> Array:
    """A basis (nq + 1, k) of the directions in coordinates and time that the constraints allow."""
    basis = null_space(np.hstack([gradient, drift.reshape(-1, 1)]))
    return np.vstack([to_rates @ basis[:-1], basis[-1:]])
