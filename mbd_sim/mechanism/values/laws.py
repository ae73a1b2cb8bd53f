"""Force laws of one variable as plain records: a force as a function of an elongation or of a speed."""

from __future__ import annotations

from dataclasses import dataclass

from mbd_sim.mechanism.values.expression import TimeExpression
from mbd_sim.mechanism.values.tables import Piecewise

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
