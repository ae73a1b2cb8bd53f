"""The outputs of traced functions as matrices of short SymPy expressions.

Each polynomial in sines and cosines has its shortest form: with their powers, or with sines and cosines of sums.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

import casadi as ca
import sympy as sp

from mbd_sim.base.errors import MbdSimError
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.studies.algebra.evaluation import evaluate, expression
from mbd_sim.studies.algebra.polynomial import (
    MAX_OPERATIONS,
    MAX_TERMS,
    MAX_TOTAL_OPERATIONS,
    Algebra,
    Monomial,
    Polynomial,
    TooLargeError,
    too_large,
    without_denominators,
)
from mbd_sim.studies.symbolic.coordinates import SymbolicEnergies

Inputs = Sequence[Sequence[Polynomial]]


def simplified(mechanism: Mechanism, algebra: Algebra, function: ca.Function, inputs: Inputs) -> list[list[list[Any]]]:
    """The outputs of a function of scalars, row by row, as short expressions.

    :raises MbdSimError: they are too long to be read.
    """
    try:
        outputs = evaluate(algebra, function, inputs)
        outputs = [[without_denominators(algebra, p) for p in output] for output in outputs]
    except TooLargeError as error:
        raise too_large(mechanism, str(error)) from error
    longest = max((len(p) for output in outputs for p in output), default=0)
    if longest > MAX_TERMS:
        raise too_large(mechanism, f"one of their entries has {longest} terms")
    matrices, total = [], 0
    for number, values in enumerate(outputs):
        rows, columns = function.size_out(number)
        matrix = [[sp.S.Zero] * columns for _ in range(rows)]
        # Equal entries, as in a symmetric matrix, are simplified once.
        known: dict[frozenset[Any], tuple[Any, int]] = {}
        for row, column, p in _entries(function, number, values):
            key = frozenset(p.items())
            if key not in known:
                entry = shortest(algebra, p)
                known[key] = entry, int(entry.count_ops())
            matrix[row][column], length = known[key]
            total += length
            if length > MAX_OPERATIONS:
                raise too_large(mechanism, f"one of their entries has {length} operations")
            if total > MAX_TOTAL_OPERATIONS:
                raise too_large(mechanism, f"their entries have more than {MAX_TOTAL_OPERATIONS} operations")
        matrices.append(matrix)
    return matrices


def energies_if_short(
    mechanism: Mechanism, algebra: Algebra, function: ca.Function, inputs: Inputs
) -> SymbolicEnergies | None:
    """The energies, see `energy_function`; None if they are too long to be read."""
    try:
        return SymbolicEnergies(*(matrix[0][0] for matrix in simplified(mechanism, algebra, function, inputs)))
    except MbdSimError:
        return None


def _entries(function: ca.Function, output: int, values: Sequence[Polynomial]) -> list[tuple[int, int, Polynomial]]:
    """The row, column and value of each nonzero entry of an output."""
    rows, columns = function.sparsity_out(output).get_triplet()
    return list(zip(rows, columns, values, strict=True))


Harmonic = tuple[str, tuple[tuple[int, int], ...]]  # sin or cos of a sum of multiples: (argument, factor)
LONG = 10**6  # numerators and denominators from this on are too long to be factored out
MULTIPLE = 2.0  # the cost of a multiple angle in operations: sin q cos q reads better than ½ sin 2q


def shortest(algebra: Algebra, p: Polynomial) -> Any:
    """A SymPy expression of a polynomial: a sum of terms without sines and cosines, each times its shortest factor."""
    groups: dict[Monomial, Polynomial] = {}
    for monomial, value in p.items():
        rest = tuple(item for item in monomial if item[0] not in algebra.angles or item[1] < 0)
        angles = tuple(item for item in monomial if item[0] in algebra.angles and item[1] > 0)
        groups.setdefault(rest, {})[angles] = value
    # Terms with the same factor, roots and denominators are joined.
    joined: dict[tuple[Any, Monomial], list[Any]] = {}
    for rest, trigonometric in groups.items():
        factor = _shortest_factor(algebra, trigonometric)
        content, primitive = factor.as_content_primitive()
        content, factor = (content, primitive) if _simple(content) else (sp.Integer(1), factor)
        if factor.could_extract_minus_sign():
            content, factor = -content, -factor
        outer = tuple((n, exponent) for n, exponent in rest if exponent < 0 or not algebra.expressions[n].is_Symbol)
        joined.setdefault((factor, outer), []).append(content * expression(algebra, {rest: Fraction(1)}))
    return sp.Add(*(_joined(factor, outer, parts) for (factor, outer), parts in joined.items()))


def _joined(factor: Any, outer: Monomial, parts: list[Any]) -> Any:
    total = sp.Add(*parts)
    if len(parts) > 1 and (factor != 1 or outer):
        factored = sp.factor(total)
        total = factored if _simple(factored.as_coeff_Mul()[0]) else total
    # x/|x| is the sign of x
    total = total.replace(
        lambda e: e.is_Pow and isinstance(e.base, sp.Abs) and e.exp.is_Integer and e.exp.is_negative,
        lambda e: (sp.sign(e.base.args[0]) / e.base.args[0]) ** (-e.exp),
    )
    return factor * total


def _simple(number: Any) -> bool:
    """Whether a number may be factored out: a common divisor of long decimals may not."""
    return bool(abs(number.p) < LONG and number.q < LONG)


def _shortest_factor(algebra: Algebra, p: Polynomial) -> Any:
    candidates = [
        expression(algebra, p),
        expression(algebra, _in_sines(algebra, p)),
        _written(algebra, _harmonics(algebra, p)),
    ]
    factored = (sp.factor_terms(candidate) for candidate in candidates[:2])
    candidates += [candidate for candidate in factored if _simple(candidate.as_coeff_Mul()[0])]
    return min(candidates, key=_cost)


def _cost(candidate: Any) -> float:
    multiples = 0
    for function in candidate.atoms(sp.sin, sp.cos):
        multiples += sum(abs(term.as_coeff_Mul()[0]) not in (0, 1) for term in sp.Add.make_args(function.args[0]))
    return float(candidate.count_ops()) + MULTIPLE * multiples


def _in_sines(algebra: Algebra, p: Polynomial) -> Polynomial:
    """Replace squares of cosines in a polynomial, rather than squares of sines."""
    sines = {argument: number for number, (kind, argument) in algebra.angles.items() if kind == "sin"}
    total: Polynomial = {}
    for monomial, value in p.items():
        terms: Polynomial = {(): value}
        for number, exponent in monomial:
            kind, argument = algebra.angles[number]
            if kind == "cos" and exponent >= 2:
                square: Polynomial = {(): Fraction(1), ((sines[argument], 2),): Fraction(-1)}
                for _ in range(exponent // 2):
                    terms = _times(terms, square)
                exponent %= 2
            if exponent:
                terms = _times(terms, {((number, exponent),): Fraction(1)})
        for key, part in terms.items():
            total[key] = total.get(key, Fraction(0)) + part
    return {key: value for key, value in total.items() if value}


def _times(p: Polynomial, q: Polynomial) -> Polynomial:
    """The product without reduction."""
    total: Polynomial = {}
    for first, a in p.items():
        for second, b in q.items():
            exponents = dict(first)
            for number, exponent in second:
                exponents[number] = exponents.get(number, 0) + exponent
            key = tuple(sorted(exponents.items()))
            total[key] = total.get(key, Fraction(0)) + a * b
    return total


def _harmonics(algebra: Algebra, p: Polynomial) -> Mapping[Harmonic, Fraction]:
    """Write a polynomial as a sum of sines and cosines of sums of angles."""
    total: dict[Harmonic, Fraction] = {}
    for monomial, value in p.items():
        terms: dict[Harmonic, Fraction] = {("cos", ()): value}
        for number, exponent in monomial:
            kind, argument = algebra.angles[number]
            for _ in range(exponent):
                terms = _multiplied(terms, (kind, ((argument, 1),)))
        for harmonic, part in terms.items():
            total[harmonic] = total.get(harmonic, Fraction(0)) + part
    return {harmonic: value for harmonic, value in total.items() if value}


def _multiplied(terms: Mapping[Harmonic, Fraction], by: Harmonic) -> dict[Harmonic, Fraction]:
    total: dict[Harmonic, Fraction] = {}
    for (kind, first), value in terms.items():
        for sign in (1, -1):
            # With a = first and b = by: of a + b, then of a - b.
            angle = _sum(first, by[1], sign)
            same = kind == by[0]
            # cos a sin b contains -sin(a - b)/2, and sin a sin b contains -cos(a + b)/2.
            minus = by[0] == "sin" and sign == (1 if same else -1)
            factor = Fraction(-1 if minus else 1, 2)
            name, turn = _oriented("cos" if same else "sin", angle)
            if turn:
                total[name] = total.get(name, Fraction(0)) + turn * factor * value
    return {harmonic: value for harmonic, value in total.items() if value}


def _sum(a: tuple[tuple[int, int], ...], b: tuple[tuple[int, int], ...], sign: int) -> tuple[tuple[int, int], ...]:
    factors = dict(a)
    for argument, factor in b:
        factors[argument] = factors.get(argument, 0) + sign * factor
    return tuple(sorted(item for item in factors.items() if item[1]))


def _oriented(kind: str, angle: tuple[tuple[int, int], ...]) -> tuple[Harmonic, int]:
    """The harmonic with a positive first factor, and its sign; the sign of sin 0 is 0."""
    if not angle:
        return ("cos", ()), int(kind == "cos")
    if angle[0][1] > 0:
        return (kind, angle), 1
    return (kind, tuple((argument, -factor) for argument, factor in angle)), 1 if kind == "cos" else -1


def _written(algebra: Algebra, harmonics: Mapping[Harmonic, Fraction]) -> Any:
    functions = {"sin": sp.sin, "cos": sp.cos}
    return sp.Add(
        *(
            sp.Rational(value) * functions[kind](sp.Add(*(factor * algebra.arguments[a] for a, factor in angle)))
            for (kind, angle), value in harmonics.items()
        )
    )
