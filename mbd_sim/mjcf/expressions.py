"""Texts of expressions of a mechanism file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mbd_sim.mechanism.names import in_expression


def signed(value: float) -> str:
    """A number that may stand after an operator."""
    return f"({value!r})" if value < 0.0 else f"{value!r}"


def polynomial(coefficients: Sequence[float], x: str) -> str:
    """The sum c₀ + c₁ x + c₂ x² and so on."""
    powers = ("", f"*{x}", *(f"*{x}**{power}" for power in range(2, len(coefficients))))
    return " + ".join(signed(c) + power for c, power in zip(coefficients, powers, strict=False) if c) or "0"


def odd_polynomial(coefficients: Sequence[float], v: str) -> str:
    """c₁ v + c₂ v |v| + c₃ v³."""
    powers = (v, f"{v}*abs({v})", f"{v}**3")
    return " + ".join(f"{signed(c)}*{power}" for c, power in zip(coefficients, powers, strict=False) if c) or "0"


def weighted_sum(terms: Mapping[str, float], quantity: str) -> str:
    """Σ c q or Σ c q' of coordinates by name."""
    return " + ".join(f"{signed(factor)}*{in_expression(name)}.{quantity}" for name, factor in terms.items())
