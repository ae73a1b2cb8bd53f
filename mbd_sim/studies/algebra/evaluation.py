"""CasADi functions, and formulas of numbers, evaluated over exact polynomials in place of numbers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import partial
from typing import Any

import casadi as ca
import sympy as sp

from mbd_sim.base.errors import MbdSimError
from mbd_sim.studies.algebra.formulas import Factor, Formula
from mbd_sim.studies.algebra.polynomial import Algebra, Exact, Polynomial, exact, in_sympy
from mbd_sim.studies.algebra.samples import SymbolicValues

MAX_FACTORED = 12  # terms under a square root up to which it is factored
ONE: Polynomial = {(): Fraction(1)}

# Operations that do not give polynomials, as SymPy functions.
_FUNCTIONS: dict[int, Callable[..., Any]] = {
    ca.OP_EXP: sp.exp,
    ca.OP_LOG: sp.log,
    ca.OP_ASIN: sp.asin,
    ca.OP_ACOS: sp.acos,
    ca.OP_ATAN: sp.atan,
    ca.OP_ATAN2: sp.atan2,
    ca.OP_SINH: sp.sinh,
    ca.OP_COSH: sp.cosh,
    ca.OP_TANH: sp.tanh,
    ca.OP_SIGN: sp.sign,
    ca.OP_FLOOR: sp.floor,
    ca.OP_POW: sp.Pow,
    ca.OP_CONSTPOW: sp.Pow,
    ca.OP_FMIN: sp.Min,
    ca.OP_FMAX: sp.Max,
    ca.OP_LT: lambda a, b: _truth(sp.Lt(a, b)),
    ca.OP_LE: lambda a, b: _truth(sp.Le(a, b)),
    ca.OP_EQ: lambda a, b: _truth(sp.Eq(a, b)),
    ca.OP_NE: lambda a, b: _truth(sp.Ne(a, b)),
    ca.OP_NOT: lambda a: _truth(sp.Eq(a, 0)),
    ca.OP_AND: lambda a, b: _truth(sp.And(sp.Ne(a, 0), sp.Ne(b, 0))),
    ca.OP_OR: lambda a, b: _truth(sp.Or(sp.Ne(a, 0), sp.Ne(b, 0))),
}


def evaluate(algebra: Algebra, function: ca.Function, inputs: Sequence[Sequence[Polynomial]]) -> list[list[Polynomial]]:
    """The outputs of a function of scalars, each one column by column, for inputs that are polynomials.

    :raises TooLargeError: a polynomial becomes too long to be read.
    :raises MbdSimError: the function has an operation without a formula.
    """
    work: list[Polynomial] = [{}] * function.sz_w()
    outputs: list[list[Polynomial]] = [[{}] * function.nnz_out(index) for index in range(function.n_out())]
    for index in range(function.n_instructions()):
        operation = function.instruction_id(index)
        target, source = function.instruction_output(index), function.instruction_input(index)
        if operation == ca.OP_INPUT:
            work[target[0]] = inputs[source[0]][source[1]]
        elif operation == ca.OP_OUTPUT:
            outputs[target[0]][target[1]] = work[source[0]]
        elif operation == ca.OP_CONST:
            work[target[0]] = constant(algebra, function.instruction_constant(index))
        else:
            work[target[0]] = _apply(algebra, operation, [work[index] for index in source])
    return outputs


def constant(algebra: Algebra, value: float) -> Polynomial:
    """The exact number for which a floating-point number stands, see `exact`."""
    return exact_polynomial(algebra, exact(value)) if value else {}


def exact_polynomial(algebra: Algebra, number: Exact) -> Polynomial:
    """An exact number as a polynomial."""
    result: Polynomial = {(): number.ratio}
    if number.radicand != 1:
        root = algebra.root(sp.sqrt(number.radicand), {(): Fraction(number.radicand)})
        result = algebra.multiply(result, root)
    if number.pi:
        pi = algebra.symbol(sp.pi)
        result = algebra.multiply(result, pi if number.pi > 0 else algebra.inverse(pi, lambda _: None))
    return result


def exact_expression(value: float) -> Any:
    """The exact number for which a floating-point number stands, in SymPy."""
    return in_sympy(exact(value))


def expression(algebra: Algebra, p: Polynomial) -> Any:
    """A polynomial as a SymPy expression."""
    terms = []
    for monomial, value in p.items():
        factors = _factors({algebra.expressions[number]: exponent for number, exponent in monomial})
        terms.append(sp.Mul(sp.Rational(value), *factors))
    return sp.Add(*terms)


def _factors(exponents: dict[Any, int]) -> list[Any]:
    """The factors of a product, with x in place of |x| sign x."""
    for sign in [each for each in exponents if isinstance(each, sp.sign)]:
        x, size = sign.args[0], sp.Abs(sign.args[0])
        if exponents[sign] == exponents.get(size) == 1:
            exponents = {each: exponent for each, exponent in exponents.items() if each not in (sign, size)}
            exponents[x] = exponents.get(x, 0) + 1
    return [sp.Pow(base, exponent) for base, exponent in exponents.items()]


def _apply(algebra: Algebra, operation: int, values: list[Polynomial]) -> Polynomial:
    written = partial(expression, algebra)

    match operation, values:
        case ca.OP_ASSIGN, [x, *_]:
            return x
        case ca.OP_NEG, [x, *_]:
            return algebra.scaled(x, -1)
        case ca.OP_TWICE, [x, *_]:
            return algebra.scaled(x, 2)
        case ca.OP_SQ, [x, *_]:
            return algebra.multiply(x, x)
        case ca.OP_INV, [x, *_]:
            return algebra.inverse(x, written)
        case ca.OP_SQRT, [x, *_]:
            return root(algebra, x)
        case ca.OP_FABS, [x, *_]:
            return algebra.root(sp.Abs(written(x)), algebra.multiply(x, x)) if x else {}
        case ((ca.OP_SIN | ca.OP_COS | ca.OP_TAN), [x, *_]):
            sine, cosine = sine_cosine(algebra, x)
            if operation == ca.OP_TAN:
                return algebra.multiply(sine, algebra.inverse(cosine, written))
            return sine if operation == ca.OP_SIN else cosine
        case ca.OP_ADD, [x, y]:
            return algebra.add(x, y)
        case ca.OP_SUB, [x, y]:
            return algebra.add(x, y, -1)
        case ca.OP_MUL, [x, y]:
            return algebra.multiply(x, y)
        case ca.OP_DIV, [x, y]:
            return algebra.multiply(x, algebra.inverse(y, written)) if x else {}
        case ca.OP_IF_ELSE_ZERO, [x, y]:
            return algebra.multiply(x, y)  # conditions are 0 or 1
        case ((ca.OP_POW | ca.OP_CONSTPOW), [x, y]) if _whole(y) is not None:
            exponent = _whole(y) or 0
            base = x if exponent >= 0 else algebra.inverse(x, written)
            return algebra.power(base, abs(exponent))
    if operation not in _FUNCTIONS:
        raise MbdSimError(f"CasADi's operation {operation} has no formula", "Report it with the mechanism file.")
    result = _FUNCTIONS[operation](*(written(value) for value in values))
    if result.is_Rational:
        return {(): Fraction(int(result.p), int(result.q))} if result else {}
    return algebra.symbol(result)


def root(algebra: Algebra, x: Polynomial) -> Polynomial:
    """The square root of a polynomial."""
    if set(x) <= {()}:
        return constant(algebra, float(x.get((), Fraction(0))) ** 0.5)
    if len(x) == 1:
        ((monomial, value),) = x.items()
        if value > 0 and all(number in algebra.positive and exponent % 2 == 0 for number, exponent in monomial):
            half = {tuple((number, exponent // 2) for number, exponent in monomial): Fraction(1)}
            return algebra.multiply(constant(algebra, float(value) ** 0.5), half)
    square = expression(algebra, x)
    return algebra.root(sp.sqrt(sp.factor(square) if len(x) <= MAX_FACTORED else square), x)


def sine_cosine(algebra: Algebra, x: Polynomial) -> tuple[Polynomial, Polynomial]:
    """The sine and the cosine of a polynomial."""
    if not x:
        return {}, dict(ONE)
    argument = expression(algebra, x)
    if argument.could_extract_minus_sign():
        sine, cosine = sine_cosine(algebra, algebra.scaled(x, -1))
        return algebra.scaled(sine, -1), cosine
    return algebra.sine_cosine(argument, sp.sin(argument, evaluate=False), sp.cos(argument, evaluate=False))


def _whole(x: Polynomial) -> int | None:
    """The value of a polynomial that is a small integer, else None."""
    if set(x) <= {()} and (value := x.get((), Fraction(0))).denominator == 1 and abs(value) <= 6:
        return int(value)
    return None


def _truth(condition: Any) -> Any:
    return sp.Piecewise((sp.Integer(1), condition), (sp.Integer(0), True))


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
