"""Parameters of a file that follow from others by its formulas, as CasADi expressions of these."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from mbd_sim.base.errors import MechanismError, Problem
from mbd_sim.dynamics.math.expressions import function_of
from mbd_sim.files.checks.override import location_of
from mbd_sim.files.text.parameters import dependencies_first, resolve_functions
from mbd_sim.files.text.units import split_unit, unit_factor
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.expression import TimeExpression, names_in

SAME = 1e-12  # relative difference of a value by its formula and that of the file


def derived_parameters(mechanism: Mechanism, keys: Sequence[str]) -> list[str]:
    """The other parameters whose formulas in the file depend on those at `keys`, each after those that it uses."""
    reached, found = set(_names(mechanism, keys)), list[str]()
    formulas = _formulas(mechanism)
    uses = {name: names_in(text, formulas) for name, (text, _) in formulas.items()}
    for name in dependencies_first(uses):
        if name not in reached and uses[name] & reached:
            reached.add(name)
            found.append(name)
    return found


def derived_values(mechanism: Mechanism, keys: Sequence[str], derived: Sequence[str]) -> ca.Function:
    """The values of parameters (n,) at `keys` and of the `derived` ones (k,) as a function (n + k,) of the former.

    :raises MechanismError: a formula does not give the value that the file has.
    """
    parameters, formulas = ca.SX.sym("parameters", len(keys)), _formulas(mechanism)
    names = {name: ca.SX(float(value)) for name, value in mechanism.parameters.items()}
    given = dict(zip(_names(mechanism, keys), range(len(keys)), strict=True))
    names |= {name: parameters[index] for name, index in given.items()}
    for name in derived:
        text, unit = formulas[name]
        names[name] = function_of(TimeExpression(text, {}), names) * (unit_factor(unit, None) if unit else 1.0)
    found = ca.Function("derived", [parameters], [ca.vertcat(parameters, *(names[name] for name in derived))])
    start = [mechanism.parameters.get(name, 0.0) for name in given]
    expected = np.array([*start, *(mechanism.parameters[name] for name in derived)])
    differs = np.abs(found(ca.DM(start)).full().ravel() - expected) > SAME * np.abs(expected)
    if np.any(differs):
        name = [*given, *derived][int(np.argmax(differs))]
        message = f"the value of '{name}' does not follow from its formula in the same way for all parameters"
        raise MechanismError([Problem(message, "Write it as an expression.", key=name, file=mechanism.source.file)])
    return found


def _names(mechanism: Mechanism, keys: Sequence[str]) -> list[str]:
    """The names of the keys that are parameters, and the other keys, which no formula uses."""
    locations = [(key, location_of(mechanism, key)) for key in keys]
    return [str(at[1]) if at[0] == "parameters" and len(at) == 2 else key for key, at in locations]


def _formulas(mechanism: Mechanism) -> dict[str, tuple[str, str]]:
    """The expression and the unit of each parameter that is written as one; of the others, an empty number."""
    functions, written = resolve_functions(mechanism.source), mechanism.source.data.get("parameters") or {}
    parts = {name: split_unit(value) if isinstance(value, str) else ("0", "") for name, value in written.items()}
    return {name: (functions.expanded(text), unit) for name, (text, unit) in parts.items()}
