"""Names of a file and SymPy expressions as LaTeX, with numbers in their usual form.

The name `theta_1` becomes θ with the subscript 1, and `m_rod` becomes m with the subscript rod.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache
from typing import Any

from mbd_sim.mechanism.values.names import split_key

DIGITS = 6
_ESCAPES = str.maketrans(
    {character: f"\\{character}" for character in "_%#$&{}"}
    | {"^": r"\textasciicircum{}", "~": r"\textasciitilde{}", "\\": r"\textbackslash{}"}
    | {"²": "$^2$", "³": "$^3$", "·": r"$\cdot$", "°": r"$^{\circ}$"}
)
MOST_DIGITS = 8  # of a decimal that is written as it is
# Of numbers written as fractions:
LARGEST_DENOMINATOR = 100
LARGEST_NUMERATOR = 1000
LARGEST_PRODUCT = 10_000  # of numerator and denominator, where the latter is larger


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
    """A rational number, exact where that is short: an integer, a decimal or a fraction, perhaps with a power of ten.

    Otherwise it is rounded to six digits.
    """
    return exact_number(numerator, denominator) or _decimal(f"{numerator / denominator:.{DIGITS}g}")


def exact_number(numerator: int, denominator: int) -> str:
    """A rational number with all of its digits, or "" where these are many.

    A number with a factor of five in its denominator is written as the decimal that it most likely was in a file, as
    0.05, if it has an end; others are fractions, as 1/8.
    """
    if denominator == 1 and abs(numerator) < 10**DIGITS:
        return str(numerator)
    rest, power = _without_tens(denominator)
    is_decimal = rest == 1 and denominator % 5 == 0
    small = abs(numerator) <= LARGEST_NUMERATOR and denominator <= LARGEST_DENOMINATOR
    short = abs(numerator) * denominator <= LARGEST_PRODUCT and denominator <= LARGEST_NUMERATOR
    if denominator > 1 and not is_decimal and (small or short):
        return _fraction(numerator, denominator)
    whole = str(numerator * 10**power // (denominator // rest))
    shown = whole.rstrip("0")
    if rest == 1 and len(shown.lstrip("-")) <= MOST_DIGITS:
        return _decimal(f"{numerator / denominator:.{MOST_DIGITS}g}")
    if rest > 1 and abs(int(shown)) <= LARGEST_DENOMINATOR >= rest:
        return rf"{_fraction(int(shown), rest)} \cdot 10^{{{len(whole) - len(shown) - power}}}"
    return ""


def _fraction(numerator: int, denominator: int) -> str:
    return rf"{'-' if numerator < 0 else ''}\tfrac{{{abs(numerator)}}}{{{denominator}}}"


def _decimal(text: str) -> str:
    mantissa, _, exponent = text.partition("e")
    if not exponent:
        return mantissa
    power = f"10^{{{int(exponent)}}}"
    return power if mantissa == "1" else rf"{mantissa} \cdot {power}"


def _without_tens(denominator: int) -> tuple[int, int]:
    """A denominator without its factors 2 and 5, and the power of ten that they divide."""
    counts = []
    for prime in (2, 5):
        count = 0
        while denominator % prime == 0:
            denominator, count = denominator // prime, count + 1
        counts.append(count)
    return denominator, max(counts)


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

        def _print_Abs(self, expr: Any, exp: Any = None) -> str:  # noqa: N802
            size = rf"\left|{self._print(expr.args[0])}\right|"
            return size if exp is None else f"{size}^{{{exp}}}"

        def _print_sign(self, expr: Any, exp: Any = None) -> str:
            power = "" if exp is None else f"^{{{exp}}}"
            return rf"\operatorname{{sign}}{power}\left({self._print(expr.args[0])}\right)"

    return Printer


_SMALL = """
alpha beta gamma delta epsilon zeta eta theta iota kappa lambda mu nu xi pi rho sigma tau upsilon phi chi psi omega
"""
_LARGE = "Gamma Delta Theta Lambda Xi Pi Sigma Upsilon Phi Psi Omega"
GREEK = frozenset(_SMALL.split()) | frozenset(_LARGE.split())
LETTERS = {"mass": "m", "length": "l", "radius": "r", "stiffness": "k", "damping": "c"}  # of values at keys
_STEM = re.compile(r"([A-Za-z]+?)(\d*)")


def symbol_latex(name: str) -> str:
    """The LaTeX of a parameter.

    Greek letters are recognized by their names. One letter stays a letter, and what follows it, digits or one more
    letter, is its subscript, as is everything after an underscore: `l1`, `mc`, `r_a`. Longer words are set as
    operators are.
    """
    stem, subscripts = _split(name)
    return stem if not subscripts else f"{stem}_{{{','.join(subscripts)}}}"


def key_name(key: str) -> tuple[str, str]:
    """The name of a number of a file and its LaTeX: of `parts.rod.mass`, m with the subscript rod."""
    _, *owner, last = map(str, split_key(key))
    steps = [step for step in owner if step not in ("shape", "shapes")]
    if last in LETTERS and steps:
        subscript = ",".join(rf"\mathrm{{{escaped(step)}}}" for step in steps)
        return "_".join([LETTERS[last], *steps]), f"{LETTERS[last]}_{{{subscript}}}"
    plain = "_".join([*steps, last])
    return plain, rf"\operatorname{{{escaped(plain)}}}"


def greek_name(name: str) -> tuple[str, str] | None:
    """A Greek letter and its subscript as LaTeX, if a name is such a letter, perhaps with a subscript."""
    stem, subscripts = _split(name)
    return (stem, ",".join(subscripts)) if stem[1:] in GREEK else None


def _split(name: str) -> tuple[str, list[str]]:
    first, *rest = name.split("_")
    subscripts = [_subscript(part) for part in rest if part]
    found = _STEM.fullmatch(first)
    if found is None:
        return rf"\operatorname{{{escaped(name)}}}", []
    word, digits = found.groups()
    if digits:
        subscripts.insert(0, digits)
    if word in GREEK:
        return rf"\{word}", subscripts
    if len(word) == 2 and not digits:
        return word[0], [rf"\mathrm{{{word[1]}}}", *subscripts]
    return (word if len(word) == 1 else rf"\operatorname{{{word}}}"), subscripts


def _subscript(part: str) -> str:
    if part.isdigit():
        return part
    return rf"\{part}" if part in GREEK else rf"\mathrm{{{part}}}"


ROUNDED = 1000  # characters that a rounded number counts as


def shortest_numbers(forms: Sequence[Any]) -> Any:
    """Of equal expressions, the one whose numbers are shortest when they are written; the first of several.

    For each, the form with factors whose leading coefficients are 1 is considered as well: 2 (l² m + 0.01) in place of
    0.02 (100 l² m + 1).
    """
    candidates = [form for given in forms for form in (given, _with_leading_ones(given))]
    return min(candidates, key=_size)


def _with_leading_ones(expression: Any) -> Any:
    import sympy as sp

    number, factors = sp.S.One, []
    for factor in sp.Mul.make_args(expression):
        base, exponent = factor.as_base_exp()
        if base.is_Add and exponent.is_Integer:
            lead = max(base.args, key=lambda term: (term.as_coeff_Mul()[1].count_ops(), sp.default_sort_key(term)))
            coefficient = lead.as_coeff_Mul()[0]
            number *= coefficient**exponent
            factor = sp.Add(*(term / coefficient for term in base.args)) ** exponent
        factors.append(factor)
    return sp.Mul(number, *factors, evaluate=False) if number != 1 else sp.Mul(*factors)


def _size(expression: Any) -> int:
    """The characters of all numbers, and of what is repeated in sums."""
    import sympy as sp

    total = 0
    for node in sp.preorder_traversal(expression):
        if node.is_Rational and abs(node) != 1:
            total += len(exact_number(int(node.p), int(node.q)).removeprefix(r"\tfrac")) or ROUNDED
    return total + int(expression.count_ops())
