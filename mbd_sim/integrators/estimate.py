"""Estimates of the error of a step, as coefficients of the slopes that the step computes anyway."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mbd_sim.short_repr import short_repr

Coefficients = tuple[float, ...]
Scales = Sequence[float]  # s of each component of a state y: errors are relative to s + |y|. Without any, they are 1


@dataclass(frozen=True)
class ErrorEstimate:
    """F² / √(F² + w C²) with F = |Σ fine k| and C = |Σ coarse k|, or F alone without `coarse`; w is `weight`.

    |·| is the Euclidean norm over the components of the state, each divided by s + |y| with its scale s. k are h times
    the slopes of a Runge–Kutta method, or the increments of a Rosenbrock method. With F of order hᵖ and C of order hᵠ
    the estimate is of order h²ᵖ⁻ᵠ. It is F if the step is so large that F exceeds C (Hairer, Nørsett & Wanner I, sec.
    II.10, where w = 0.01 for DOP853).
    """

    fine: Coefficients
    coarse: Coefficients = ()
    weight: float = 1.0

    __repr__ = short_repr
