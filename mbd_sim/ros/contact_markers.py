"""Contacts as markers: a ball where each one touches, and an arrow for its force; both shrink to nothing while open."""

from __future__ import annotations

import numpy as np

from mbd_sim.appearance import palette
from mbd_sim.appearance.force_scale import LONG, LONGEST
from mbd_sim.appearance.palette import Color
from mbd_sim.geometry.pose import Array
from mbd_sim.geometry.rotation import aligning_z, to_quaternion

CONTACT_COLOR: Color = palette.CONTACT
RADIUS, SHAFT, HEAD = 0.014, 0.012, 0.028  # relative to the mechanism's size
SHORT = 1e-3  # length relative to the mechanism's size, below which an arrow is not drawn
NOTHING = 1e-6  # relative to the mechanism's size; RViz does not accept zero


def ball_row(point: Array, closed: bool, size: float) -> Array:
    """The pose and the scale (10,) of the ball of a contact."""
    diameter = 2.0 * RADIUS * size if closed else NOTHING * size
    return np.concatenate([point, [0.0, 0.0, 0.0, 1.0], np.full(3, diameter)])


def arrow_row(point: Array, force: Array, full_force: float, size: float, pushes: bool) -> Array:
    """The pose and the scale (10,) of the arrow of a force (3,) in N; it points along x.

    :param full_force: in N, which an arrow of `LONG` stands for.
    :param pushes: it ends at the point (3,); otherwise it starts there.
    """
    force_size = float(np.linalg.norm(force))
    length = min(LONG * force_size / full_force, LONGEST)
    if length < SHORT:
        return np.concatenate([point, [0.0, 0.0, 0.0, 1.0], np.full(3, NOTHING * size)])
    rotation = aligning_z(force / force_size)[:, [2, 0, 1]]  # x along the force
    w, x, y, z = to_quaternion(rotation)
    start = point - length * size * rotation[:, 0] if pushes else point
    return np.concatenate([start, [x, y, z, w], np.array([length, SHAFT, HEAD]) * size])
