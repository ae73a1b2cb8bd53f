"""Estimates of the error of a step, as coefficients of the slopes that the step computes anyway."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

Coefficients = tuple[float, ...]
# What errors are relative to beside the components of a state: for each, a number and the power of the unit of time by
# which it is divided. Without any, all are 1. The unit of time is that of `UNIT_OF_TIME` steps.
Scales = Sequence[tuple[float, int]]
UNIT_OF_TIME = 1000.0


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


def scale_values(scales: Scales, step: float) -> list[float]:
    """The scales for steps of a size in s."""
    rate = 1.0 / (UNIT_OF_TIME * step)
    return [size * rate**times for size, times in scales]
