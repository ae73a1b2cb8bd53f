"""The gap of a ball and a cylinder, or a tube around it: what of it touches the ball is among the numbers of its slot.

The path of a ball has another curvature over an edge than on an end, so that a step ends where it passes from one to
the other. The geometry is that of `shapes`.

The numbers of a slot are the end that touches, 1 or -1, or 0 for none, 1 for the side and for an edge, and the key, by
which the narrow phase knows what touches; 0 is not a key.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np

from mbd_sim.dynamics.contact.shapes import Touch, Zone, ball_in_barrel, ball_on_barrel
from mbd_sim.dynamics.kinematics.poses import SymbolicPose
from mbd_sim.dynamics.math.spatial import is_symbolic
from mbd_sim.mechanism.elements.contacts import Ball, Barrel, Contact

END, SIDE, KEY, BARREL_SIZE = 0, 1, 2, 3  # places among the numbers of a slot, and how many these are

ALIGNED = 1e-12  # sine of the angle up to which an axis is across a plane


def has_one_row(contact: Contact, still: int | None) -> bool:
    """Whether the gap of a ball and a cylinder has no slot: it passes no end in its plane, or its sizes are symbols.

    :param still: see `touch`.
    """
    ball, barrel = contact.first, contact.second
    if not isinstance(ball, Ball) or not isinstance(barrel, Barrel):
        return False
    across = still is not None and float(np.delete(np.abs(barrel.axis), still).max()) <= ALIGNED
    sizes = ball.at.point, ball.radius, barrel.at.point, barrel.radius, barrel.length
    return contact.slots == 0 or across or is_symbolic(*sizes)


def barrel_touch(
    contact: Contact,
    numbers: ca.SX,
    bodies: tuple[Ball, Barrel],
    frames: tuple[SymbolicPose, SymbolicPose],
    length: float,
) -> Touch:
    """The geometry of a slot; the frames are at the centers of both bodies, with the axes of their parts.

    :param length: the gap in m of a slot without features.
    """
    (ball, barrel), (first, second) = bodies, frames
    zone = Zone(numbers[END], numbers[SIDE])
    if contact.inside:
        found = ball_in_barrel(contact, ball, barrel, first, second, zone)
    else:
        found = ball_on_barrel(ball, barrel, first, second, zone)
    return replace(found, distance=ca.if_else(numbers[KEY] > 0.0, found.distance, length))
