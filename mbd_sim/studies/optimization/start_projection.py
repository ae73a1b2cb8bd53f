"""The state nearest to a given one that satisfies the constraints, as `Simulation.reset` finds it, and its derivatives.

Positions follow by Gauss-Newton steps of least norm s = −G⁺ Φ, whose derivatives are accumulated step by step. Those of
the pseudoinverse are by Golub & Pereyra, *SIAM J. Numer. Anal.* 10 (1973), for a constant rank. Speeds follow with the
least kinetic energy of their change.
"""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.constraints.assembly import ClosingStep, close_loops, energy_rows, nearest_speeds
from mbd_sim.dynamics.constraints.functions import ConstraintFunctions, scaled
from mbd_sim.dynamics.math.expressions import all_evaluated, evaluated
from mbd_sim.dynamics.math.rank import fast_least_solution, row_is_zero
from mbd_sim.studies.optimization.casadi_functions import CasadiFunctions

CLOSED = 1e-13  # change of a state below which it satisfies the constraints, relative to its scale + |x|


class StartProjection:
    """Moves start states onto the constraints of a mechanism; states are (q, u, states of actuators) in SI units."""

    def __init__(self, functions: CasadiFunctions) -> None:
        self._functions = functions
        self._equations = functions.equations
        self._nq, self._nv = self._equations.layout.nq, self._equations.layout.nv

    def consistent(self, t: float, x: Array, p: Array) -> tuple[Array, Array, Array]:
        """The state (nx,) nearest to x that satisfies the constraints, and its derivatives by x and by p.

        Positions move as little as possible in the coordinates, and speeds with the least kinetic energy. A state that
        satisfies the constraints stays as it is.

        :param t: the time in s.
        :param p: (np,) the parameters of the functions.
        :return: the state (nx,), and the derivatives (nx, nx) and (nx, np).
        :raises InputError: no position near x closes the loops.
        """
        by_x, by_p = np.eye(len(x)), np.zeros((len(x), len(p)))
        if self._equations.project is None:
            return x, by_x, by_p
        equations, (q, u) = self._equations, (slice(0, self._nq), slice(self._nq, self._nq + self._nv))
        constraints = self._with_numbers(p)
        start = constraints.displaced(x[q], np.zeros(self._nv))  # with unit quaternions
        by_x[q], by_p[q] = self._moved(x[q], np.zeros(self._nv), by_x[q], by_p[q])
        after = np.concatenate([start, x[q.stop :]])
        if equations.rows:
            closure = close_loops(constraints, t, start, np.ones(self._nv, dtype=bool))
            if not closure.closed:
                raise InputError("no state near the start closes the loops", "Start closer to a closed configuration.")
            # The last step is that at the end of the path, whose derivative remains where there is no gap any more.
            for step in (*closure.path, ClosingStep(closure.q, None, 1.0)):
                by_x[q], by_p[q] = self._stepped(t, p, step, by_x[q], by_p[q])
            after[q] = closure.q
            after[u] = nearest_speeds(constraints, t, closure.q, x[u])
            by_x[u], by_p[u] = self._speeds(t, p, x[u], after, by_x, by_p)
        stays = np.all(np.abs(after - x) <= CLOSED * (np.array(equations.scales)[: len(x)] + np.abs(x)))
        return x if stays else after, by_x, by_p

    def _with_numbers(self, p: Array) -> ConstraintFunctions:
        return self._equations.constraints.with_values(evaluated(self._functions.numbers, p).ravel())

    def _moved(self, q: Array, displacement: Array, *columns: Array) -> tuple[Array, ...]:
        """The derivatives of the coordinates after a displacement (nv,) that is constant, from those before it."""
        by_q = evaluated(self._displaced, q, displacement)
        return tuple(by_q @ column for column in columns)

    def _stepped(self, t: float, p: Array, step: ClosingStep, by_x: Array, by_p: Array) -> tuple[Array, Array]:
        """The derivatives after a step, from those before it.

        With s = −G⁺ Φ, r = Φ + G s and b = G⁺ᵀ s, ds = −G⁺ (dΦ + dG s) − G⁺ G⁺ᵀ dGᵀ r + (1 − G⁺ G) dGᵀ b.
        """
        q = step.q
        if step.displacement is not None:  # to another guess
            by_x, by_p = self._moved(q, step.displacement, by_x, by_p)
            return by_x, by_p
        constraints, (gaps, g) = self._with_numbers(p), self._constraints(t, q, p)
        scales, sizes = constraints.scales, constraints.row_sizes(t, q)[constraints.holonomic]
        sizes = np.where(sizes > 0.0, sizes, np.inf)
        gaps, g = gaps / sizes, scaled(g, sizes, scales)  # all of the following is in natural units
        inverse = fast_least_solution(g, np.eye(len(g)))
        s = -inverse @ gaps
        rest, back = gaps + g @ s, inverse.T @ s
        found = all_evaluated(self._derivatives, t, q, p, scales * s, rest / sizes, back / sizes)
        by_rows, by_speeds = 1.0 / sizes[:, None], scales[:, None]
        units = (by_rows, by_rows, by_speeds, by_speeds)
        changes = [unit * each for unit, each in zip(units, found, strict=True)]
        moved = []
        for columns, direct in ((by_x, np.zeros((len(p), by_x.shape[1]))), (by_p, np.eye(len(p)))):
            seeds = np.vstack([columns, direct])
            d_gaps, d_gs, d_g_rest, d_g_back = (each @ seeds for each in changes)
            d_s = -inverse @ (d_gaps + d_gs) - inverse @ (inverse.T @ d_g_rest)
            d_s += d_g_back - inverse @ (g @ d_g_back)
            longest = int(np.argmax(np.abs(s))) if s.size else 0
            factor = step.factor
            if s.size and abs(s[longest]) > step.longest:  # shortened to a length
                d_s = d_s - np.outer(s / s[longest], d_s[longest])
            by_q, by_move = all_evaluated(self._displaced, q, factor * scales * s)
            moved.append(by_q @ columns + by_move @ (factor * by_speeds * d_s))
        return moved[0], moved[1]

    def _speeds(self, t: float, p: Array, u: Array, after: Array, by_x: Array, by_p: Array) -> tuple[Array, Array]:
        """The derivatives of the speeds v with G v + b = 0 and M (v − u) + Gᵀ μ = 0; u are the speeds before."""
        span = slice(self._nq, self._nq + self._nv)
        q, v = after[: self._nq], after[span]
        mass, gradient = all_evaluated(self._inertia, t, q, p)
        constraints = self._with_numbers(p)
        zero = row_is_zero(scaled(gradient, constraints.row_sizes(t, q), constraints.scales))
        to_unit, rows, sizes = energy_rows(mass, gradient, zero, constraints.scales)
        inverse = fast_least_solution(rows, np.eye(len(rows)))
        mu = -(inverse.T @ (to_unit.T @ (mass @ (v - u)))) / sizes
        force, rate = all_evaluated(self._speed_terms, t, q, p, v - u, mu, v)
        found = []
        for columns, direct in ((by_x, np.zeros((len(p), by_x.shape[1]))), (by_p, np.eye(len(p)))):
            seeds = np.vstack([columns[: self._nq], direct])
            change = columns[span] - to_unit @ (to_unit.T @ (force @ seeds))
            change -= to_unit @ (inverse @ ((gradient @ change + rate @ seeds) / sizes[:, None]))
            found.append(change)
        return found[0], found[1]

    @cached_property
    def _symbols(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        return ca.SX.sym("t"), ca.SX.sym("q", self._nq), ca.SX.sym("p", len(self._functions.values))

    @cached_property
    def _displaced(self) -> ca.Function:
        q, move = ca.SX.sym("q", self._nq), ca.SX.sym("move", self._nv)
        numbers = ca.SX.zeros(self._equations.parameters.base.size, 1)
        moved = self._equations.constraints.traced.displaced.call([q, move, numbers])[0]
        by_both = [ca.densify(ca.jacobian(moved, each)) for each in (q, move)]
        return ca.Function("displaced", [q, move], by_both, {"cse": True})

    @cached_property
    def _holonomic(self) -> tuple[ca.SX, ca.SX]:
        """Φ and G of the holonomic rows."""
        constraints, (t, q, p) = self._equations.constraints, self._symbols
        chosen = np.flatnonzero(constraints.holonomic).tolist()
        given = [t, q, self._functions.numbers.call([p])[0]]
        gaps, g = (function.call(given)[0] for function in (constraints.traced.position, constraints.traced.gradient))
        return gaps[chosen], g[chosen, :]

    def _constraints(self, t: float, q: Array, p: Array) -> tuple[Array, Array]:
        """Φ and G of the holonomic rows as numbers."""
        gaps, g = all_evaluated(self._gaps, t, q, p)
        return gaps.ravel(), g

    @cached_property
    def _gaps(self) -> ca.Function:
        return ca.Function("gaps", list(self._symbols), [ca.densify(each) for each in self._holonomic], {"cse": True})

    @cached_property
    def _derivatives(self) -> ca.Function:
        """The derivatives by (q, p) of Φ, G s, Gᵀ rest and Gᵀ back, with the vectors constant."""
        (t, q, p), (gaps, g) = self._symbols, self._holonomic
        s, rest, back = ca.SX.sym("s", g.shape[1]), ca.SX.sym("rest", g.shape[0]), ca.SX.sym("back", g.shape[0])
        terms = (gaps, g @ s, g.T @ rest, g.T @ back)
        by_both = [ca.densify(ca.jacobian(term, ca.vertcat(q, p))) for term in terms]
        return ca.Function("derivatives", [t, q, p, s, rest, back], by_both, {"cse": True})

    @cached_property
    def _inertia(self) -> ca.Function:
        t, q, p = self._symbols
        mass, gradient, _ = self._of_speeds
        return ca.Function("inertia", [t, q, p], [ca.densify(mass), ca.densify(gradient)], {"cse": True})

    @cached_property
    def _of_speeds(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """M, G and b of all rows."""
        t, q, p = self._symbols
        traced, given = self._equations.constraints.traced, [t, q, self._functions.numbers.call([p])[0]]
        mass, gradient, drift = (
            function.call(given)[0] for function in (traced.mass_matrix, traced.gradient, traced.drift)
        )
        return mass, gradient, drift

    @cached_property
    def _speed_terms(self) -> ca.Function:
        """The derivatives by (q, p) of M change + Gᵀ μ and of G v + b, with the vectors constant."""
        (t, q, p), (mass, gradient, drift) = self._symbols, self._of_speeds
        change, v = ca.SX.sym("change", self._nv), ca.SX.sym("v", self._nv)
        mu = ca.SX.sym("mu", gradient.shape[0])
        terms = (mass @ change + gradient.T @ mu, gradient @ v + drift)
        by_both = [ca.densify(ca.jacobian(term, ca.vertcat(q, p))) for term in terms]
        return ca.Function("speed_terms", [t, q, p, change, mu, v], by_both, {"cse": True})
