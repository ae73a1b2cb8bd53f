"""Whether velocity constraints are integrable, by the theorem of Frobenius (Géradin & Rixen, sec. 1.3)."""

from __future__ import annotations

import casadi as ca
import numpy as np

from mbd_sim.dynamics.constraint_functions import scaled
from mbd_sim.dynamics.constraint_rank import null_space
from mbd_sim.dynamics.equations import Equations
from mbd_sim.geometry.pose import Array

VANISHING = 1e-9  # the skew-symmetric part that counts as zero, relative to the derivatives


def integrable_rows(equations: Equations) -> dict[int, bool]:
    """For each velocity constraint, by the index of its row, whether it is the derivative of a position constraint.

    A row is a form ω = a(x) dx, where x is the coordinates and the time. A set of rows is integrable if and only if
    each dω vanishes on all pairs of directions that these rows and the holonomic ones allow. Rows for which it does
    not vanish are removed from the set, which allows more directions, until no row has to be removed (the derived
    flag). The test is made in configurations around the start.
    """
    rows = [index for index, row in enumerate(equations.rows) if row.position is None]
    if not rows:
        return {}
    nq, nv = equations.layout.nq, equations.layout.nv
    t, q, u = ca.SX.sym("t"), ca.SX.sym("q", nq), ca.SX.sym("u", nv)
    y = ca.vertcat(q, u, ca.SX.zeros(equations.start_state.size - nq - nv))
    velocity = equations.violation(t, y)[:, 1]
    q_rates = equations.rates.call([t, y, ca.SX.zeros(equations.inputs.size)])[0][:nq]
    to_rates = ca.jacobian(q_rates, u)
    gradient = ca.jacobian(velocity, u)
    drift = ca.substitute([velocity], [u], [ca.SX.zeros(nv)])[0]
    inverse = ca.solve(to_rates.T @ to_rates, to_rates.T)
    forms = ca.horzcat(gradient @ inverse, drift)
    x = ca.vertcat(q, t)
    derivatives = [ca.jacobian(forms[index, :].T, x) for index in rows]
    function = ca.Function("forms", [t, q], [gradient, drift, to_rates, *derivatives])
    values = [
        [np.array(value) for value in function(time, configuration)] for time, configuration in equations.start.nearby
    ]
    scales = equations.constraints.scales
    row_sizes = [equations.constraints.row_sizes(time, configuration) for time, configuration in equations.start.nearby]
    left, removed = set(rows), set(rows)
    while removed:
        kept = [index for index in range(len(equations.rows)) if index not in rows or index in left]
        removed = {
            index
            for sizes, (g, b, n, *jacobians) in zip(row_sizes, values, strict=True)
            for index, jacobian in zip(rows, jacobians, strict=True)
            if index in left and not _closed(jacobian, _directions(g[kept], b[kept], n, sizes[kept], scales))
        }
        left -= removed
    return {index: index in left for index in rows}


def _closed(jacobian: Array, allowed: Array) -> bool:
    """Whether dω, the skew-symmetric part of the form's Jacobian, vanishes on the allowed directions."""
    skew = allowed.T @ (jacobian - jacobian.T) @ allowed
    size = _largest(jacobian) * max(_largest(allowed), 1.0) ** 2
    return _largest(skew) <= VANISHING * max(size, 1.0)


def _largest(values: Array) -> float:
    return float(np.max(np.abs(values), initial=0.0))


def _directions(gradient: Array, drift: Array, to_rates: Array, row_sizes: Array, scales: Array) -> Array:
    """A basis (nq + 1, k) of the directions in coordinates and time that the constraints allow."""
    both, units = np.hstack([gradient, drift.reshape(-1, 1)]), np.append(scales, 1.0)
    basis = units[:, None] * null_space(scaled(both, row_sizes, units))
    return np.vstack([to_rates @ basis[:-1], basis[-1:]])
