"""A ball and a cylinder, or a tube around it, for `compiled.features.barrels`."""

from __future__ import annotations

import math

from mbd_sim.dynamics.contact.barrel_rows import BARREL_SIZE
from mbd_sim.mechanism.elements.contacts import Ball, Barrel
from mbd_sim.simulation.contact.compiled.features.barrels import BallOnBarrel
from mbd_sim.simulation.contact.features.narrow_phase import Bounds, CompiledPhase


class BarrelPair(CompiledPhase):
    """A ball and a cylinder; the ball is `inside` a tube, or on the cylinder: see `NarrowPhase`."""

    def __init__(self, ball: Ball, barrel: Barrel, *, inside: bool) -> None:
        half = 0.5 * barrel.length
        record = BallOnBarrel(
            ball.at.point, ball.radius, barrel.at.point, barrel.axis, barrel.radius, half, inside
        )  # fmt: skip
        reach = math.hypot(barrel.radius, half)
        bounds = Bounds(ball.at.point, ball.radius), Bounds(barrel.at.point, reach)
        super().__init__("barrel", record, bounds, 1, BARREL_SIZE, iterates=False)
