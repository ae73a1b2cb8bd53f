"""Force laws of one variable as plain records: a force as a function of an elongation or of a speed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbd_sim.mechanism.expression import TimeExpression

ELONGATION, ELONGATION_RATE = "x", "x.velocity"  # the variables in the expression of a spring's force


@dataclass(frozen=True)
class Linear:
    """f = k x, with the potential ½ k x²; `stiffness` k ≥ 0 in N/m or N·m/rad."""

    stiffness: float


@dataclass(frozen=True)
class GreenStrain:
    """A bar with the strain of Green and St. Venant: U = ½ k x² (1 + x / 2l0)² (Lidström, p. 103-105).

    `stiffness` k in N/m, `length` l0 > 0 in m. With the length l = l0 + x it is U = k (l² - l0²)² / 8l0².
    """

    stiffness: float
    length: float


@dataclass(frozen=True)
class Expressed:
    """f(x) as an expression; its potential is the integral from 0, exact between `lower` and `upper`."""

    force: TimeExpression
    lower: float
    upper: float


@dataclass(frozen=True, eq=False)
class Piecewise:
    """f(x) by cubic pieces: the first of `coefficients` (n + 1, 4) is left of all `knots` (n,), the last right of them.

    Piece i is c0 + c1 d + c2 d² + c3 d³ with d = x - `origins[i]`, and `energies[i]` is its potential at d = 0.
    """

    knots: NDArray[np.float64]
    origins: NDArray[np.float64]
    coefficients: NDArray[np.float64]
    energies: NDArray[np.float64]


@dataclass(frozen=True)
class Varying:
    """f as an expression that is not one of x alone, but also of x', the time, or joint coordinates and speeds.

    It has no potential: its power is work of the applied forces, or dissipated, by its sign.
    """

    force: TimeExpression


ElasticLaw = Linear | Expressed | Piecewise


@dataclass(frozen=True)
class PowerLaw:
    """A damper C |v|ᵖ against the speed v (Géradin & Rixen, p. 30): F = C v (v² + ε²)^((p - 1)/2).

    `coefficient` C ≥ 0 in N/(m/s)ᵖ, `exponent` p ≥ 0. The speed ε = `regularization` makes F smooth at rest; at
    p = 1, where F is smooth already, it has no effect.
    """

    coefficient: float
    exponent: float
    regularization: float


@dataclass(frozen=True)
class Friction:
    """Dry friction F = (Fc + (Fs - Fc) exp(-(v/vs)²)) tanh(v/vr) + d v against the speed v, in N or N·m.

    `coulomb` Fc, `static` Fs, `stribeck_velocity` vs (infinite if Fs = Fc), `viscous` d, `regularization` vr > 0.
    If it `sticks`, the speed stays exactly zero up to Fs, and sign(v) stands for tanh(v/vr). With a `coefficient` it
    sticks, and Fc and Fs are that and `static_coefficient` times the force that the joint transmits across its axis;
    those of a hinge include the radius of its bearing, in m.
    """

    coulomb: float
    static: float
    stribeck_velocity: float
    viscous: float
    regularization: float
    sticks: bool = False
    coefficient: float = 0.0
    static_coefficient: float = 0.0

    @property
    def is_plain(self) -> bool:
        """Whether it is viscous friction and regularized Coulomb friction, and nothing else."""
        return not self.sticks and self.static == self.coulomb


def tabulated(elongations: Sequence[float], forces: Sequence[float]) -> Piecewise:
    """A table as a force with a continuous derivative: cubic between its points, linear beyond them.

    The slopes are those of Fritsch and Butland (PCHIP): the force rises and falls only where the table does. The
    potential, zero at x = 0, is the integral of the pieces and therefore exact to rounding.

    :param elongations: (n,) at least two, increasing.
    :param forces: (n,) N or N·m.
    """
    x, f = np.array(elongations, dtype=np.float64), np.array(forces, dtype=np.float64)
    h, slopes = np.diff(x), slopes_of(x, f)
    secants = np.diff(f) / h
    inner = np.column_stack(
        [
            f[:-1],
            slopes[:-1],
            (3.0 * secants - 2.0 * slopes[:-1] - slopes[1:]) / h,
            (slopes[:-1] + slopes[1:] - 2.0 * secants) / h**2,
        ]
    )
    ends = [[f[0], slopes[0], 0.0, 0.0], [f[-1], slopes[-1], 0.0, 0.0]]
    coefficients = np.vstack([ends[0], inner, ends[1]])
    origins = np.concatenate([x[:1], x])
    gains = [_integral(c, width) for c, width in zip(inner, h, strict=True)]
    energies = np.cumsum([0.0, 0.0, *gains])
    piece = int(np.searchsorted(x, 0.0, side="right"))
    at_zero = energies[piece] + _integral(coefficients[piece], -origins[piece])
    return Piecewise(x, origins, coefficients, energies - at_zero)


def _integral(coefficients: NDArray[np.float64], d: float) -> float:
    c0, c1, c2, c3 = (float(c) for c in coefficients)
    return d * (c0 + d * (c1 / 2.0 + d * (c2 / 3.0 + d * c3 / 4.0)))


def slopes_of(x: NDArray[np.float64], f: NDArray[np.float64]) -> NDArray[np.float64]:
    """The derivatives (n,) at the points: weighted harmonic means of the secant slopes, 0 where these change sign."""
    h, secants = np.diff(x), np.diff(f) / np.diff(x)
    if len(x) == 2:
        return np.array([secants[0], secants[0]])
    slopes = np.zeros(len(x))
    for i in range(1, len(x) - 1):
        before, after = secants[i - 1], secants[i]
        if before * after > 0.0:
            left, right = 2.0 * h[i] + h[i - 1], h[i] + 2.0 * h[i - 1]
            slopes[i] = (left + right) / (left / before + right / after)
    slopes[0] = _end_slope(h[0], h[1], secants[0], secants[1])
    slopes[-1] = _end_slope(h[-1], h[-2], secants[-1], secants[-2])
    return slopes


def _end_slope(near: float, far: float, secant: float, next_secant: float) -> float:
    """Three-point formula at an end, limited so that the force stays monotone (Fritsch & Carlson 1980)."""
    slope = ((2.0 * near + far) * secant - near * next_secant) / (near + far)
    if slope * secant <= 0.0:
        return 0.0
    if secant * next_secant <= 0.0 and abs(slope) > 3.0 * abs(secant):
        return 3.0 * secant
    return slope
