"""Names of a file as LaTeX: `theta_1` as θ with the subscript 1, `m_rod` as m with the subscript rod."""

from __future__ import annotations

import re

from mbd_sim.mechanism.names import split_key
from mbd_sim.symbolic.latex_printer import escaped

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
