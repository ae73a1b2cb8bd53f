"""The parameters of a file as symbols, and the numbers of its equations as formulas of them.

The builders of a mechanism compute with numbers. So the parameters are varied, the numbers are sampled for several of
their values, and a formula is found for each number that changes, see `mbd_sim.studies.algebra.formulas`. A
number without such a formula becomes a symbol of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.errors import MbdSimError, MechanismError
from mbd_sim.base.geometry.batch import Batch, of_all
from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.kinematics.parameters import (
    EquationData,
    StructureError,
    SymbolicParameters,
    equation_data,
    equation_data_of_variants,
    varying_parameters,
)
from mbd_sim.dynamics.lagrange import MassMoments, mass_moments
from mbd_sim.files.builders.joints import REGULARIZATION
from mbd_sim.files.checks.override import values_of, with_values
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.laws import Expressed, PowerLaw, Varying
from mbd_sim.studies.algebra.formulas import MAX_TERMS, Factor, Formula, ParameterSamples, formulas
from mbd_sim.studies.algebra.names import key_name, symbol_latex
from mbd_sim.studies.algebra.polynomial import Exact, exact

Numbers = Callable[[Mechanism], Array]
NumbersOfVariants = Callable[[Mechanism, NDArray[np.bool_]], Array]
Changed = Callable[[Mapping[str, Any]], Mechanism]
SLICE, JOINT = 12, MAX_TERMS + 16  # samples
RANGES = (2.0, 1.3, 1.05)  # factors up to which parameters vary
OTHER = 0.4  # the largest value of a parameter that is zero
TRIES = 8


@dataclass(frozen=True, eq=False)
class NumberSamples:
    """The `keys` that can be symbols, their values `base`, and samples; `built_in` are the others, with the reason."""

    keys: tuple[str, ...]
    base: Array
    samples: ParameterSamples
    built_in: Mapping[str, str]


def sampled(mechanism: Mechanism, changes: Mapping[str, Any]) -> Mechanism:
    """The mechanism with other values, for samples of numbers that follow from them.

    Where nothing of it was mended, its numbers are as written, and so are those of the samples: loops of random
    lengths that do not close, or nearly, would be mended by something that no formula describes.
    """
    return with_values(mechanism, changes, mend_loops=bool(mechanism.moved))


def number_samples(
    changed: Changed,
    start: Mapping[str, float | None],
    numbers: Numbers,
    numbers_of_variants: NumbersOfVariants | None = None,
) -> NumberSamples:
    """Sample the numbers of a mechanism.

    :param changed: gives the mechanism with other values at keys of its file, also with batches of values.
    :param start: the values that it has at the keys.
    :param numbers: gives the numbers (n,) of a mechanism.
    :param numbers_of_variants: gives those (k, n) of k variants, from the mechanism with batches and the `valid` of
        these. With it, all samples are computed at once where that is possible; they have the same bits.
    """
    kept, built_in, unchanged = list[str](), dict[str, str](), changed({})
    data, given = equation_data(unchanged), numbers(unchanged)
    for key, value in start.items():
        reason = _reason(changed, data, lambda other: not np.array_equal(numbers(other), given), key, value)
        if reason is None:
            kept.append(key)
        elif reason:
            built_in[key] = reason
    base = np.array([start[key] or 0.0 for key in kept])
    random = np.random.default_rng(3)
    for factor in RANGES if kept else ():
        sampler = _Sampler(changed, kept, base, numbers, numbers_of_variants, random, factor)
        if (samples := sampler.at_once() or sampler.one_by_one()) is not None:
            return NumberSamples(tuple(kept), base, samples, built_in)
    built_in |= dict.fromkeys(kept, "no other values fit")
    one = numbers(changed({}))
    return NumberSamples((), np.zeros(0), ParameterSamples((), (np.zeros((1, 0)), one[None, :])), built_in)


def _reason(
    changed: Changed, data: EquationData, differs: Callable[[Mechanism], bool], key: str, value: float | None
) -> str | None:
    """Why a key cannot be a symbol; empty if no number depends on it, None if it can be one."""
    if value is None:
        return "it is not a number"
    for factor in RANGES[1:]:
        try:
            other = changed({key: value / factor if value else OTHER})
            found = varying_parameters(data, [equation_data(other)])
        except MechanismError:
            continue
        except StructureError as error:
            return str(error)
        return None if len(found.base) or differs(other) else ""
    return "no other values fit"


@dataclass(frozen=True, eq=False)
class _Sampler:
    changed: Changed
    keys: Sequence[str]
    base: Array
    numbers: Numbers
    numbers_of_variants: NumbersOfVariants | None
    random: np.random.Generator
    factor: float

    def one_by_one(self) -> ParameterSamples | None:
        """A slice along each parameter, and samples of all of them; None where too few values fit."""
        generic = self._draw(1)[0]
        if not len(generic):
            return None
        slices = [self._draw(SLICE, free, generic[0]) for free in np.eye(len(self.keys), dtype=bool)]
        joint = self._draw(JOINT)
        fewest = min(len(parameters) for parameters, _ in (*slices, joint))
        return ParameterSamples(slices, joint) if fewest >= SLICE else None

    def at_once(self) -> ParameterSamples | None:
        """The samples of `one_by_one`, built as one mechanism with batches; None where one has to be built by itself.

        The first and the last are also built by themselves, to be compared.
        """
        if self.numbers_of_variants is None:
            return None
        state = self.random.bit_generator.state
        generic = self._values()
        rows = [generic]
        for free in np.eye(len(self.keys), dtype=bool):
            rows += [np.where(free, self._values(), generic) for _ in range(SLICE)]
        rows += [self._values() for _ in range(JOINT)]
        table, valid = np.array(rows), np.ones(len(rows), dtype=np.bool_)
        columns = {key: Batch(column.copy(), valid) for key, column in zip(self.keys, table.T, strict=True)}
        try:
            found = self.numbers_of_variants(self.changed(columns), valid)
            fits = np.all(valid) and all(np.array_equal(found[i], self._numbers_at(table[i])) for i in (0, -1))
        except (MbdSimError, TypeError, ValueError, LookupError, AttributeError, ArithmeticError):
            fits = False  # what does not fit a batch is found one by one
        if not fits:
            self.random.bit_generator.state = state
            return None
        ends = np.arange(1, len(rows) - JOINT + 1, SLICE)
        slices = [(table[first : first + SLICE], found[first : first + SLICE]) for first in ends[:-1]]
        return ParameterSamples(slices, (table[-JOINT:], found[-JOINT:]))

    def _numbers_at(self, values: Array) -> Array:
        return self.numbers(self.changed(dict(zip(self.keys, values.tolist(), strict=True))))

    def _values(self) -> Array:
        """Random values of all parameters."""
        spread = self.factor ** self.random.uniform(-1.0, 1.0, len(self.base))
        other = self.random.uniform(OTHER / 4.0, OTHER, len(self.base))
        return np.where(self.base == 0.0, other, self.base * spread)

    def _draw(self, count: int, free: Array | None = None, at: Array | None = None) -> tuple[Array, Array]:
        """Parameters and numbers; fewer than `count` samples where the values do not fit.

        :param free: the parameters that vary; the others are those in `at`.
        """
        parameters, found = [], []
        for _ in range(TRIES * count):
            values = self._values()
            if free is not None and at is not None:
                values = np.where(free, values, at)
            try:
                numbers = self._numbers_at(values)
            except MechanismError:
                continue
            parameters.append(values)
            found.append(numbers)
            if len(found) == count:
                break
        width = len(self.base)
        return np.array(parameters).reshape(-1, width), np.array(found).reshape(len(found), -1)


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
    mechanism = as_in_textbooks(mechanism)
    data, base = equation_data(mechanism), _numbers(mechanism)
    samples = number_samples(
        lambda changes: as_in_textbooks(sampled(mechanism, changes)),
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


def as_in_textbooks(mechanism: Mechanism) -> Mechanism:
    """The mechanism `with_forces_alone` whose dampers have no regularization that is only for derivatives at rest."""

    def plain(record: Any, key: str) -> Any:
        law = getattr(record, key)
        guarded = isinstance(law, PowerLaw) and law.exponent > 1.0 and law.regularization == REGULARIZATION
        return replace(record, **{key: replace(law, regularization=0.0)}) if guarded else record

    mechanism = with_forces_alone(mechanism)
    joints = {name: plain(joint, "damper") for name, joint in mechanism.joints.items()}
    return replace(mechanism, joints=joints, dampers=tuple(plain(damper, "law") for damper in mechanism.dampers))


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
