"""Formulas of numbers that depend on parameters, found from samples: `m l²/3` from the moment of inertia of a rod.

A builder of mechanisms computes with numbers. Here each of its results is sampled for several values of the parameters,
and matched with a sum of products of powers, sines and cosines of them, whose coefficients are exact numbers. A formula
is accepted only if it reproduces all samples to rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations, product
from typing import Literal

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.studies.algebra.polynomial import Exact, exact

Kind = Literal["power", "sin", "cos"]
ROUNDING = 1e-13  # of a value, relative to the largest of its terms
FITTED = 1e-11  # residual of a fit, and error of its coefficients, relative
NEGLIGIBLE = 1e-10  # size of a term, relative to the largest one
MAX_TERMS = 64  # of a formula before those that vanish are left out
MAX_FUNCTIONS = 3  # of one parameter in a formula


@dataclass(frozen=True, order=True)
class Factor:
    """A power of a parameter, or of its sine or cosine, by the parameter's index."""

    kind: Kind
    parameter: int
    exponent: Fraction

    def value(self, parameters: Array) -> Array:
        """Its values (n,) at the samples (n, parameters)."""
        x = parameters[:, self.parameter]
        base = x if self.kind == "power" else np.sin(x) if self.kind == "sin" else np.cos(x)
        return np.asarray(base ** float(self.exponent))


Term = tuple[Factor, ...]


@dataclass(frozen=True)
class Formula:
    """A sum of products: coefficients and the factors that each one multiplies.

    With a `root` of ±1, the number is this sign times the square root of the sum.
    """

    terms: tuple[tuple[Exact, Term], ...]
    root: int = 0

    def value(self, parameters: Array) -> Array:
        """Its values (n,) at the samples (n, parameters)."""
        total = np.zeros(len(parameters))
        for coefficient, term in self.terms:
            total += float(coefficient) * _product(term, parameters)
        return self.root * np.sqrt(np.abs(total)) if self.root else total

    @property
    def parameters(self) -> set[int]:
        """The indices of the parameters in it."""
        return {factor.parameter for _, term in self.terms for factor in term}


@dataclass(frozen=True, eq=False)
class ParameterSamples:
    """Values of parameters, and of the numbers that depend on them.

    In `slices`, an entry for each parameter, only that one varies: the parameters (n, parameters) and the numbers
    (n, numbers). In `joint` all of them vary.
    """

    slices: Sequence[tuple[Array, Array]]
    joint: tuple[Array, Array]


def formulas(samples: ParameterSamples, scales: Array, *, decimals: bool = False) -> list[Formula | int]:
    """The formula of each number; if there is none with few terms, an index that equal numbers share.

    :param scales: (numbers,) the size of the vector or matrix to which a number belongs; what is below its rounding
        is zero.
    :param decimals: whether coefficients may be other numbers than short exact ones, such as the cosine of an angle.
    """
    known: dict[bytes, Formula | int] = {}
    found: list[Formula | int] = []
    for index in range(samples.joint[1].shape[1]):
        key = np.concatenate([samples.joint[1][:, index], *(values[:, index] for _, values in samples.slices)])
        if np.max(np.abs(key)) <= ROUNDING * scales[index]:
            found.append(Formula(()))
            continue
        if (name := key.tobytes()) not in known:
            formula = _formula(samples, index, decimals)
            known[name] = len(known) if formula is None else formula
        found.append(known[name])
    return found


def _formula(samples: ParameterSamples, index: int, decimals: bool) -> Formula | None:
    slices = [(parameters, numbers[:, index]) for parameters, numbers in samples.slices]
    parameters, numbers = samples.joint
    y = numbers[:, index]
    found = _sum_of_products(slices, parameters, y, decimals)
    if found is None and (np.all(y > 0.0) or np.all(y < 0.0)):
        square = _sum_of_products([(p, values**2) for p, values in slices], parameters, y**2, decimals)
        found = None if square is None else Formula(square.terms, 1 if y[0] > 0.0 else -1)
    return found


def _sum_of_products(
    slices: Sequence[tuple[Array, Array]], parameters: Array, y: Array, decimals: bool
) -> Formula | None:
    supports = []
    for parameter, (own, values) in enumerate(slices):
        support = _support(parameter, own, values)
        if support is None:
            return None
        supports.append(support)
    if np.prod([len(support) for support in supports]) > MAX_TERMS:
        return None
    terms = [tuple(sorted(factor for part in parts for factor in part)) for parts in product(*supports)]
    return _fitted(terms, parameters, y, decimals)


def _fitted(terms: list[Term], parameters: Array, y: Array, decimals: bool) -> Formula | None:
    """The formula with some of these terms that reproduces a number."""
    if len(terms) + 4 > len(y):
        return None
    for _ in range(2):  # first with all terms, then with those that are left
        columns = np.column_stack([_product(term, parameters) for term in terms])
        sizes = np.max(np.abs(columns), axis=0)
        fitted = np.linalg.lstsq(columns / sizes, y, rcond=None)[0]
        kept = np.abs(fitted) > NEGLIGIBLE * np.max(np.abs(fitted))
        terms = [term for term, keep in zip(terms, kept, strict=True) if keep]
        values = (fitted / sizes)[kept]
    largest = np.max(np.abs(values * sizes[kept]))
    short = [exact(value, FITTED) for value in values.tolist()]
    long = [Exact(Fraction(value)) for value in values.tolist()]
    for coefficients in (short, long) if decimals else (short,):
        result = Formula(tuple(zip(coefficients, terms, strict=True)))
        if np.max(np.abs(result.value(parameters) - y)) <= ROUNDING * largest:
            return result
    return None


def _support(parameter: int, parameters: Array, y: Array) -> list[Term] | None:
    """The functions of one parameter in a number, while the others are constant."""
    if np.ptp(y) <= ROUNDING * np.max(np.abs(y)):
        return [()]
    functions = _functions(parameter)
    columns = np.column_stack([_product(term, parameters) for term in functions])
    columns = columns / np.max(np.abs(columns), axis=0)
    usable = [index for index in range(len(functions)) if np.all(np.isfinite(columns[:, index]))]
    for count in range(1, MAX_FUNCTIONS + 1):
        for chosen in combinations(usable, count):
            if _residual(columns[:, chosen], y) <= FITTED * np.max(np.abs(y)):
                return [functions[index] for index in chosen]
    return None


def _residual(columns: Array, y: Array) -> float:
    coefficients = np.linalg.lstsq(columns, y, rcond=None)[0]
    return float(np.max(np.abs(columns @ coefficients - y)))


def _functions(parameter: int) -> list[Term]:
    """Functions of a parameter, the simplest ones first."""

    def power(numerator: int, denominator: int = 1, kind: Kind = "power") -> Factor:
        return Factor(kind, parameter, Fraction(numerator, denominator))

    powers: list[Term] = [(power(exponent),) for exponent in (1, 2, -1, 3, -2, 4, 5, 6, -3)]
    roots: list[Term] = [(power(1, 2),), (power(-1, 2),), (power(3, 2),)]
    sine, cosine = power(1, kind="sin"), power(1, kind="cos")
    angles: list[Term] = [(sine,), (cosine,), (power(2, kind="sin"),), (cosine, sine)]
    return [(), *powers[:4], *angles, *powers[4:], *roots]


def _product(term: Term, parameters: Array) -> Array:
    values: list[Callable[[Array], Array]] = [factor.value for factor in term]
    with np.errstate(all="ignore"):
        return np.asarray(np.prod([np.ones(len(parameters)), *(value(parameters) for value in values)], axis=0))
