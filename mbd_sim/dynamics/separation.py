"""An expression separated into what can be computed early and what follows from it."""

from __future__ import annotations

import casadi as ca


def separated(expression: ca.SX, given: ca.SX, right: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Symbols (m,) for all that depends on `given` only, their values, and the expression with these symbols."""
    reduced, symbols, values = ca.extract_parametric(expression, given)
    own = {entry.element_hash() for entry in [*ca.vertsplit(right), *symbols]}
    bare = [entry for entry in ca.symvar(reduced) if entry.element_hash() not in own]
    renamed = [ca.SX.sym(f"given_{index}") for index in range(len(bare))]
    reduced = ca.substitute(reduced, ca.vertcat(ca.SX(0, 1), *bare), ca.vertcat(ca.SX(0, 1), *renamed))
    memory, contents = (ca.vertcat(ca.SX(0, 1), *entries) for entries in ([*symbols, *renamed], [*values, *bare]))
    return memory, ca.densify(contents), reduced
