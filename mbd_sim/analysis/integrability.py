"""Whether nonholonomic constraints can be integrated after all (Frobenius; Géradin & Rixen, sec. 1.3)."""

from __future__ import annotations

import casadi as ca
import numpy as np

from mbd_sim.dynamics.assembly import null_space
from mbd_sim.dynamics.equations import Equations
from mbd_sim.geometry.pose import Array

VANISHING = 1e-9  # of the derivatives themselves, what their skew part may be


def integrable_rows(equations: Equations) -> dict[int, bool]:
    """For each nonholonomic row, by its index, whether it comes from a function of position.

    The forms ω = a(x) dx of some rows, with x of the coordinates and the time, do so together exactly where each dω
    vanishes on all pairs of directions that these rows and the holonomic ones allow. So rows for which it does not
    are given up, which allows more directions, until none is (the derived flag). That is tested in the configurations
    around the start.
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
    seen = [[np.array(value) for value in look(moment, at)] for moment, at in equations.start.nearby]
    left, given_up = set(rows), set(rows)
    while given_up:
        kept = [index for index in range(len(equations.rows)) if index not in rows or index in left]
        given_up = {
            index
            for g, b, n, *curls in seen
            for index, curl in zip(rows, curls, strict=True)
            if index in left and not _closed(curl, _directions(g[kept], b[kept], n))
        }
        left -= given_up
    return {index: index in left for index in rows}


def _closed(curl: Array, allowed: Array) -> bool:
    skew = allowed.T @ (curl - curl.T) @ allowed
    size = _largest(curl) * max(_largest(allowed), 1.0) ** 2
    return _largest(skew) <= VANISHING * max(size, 1.0)


def _largest(values: Array) -> float:
    return float(np.max(np.abs(values), initial=0.0))


def _directions(gradient: Array, drift: Array, to_rates: Array) -> Array:
    """A basis (nq + 1, k) of the directions in coordinates and time that the constraints allow."""
    basis = null_space(np.hstack([gradient, drift.reshape(-1, 1)]))
    return np.vstack([to_rates @ basis[:-1], basis[-1:]])
