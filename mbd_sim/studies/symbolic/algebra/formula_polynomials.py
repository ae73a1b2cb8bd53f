"""Formulas of numbers as polynomials in the symbols of the parameters."""

from __future__ import annotations

from fractions import Fraction

import sympy as sp

from mbd_sim.studies.symbolic.algebra.evaluation import exact_polynomial, expression, root, sine_cosine
from mbd_sim.studies.symbolic.algebra.formulas import Factor, Formula
from mbd_sim.studies.symbolic.algebra.polynomial import Algebra, Polynomial
from mbd_sim.studies.symbolic.algebra.samples import SymbolicValues


def polynomials(algebra: Algebra, values: SymbolicValues) -> list[Polynomial]:
    """The polynomial of each number; positive parameters are made known to the algebra."""
    symbols = [parameter.symbol for parameter in values.symbols]
    algebra.positive |= {algebra.generator(symbol) for symbol in symbols if symbol.is_positive}
    return [_polynomial(algebra, formula, symbols) for formula in values.formulas]


def _polynomial(algebra: Algebra, formula: Formula, symbols: list[sp.Symbol]) -> Polynomial:
    total: Polynomial = {}
    for coefficient, term in formula.terms:
        product = exact_polynomial(algebra, coefficient)
        for factor in term:
            product = algebra.multiply(product, _factor(algebra, factor, symbols[factor.parameter]))
        total = algebra.add(total, product)
    return algebra.scaled(root(algebra, total), formula.root) if formula.root else total


def _factor(algebra: Algebra, factor: Factor, symbol: sp.Symbol) -> Polynomial:
    base = algebra.symbol(symbol)
    if factor.kind != "power":
        base = sine_cosine(algebra, base)[0 if factor.kind == "sin" else 1]
    exponent = factor.exponent
    if exponent.denominator == 2:
        base, exponent = root(algebra, base), Fraction(exponent.numerator)
    if exponent < 0:
        base = algebra.inverse(base, lambda p: expression(algebra, p))
    return algebra.power(base, abs(int(exponent)))
