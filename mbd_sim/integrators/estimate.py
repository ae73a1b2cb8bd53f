"""Estimates of a step's error from the slopes that the step has computed anyway, as data."""

from __future__ import annotations

from dataclasses import dataclass

Row = tuple[float, ...]


@dataclass(frozen=True)
class Estimate:
    """F² / √(F² + w C²) with F = |Σ fine k| and C = |Σ coarse k|; F alone where there is no `coarse`.

    |·| is the Euclidean norm over the components, each divided by 1 + |y|. k are h times the slopes of a Runge–Kutta
    method, or the increments of a Rosenbrock method. With F of order hᵖ and C of order hᵠ the estimate is of order
    h²ᵖ⁻ᵠ, and it is F where the step is so large that F has overtaken C (Hairer, Nørsett & Wanner I, sec. II.10, where
    w = 0.01 for DOP853).
    """

    fine: Row
    coarse: Row = ()
    weight: float = 1.0
