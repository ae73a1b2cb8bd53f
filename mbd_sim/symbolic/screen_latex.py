"""Equations as LaTeX for a screen: one formula, whose lines fit on the page of a notebook."""

from __future__ import annotations

import re
from collections.abc import Iterator

from mbd_sim.symbolic.latex import to_latex
from mbd_sim.symbolic.symbolic_equations import SymbolicEquations

WIDEST = 48.0  # of a line, in digits; about 700 px in a browser of the usual size

_BLOCK = re.compile(r"\\begin\{align\*\}(.*?)\\end\{align\*\}", re.DOTALL)
_TOKEN = re.compile(r"\\\\|\\[a-zA-Z]+\*?|\\.|\s+|.", re.DOTALL)
_OPENING, _CLOSING = ("{", r"\left", r"\begin"), ("}", r"\right", r"\end")
_BREAKS = ("+", "-", "=", "<", ">", r"\leq", r"\geq", r"\perp", r"\in")
_CONTINUED = re.compile(r"&\s*(?:=|\\quad \{\})")
_FRACTION = re.compile(r"\\[td]?frac\{([^{}]*)\}\{([^{}]*)\}")
_INDEX = re.compile(r"[_^](?:\{((?:[^{}]|\{[^{}]*\})*)\}|(\w))")
_SMALL = 0.7  # size of indices, exponents and fractions relative to the line's
_WITHOUT_WIDTH = re.compile(r"\\(?:left|right|mathrm|dot|ddot|displaystyle|quad|:|,)(?![a-z])|[{}\s&]")
_FUNCTION, _SYMBOL = re.compile(r"\\(sin|cos|tan|tanh|min|max|log|exp)\b"), re.compile(r"\\[a-zA-Z]+")


def screen_latex(equations: SymbolicEquations) -> str:
    """The equations of motion and the constraints as one formula for MathJax."""
    blocks = _BLOCK.findall(to_latex(equations).split("In matrix form")[0])
    aligned = (r" \\ ".join(line for row in equations_of(block) for line in lines(row)) for block in blocks)
    return (
        "$\\displaystyle \\begin{aligned}" + r" \\[1.5ex] ".join(aligned) + "\\end{aligned}$"
    )  # lines of all blocks begin at the same place


def equations_of(block: str) -> list[str]:
    """The equations of an `align` environment without their alignment."""
    rows = list[str]()
    for line in _divided(block, (r"\\",)):
        text = line.removeprefix(r"\\").strip()
        if _CONTINUED.match(text) and rows:
            rows[-1] += " " + _CONTINUED.sub(lambda match: "=" if match[0].endswith("=") else "", text, count=1)
        elif text:
            rows.append(text)
    return [" ".join("".join(piece.removeprefix("&") for piece in _divided(row, ("&",))).split()) for row in rows]


def lines(equation: str) -> Iterator[str]:
    """The lines of an equation, which is broken at relations and signs where it is too wide."""
    line, indent = "", ""
    for piece in (piece.strip() for piece in _divided(equation, _BREAKS)):
        if line.strip() and width(f"{line} {piece}") > WIDEST:
            yield f"& {indent}{line.strip()}"
            line, indent = "", r"\qquad {} "
        line = f"{line} {piece}"
    yield f"& {indent}{line.strip()}"


def width(latex: str) -> float:
    """About the printed width of a formula, in digits."""
    fractions = sum(_SMALL * max(map(width, match.groups())) for match in _FRACTION.finditer(latex))
    latex = _FRACTION.sub("", latex)
    indices = sum(_SMALL * width(match[1] or match[2]) for match in _INDEX.finditer(latex))
    latex = _SYMBOL.sub("x", _FUNCTION.sub(r"\1", _WITHOUT_WIDTH.sub("", _INDEX.sub("", latex))))
    return fractions + indices + len(latex) + 0.7 * sum(latex.count(sign) for sign in "+-=<>")


def _divided(latex: str, separators: tuple[str, ...]) -> Iterator[str]:
    """A formula divided before the separators that are in no brackets."""
    depth, piece, previous = 0, "", " "
    for match in _TOKEN.finditer(latex):
        token = match[0]
        depth += (token in _OPENING) - (token in _CLOSING)
        if depth == 0 and token in separators and (previous.isspace() or token in (r"\\", "&")):
            yield piece
            piece = ""
        piece, previous = piece + token, token
    yield piece
