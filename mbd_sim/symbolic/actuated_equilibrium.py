"""Equilibria of mechanisms whose actuators have states, such as currents and integrals of servos."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mbd_sim.symbolic.equilibrium_formulas import NEAR
from mbd_sim.symbolic.symbolic_equations import SymbolicEquations


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
