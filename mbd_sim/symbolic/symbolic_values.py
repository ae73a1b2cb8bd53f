"""The parameters of a file as symbols, and the numbers of its equations as formulas of them.

The builders of a mechanism compute with numbers. So the parameters are varied, and a formula is found for each number
that changes, see `mbd_sim.symbolic.number_formulas`. A number without such a formula becomes a symbol of its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from mbd_sim.dynamics.mass_moments import MassMoments, mass_moments
from mbd_sim.dynamics.symbolic_parameters import (
    EquationData,
    SymbolicParameters,
    equation_data,
    equation_data_of_variants,
)
from mbd_sim.geometry.batch import of_all
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.laws import Expressed, Varying
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.mechanism_file.override import values_of, with_values
from mbd_sim.symbolic.exact_numbers import Exact, exact
from mbd_sim.symbolic.number_formulas import Factor, Formula, formulas
from mbd_sim.symbolic.parameter_samples import number_samples
from mbd_sim.symbolic.symbol_names import key_name, symbol_latex

GRAVITY = "g"
MOMENTS = 13  # mass, first and second moments of a part


@dataclass(frozen=True, eq=False)
class ParameterSymbol:
    """A `symbol` of SymPy with its LaTeX, its `value` in SI units, what it stands for, and its value as in the file.

    `key` is that of the file; empty for the gravity, and for a number without a formula.
    """

    symbol: Any
    latex: str
    value: float
    key: str
    stands_for: str
    written: str


@dataclass(frozen=True, eq=False)
class SymbolicValues:
    """The symbols, and the numbers of the equations that depend on them.

    `numbers` are CasADi symbols for these numbers, with a formula in the parameters for each. `moments` has the
    moments of all parts with these symbols. `built_in` names parameters that stay numbers, each with the reason.
    """

    symbols: tuple[ParameterSymbol, ...]
    numbers: SymbolicParameters
    formulas: tuple[Formula, ...]
    moments: Mapping[str, MassMoments]
    built_in: Mapping[str, str]


def symbolic_values(mechanism: Mechanism, keys: Sequence[str]) -> SymbolicValues:
    """Replace parameters of a mechanism by symbols, and gravity by g.

    :param keys: of its file, as for live values.
    :raises MechanismError: there is no such key.
    """
    mechanism = with_forces_alone(mechanism)
    data, base = equation_data(mechanism), _numbers(mechanism)
    samples = number_samples(
        lambda changes: with_forces_alone(with_values(mechanism, changes)),
        values_of(mechanism, keys),
        _numbers,
        _numbers_of_variants,
    )
    symbols = [_symbol(mechanism, key, value) for key, value in zip(samples.keys, samples.base, strict=True)]
    found: list[Formula | int] = [Formula(())] * len(base)
    if samples.keys:
        found = formulas(samples.samples, _scales(data, base))
    _add_gravity(mechanism, data, found, symbols)
    columns, column_of = _columns(data, base, found, symbols)
    values = np.zeros(len(columns))
    for index in np.flatnonzero(column_of >= 0):
        values[column_of[index]] = base[index]
    free = np.flatnonzero(column_of[: len(data.free)] >= 0)
    numbers = SymbolicParameters(data, free, column_of[free], values)
    moments = _moments(mechanism, numbers.symbols, column_of[len(data.free) :], base[len(data.free) :])
    return SymbolicValues(tuple(symbols), numbers, tuple(columns), moments, samples.built_in)


def _columns(
    data: EquationData, base: Array, found: Sequence[Formula | int], symbols: list[ParameterSymbol]
) -> tuple[list[Formula], NDArray[np.intp]]:
    """The different formulas, and the index of that of each number, -1 for a number that does not vary."""
    columns: dict[Formula, int] = {}
    others: dict[int, Formula] = {}
    column_of = np.full(len(base), -1, dtype=np.intp)
    for index, formula in enumerate(found):
        if not _is_read(data, index):
            continue
        if isinstance(formula, int) and formula not in others:
            others[formula] = _own_symbol(data, index, float(base[index]), symbols)
        own = others[formula] if isinstance(formula, int) else formula
        if own.parameters:
            column_of[index] = columns.setdefault(own, len(columns))
    return list(columns), column_of


def with_forces_alone(mechanism: Mechanism) -> Mechanism:
    """The mechanism with springs given by expressions without their potential, which is an integral in pieces."""

    def opened(record: Any, law: str) -> Any:
        own = getattr(record, law)
        return replace(record, **{law: Varying(own.force)}) if isinstance(own, Expressed) else record

    joints = {name: opened(joint, "spring") for name, joint in mechanism.joints.items()}
    return replace(mechanism, joints=joints, springs=tuple(opened(spring, "law") for spring in mechanism.springs))


def _numbers(mechanism: Mechanism) -> Array:
    """All numbers of the equations that can be symbols, then the moments of the parts."""
    parts = [mass_moments(part) for part in mechanism.parts.values()]
    moments = [np.concatenate([[m.mass], np.ravel(m.first), np.ravel(m.second)]) for m in parts]
    return np.concatenate([equation_data(mechanism).free, *moments])


def _numbers_of_variants(mechanism: Mechanism, valid: NDArray[np.bool_]) -> Array:
    """The numbers (k, n) of the k variants of a mechanism whose numbers are batches."""
    moments = [mass_moments(part) for part in mechanism.parts.values()]
    values = [value for one in moments for value in (one.mass, one.first, one.second)]
    free = [data.free for data in equation_data_of_variants(mechanism, valid)]
    return np.hstack([free, *(of_all(value, len(valid)).reshape(len(valid), -1) for value in values)])


def _is_read(data: EquationData, index: int) -> bool:
    """Whether a number is used: moments of parts are, and not what the records have in their place."""
    if index >= len(data.paths):
        return True
    path = data.paths[index]
    return path[2:3] != ("inertia",) and not (path[1] == "parts" and path[-1] == "mass") and "center" not in path


def _scales(data: EquationData, base: Array) -> Array:
    """The largest component of the vector or matrix of each number."""
    groups = [path[:-1] if isinstance(path[-1], int) else path for path in data.paths]
    groups += [("moments", index // MOMENTS, _moment(index)) for index in range(len(base) - len(groups))]
    largest: dict[Any, float] = {}
    for group, value in zip(groups, base, strict=True):
        largest[group] = max(largest.get(group, 0.0), abs(value))
    return np.array([largest[group] for group in groups])


def _moment(index: int) -> int:
    """The degree of a moment: 0 for the mass."""
    return int(index % MOMENTS > 0) + int(index % MOMENTS > 3)


def _symbol(mechanism: Mechanism, key: str, value: float) -> ParameterSymbol:
    import sympy as sp

    name = key.removeprefix("parameters.")
    written = (mechanism.source.data.get("parameters") or {}).get(name)
    plain, latex = (name, symbol_latex(name)) if "." not in name else key_name(name)
    symbol = sp.Symbol(plain, positive=True) if value > 0.0 else sp.Symbol(plain, real=True)
    shown = written if isinstance(written, str) else f"{value:.6g}"
    what = "the parameter" if written is not None else "the value at"
    return ParameterSymbol(symbol, latex, value, key, what, shown)


def _own_symbol(data: EquationData, index: int, value: float, symbols: list[ParameterSymbol]) -> Formula:
    """A symbol for a number without a formula."""
    import sympy as sp

    count = 1 + sum(symbol.latex.startswith("n_") for symbol in symbols)
    symbol = sp.Symbol(f"n_{count}", real=True)
    what = "a moment of a part" if index >= len(data.paths) else ".".join(map(str, data.paths[index][1:]))
    stands_for = f"a number without a short formula, {what}"
    symbols.append(ParameterSymbol(symbol, f"n_{{{count}}}", value, "", stands_for, f"{value:.6g}"))
    return Formula(((Exact(Fraction(1)), (Factor("power", len(symbols) - 1, Fraction(1)),)),))


def _add_gravity(
    mechanism: Mechanism, data: EquationData, found: list[Formula | int], symbols: list[ParameterSymbol]
) -> None:
    """Make the gravity a symbol, unless a parameter of the file determines it."""
    import sympy as sp

    rows = [index for index, path in enumerate(data.paths) if path[:2] == (0, "gravity")]
    size = float(np.linalg.norm(mechanism.gravity))
    if not size or any(isinstance(one, int) or one.parameters for one in (found[row] for row in rows)):
        return
    name = GRAVITY if all(str(one.symbol) != GRAVITY for one in symbols) else "gravity"
    latex = GRAVITY if name == GRAVITY else r"g_{\mathrm{0}}"
    symbols.append(ParameterSymbol(sp.Symbol(name, positive=True), latex, size, "", "the gravity", f"{size:g} m/s²"))
    factor = (Factor("power", len(symbols) - 1, Fraction(1)),)
    for row in rows:
        direction = float(data.free[row]) / size
        found[row] = Formula(((exact(direction), factor),) if direction else ())


def _moments(mechanism: Mechanism, symbols: ca.SX, columns: NDArray[np.intp], values: Array) -> dict[str, MassMoments]:
    """The moments of each part, with symbols where they depend on parameters."""
    found = {}
    for number, name in enumerate(mechanism.parts):
        own = slice(MOMENTS * number, MOMENTS * (number + 1))
        entries = [
            symbols[int(column)] if column >= 0 else ca.SX(float(value)) if value else ca.SX(1, 1)
            for column, value in zip(columns[own], values[own], strict=True)
        ]
        first, second = ca.vertcat(*entries[1:4]), ca.reshape(ca.vertcat(*entries[4:]), 3, 3)
        found[name] = MassMoments(entries[0], ca.sparsify(first), ca.sparsify(second))
    return found
