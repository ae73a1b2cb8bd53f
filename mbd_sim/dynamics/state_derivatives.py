"""The derivatives of the rates by the state and the inputs, from which small motions are described."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import TYPE_CHECKING

import casadi as ca

from mbd_sim.mechanism.drives import STATES

if TYPE_CHECKING:
    from mbd_sim.dynamics.equations import Equations


@dataclass(frozen=True)
class DerivativeLayout:
    """Where the derivatives of several quantities are in a matrix: its columns, one for each variable.

    `displacements` (nv,) are ν, which change q by N ν, with q' = N u. `speeds` (nv,) are u, and `states` those of
    actuators. `acting` are the inputs in `InputLayout.acting`, and `drives` the states of commanded drives.
    """

    displacements: slice
    speeds: slice
    states: slice
    acting: slice
    drives: slice

    @property
    def size(self) -> int:
        """The number of columns."""
        return int(self.drives.stop)


def derivative_layout(equations: Equations) -> DerivativeLayout:
    """The columns of the derivatives of a mechanism."""
    nq, nv = equations.layout.nq, equations.layout.nv
    states, drives = equations.core.stop - nq - nv, STATES * len(equations.layout.drives)
    ends = accumulate([nv, nv, states, len(equations.inputs.acting), drives], initial=0)
    return DerivativeLayout(*(slice(start, stop) for start, stop in pairwise(ends)))


def rate_derivatives(equations: Equations) -> ca.Function:
    """(t, y, inputs) -> the derivatives of several quantities, with the columns of `DerivativeLayout`, row by row.

    These are u' and the rates of the states of actuators, then those of the states of commanded drives, and G u + b.
    """
    t, y, inputs = (ca.SX.sym(name, equations.rates.size_in(index)) for index, name in enumerate("tye"))
    rates = equations.rates.call([t, y, inputs])[0]
    nq = equations.layout.nq
    quantities = [rates[equations.core], rates[nq - STATES * len(equations.layout.drives) : nq]]
    if equations.rows:
        given = [t, y, inputs][: equations.violation.n_in()]
        quantities.append(equations.violation.call(given)[0][:, 1])
    return derivative_function(equations, "derivatives", (t, y, inputs), ca.vertcat(*quantities))


def derivative_function(
    equations: Equations, name: str, symbols: tuple[ca.SX, ca.SX, ca.SX], quantities: ca.SX
) -> ca.Function:
    """(t, y, inputs) -> the derivatives of `quantities` (n,), expressions of `symbols`: see `rate_derivatives`."""
    _, y, inputs = symbols
    nq, nv = equations.layout.nq, equations.layout.nv
    kinematic = ca.jacobian(equations.rates.call(list(symbols))[0][:nq], y[nq : nq + nv])
    by_state, by_inputs = ca.jacobian(quantities, y), ca.jacobian(quantities, inputs)
    drives = nq - STATES * len(equations.layout.drives)
    columns = [
        by_state[:, :nq] @ kinematic,
        by_state[:, nq : equations.core.stop],
        by_inputs[:, equations.inputs.acting],
        by_state[:, drives:nq],
    ]
    return ca.Function(name, list(symbols), [ca.densify(ca.horzcat(*columns).T)], {"cse": True})
