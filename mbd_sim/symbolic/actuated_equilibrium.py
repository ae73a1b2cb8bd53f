"""Equilibria of mechanisms whose actuators have states, such as currents and integrals of servos."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from mbd_sim.dynamics.assembly import close_loops
from mbd_sim.dynamics.equations import Equations
from mbd_sim.dynamics.evaluation import evaluated
from mbd_sim.geometry.pose import Array
from mbd_sim.symbolic.equilibrium_formulas import NEAR
from mbd_sim.symbolic.symbolic_equations import SymbolicEquations

ITERATIONS = 60
LONGEST_STEP = 0.3  # m or rad
BALANCED = 1e-10  # rates that may remain, relative to those of the first guess


def equilibrium_with_states(equations: Equations, near: Array | None) -> tuple[Array, Array] | None:
    """Coordinates (nq,) and states of actuators (k,) that stay as they are, with the commands at the start, or None.

    They are found by Newton's method from the start and, if it does not converge, from another configuration.

    :param near: the coordinates (nq,) of this configuration, if there is one.
    """
    for q in (equations.start.q, near):
        found = None if q is None else _balanced(equations, q)
        if found is not None:
            return found
    return None


def _balanced(equations: Equations, q: Array) -> tuple[Array, Array] | None:
    nq, nv, core = equations.layout.nq, equations.layout.nv, equations.core
    columns, inputs = equations.derivative_layout, equations.inputs_without_commands
    states, constraints = equations.start_state[nq + nv : core.stop].copy(), equations.constraints
    scale = 0.0
    for _ in range(ITERATIONS):
        if equations.rows:
            closing = close_loops(constraints, 0.0, q, np.ones(nv, dtype=bool))
            if not closing.closed:
                return None
            q = closing.q
        y = equations.start_state.copy()
        y[:nq], y[nq : nq + nv], y[nq + nv : core.stop] = q, 0.0, states
        rates = np.array(equations.rates.call([0.0, y, inputs])[0]).ravel()[core]
        size = float(np.linalg.norm(rates))
        scale = max(scale, size, 1.0)
        if not np.isfinite(size):
            return None
        if size <= BALANCED * scale:
            return q, states
        free = constraints.free_directions(0.0, q)
        slopes = evaluated(equations.derivatives, 0.0, y, inputs).T[: len(rates)]
        slope = np.hstack([slopes[:, columns.displacements] @ free, slopes[:, columns.states]])
        sizes = np.linalg.norm(slope, axis=0)
        sizes[sizes == 0.0] = 1.0
        step = -np.linalg.lstsq(slope / sizes, rates, rcond=1e-12)[0] / sizes
        displacement = free @ step[: free.shape[1]]
        step *= min(1.0, LONGEST_STEP / max(float(np.max(np.abs(displacement), initial=0.0)), 1e-300))
        q = constraints.displaced(q, free @ step[: free.shape[1]])
        states = states + step[free.shape[1] :]
    return None


def states_at_rest(
    equations: SymbolicEquations, balance: Any, rates: Any, numbers: Mapping[Any, float]
) -> tuple[Any, tuple[Any, ...], dict[Any, float]]:
    """The equations of rest without the states, these states (k,) as formulas of coordinates, and numbers of others.

    Each state comes from an equation that is linear in it: of the rates or, without constraints, of the balance. The
    equations that are left come first, those of the balance last. A state without such an equation stays a symbol.

    :param balance: h - Q (nv,) at rest.
    :param rates: of the states (k,) at rest.
    :param numbers: the values of all symbols at the equilibrium.
    """
    import sympy as sp

    symbols = [state.symbol for one in equations.actuators for state in one.states]
    formulas: dict[Any, Any] = {}
    left = {index: sp.expand(entry) for index, entry in enumerate((*rates, *balance))}
    usable = len(symbols) if equations.rows else len(left)
    for _ in symbols:
        for symbol in (one for one in symbols if one not in formulas):
            places = (index for index, entry in left.items() if _is_linear(entry, symbol, numbers))
            place = next(places, usable)
            if place < usable:
                formula = sp.solve(left.pop(place), symbol)[0]
                left = {index: sp.expand(entry.subs(symbol, formula)) for index, entry in left.items()}
                formulas = {key: value.subs(symbol, formula) for key, value in formulas.items()} | {symbol: formula}
                break
    others = {symbol: numbers[symbol] for symbol in symbols if symbol not in formulas}
    entries = [entry for index, entry in left.items() if index >= len(symbols) or entry != 0]
    return sp.Matrix(entries), tuple(formulas.get(symbol, symbol) for symbol in symbols), others


def _is_linear(entry: Any, symbol: Any, numbers: Mapping[Any, float]) -> bool:
    slope = entry.diff(symbol)
    if slope == 0 or symbol in slope.free_symbols:
        return False
    value = slope.subs(numbers)
    return bool(value.is_number and abs(value) > NEAR)
