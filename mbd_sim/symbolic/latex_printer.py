"""SymPy expressions as LaTeX, with numbers in their usual form."""

from __future__ import annotations

from functools import cache
from typing import Any

DIGITS = 6
_ESCAPES = str.maketrans(
    {character: f"\\{character}" for character in "_%#$&{}"}
    | {"^": r"\textasciicircum{}", "~": r"\textasciitilde{}", "\\": r"\textbackslash{}"}
    | {"²": "$^2$", "³": "$^3$", "·": r"$\cdot$", "°": r"$^{\circ}$"}
)
LARGEST_DENOMINATOR = 100  # of a number written as a fraction


def write(expression: Any, names: dict[Any, str]) -> str:
    """The LaTeX of an expression; `names` has the LaTeX of each symbol."""
    return str(_printer()({"symbol_names": names, "fold_func_brackets": True}).doprint(expression))


def escaped(name: str) -> str:
    """A name with underscores escaped for LaTeX."""
    return name.replace("_", r"\_")


def plain(text: str) -> str:
    """Text of a file with the characters escaped that mean something to LaTeX."""
    return text.translate(_ESCAPES)


def number(numerator: int, denominator: int) -> str:
    """A fraction if it is simple and has no short decimal form, else six digits."""
    if denominator == 1 and abs(numerator) < 10**DIGITS:
        return str(numerator)
    rest = denominator
    for prime in (2, 5):
        while rest % prime == 0:
            rest //= prime
    simple = denominator in (2, 4) or rest > 1
    if simple and denominator <= LARGEST_DENOMINATOR and abs(numerator) <= 10 * LARGEST_DENOMINATOR:
        sign = "-" if numerator < 0 else ""
        return rf"{sign}\tfrac{{{abs(numerator)}}}{{{denominator}}}"
    text = f"{numerator / denominator:.{DIGITS}g}"
    mantissa, _, exponent = text.partition("e")
    return rf"{mantissa} \cdot 10^{{{int(exponent)}}}" if exponent else mantissa


@cache
def _printer() -> Any:
    """The printer class; defined here, so that SymPy is imported only when it is needed."""
    from sympy import fraction
    from sympy.printing.latex import LatexPrinter
    from sympy.printing.precedence import PRECEDENCE

    class Printer(LatexPrinter):  # type: ignore[misc]
        def _print_Rational(self, expr: Any) -> str:  # noqa: N802
            return number(int(expr.p), int(expr.q))

        _print_Integer = _print_Rational  # noqa: N815
        _print_Half = _print_Rational  # noqa: N815

        def _print_Mul(self, expr: Any) -> str:  # noqa: N802
            factor, rest = expr.as_coeff_Mul()
            if not factor.is_Rational or factor == 1:
                return str(super()._print_Mul(expr))
            numerator, denominator = fraction(rest)
            if numerator == 1 and denominator != 1:
                sign = "- " if factor.is_negative else ""
                return rf"{sign}\frac{{{self._print(abs(factor))}}}{{{self._print(denominator)}}}"
            written = super()._print_Mul(rest) if rest.is_Mul else self.parenthesize(rest, PRECEDENCE["Mul"])
            if factor == -1:
                return f"- {written}"
            return f"{self._print(factor)}\\, {written}"

        def _print_Add(self, expr: Any, order: Any = None) -> str:  # noqa: N802
            terms = sorted(self._as_ordered_terms(expr, order=order), key=lambda term: not term.is_number)
            terms.sort(key=lambda term: bool(term.as_coeff_Mul()[0].is_negative))
            text = ""
            for index, term in enumerate(terms):
                negative = bool(term.as_coeff_Mul()[0].is_negative)
                if index:
                    text += " - " if negative else " + "
                    term = -term if negative else term
                text += self._print(term)
            return text

    return Printer
