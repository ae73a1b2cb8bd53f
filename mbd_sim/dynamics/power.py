"""How the power of forces that are given by expressions is counted in the energy audit."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from mbd_sim.mechanism.expression import TIME, TimeExpression


class PowerSplit:
    """Adds up powers in W as `applied` and as `dissipated`.

    A force that depends on nothing but the time comes from outside: all of its work is applied, with its sign. A force
    that depends on the motion is part of the mechanism. At each instant its power is applied where it is positive, and
    dissipated where it is negative. The difference of the two is the power itself, so that the audit closes as exactly
    as without the split.
    """

    def __init__(self) -> None:
        self.applied, self.dissipated = ca.SX(1, 1), ca.SX(1, 1)

    def add(self, expressions: Sequence[TimeExpression], power: ca.SX) -> None:
        """Add the power of one force, which these expressions give."""
        if any(expression.variables - {TIME} for expression in expressions):
            self.applied += ca.fmax(power, 0.0)
            self.dissipated += ca.fmax(-power, 0.0)
        else:
            self.applied += power
