"""Solids for tests of narrow phases: blocks, plates, rods and points, and random poses."""

from __future__ import annotations

from itertools import product

import numpy as np

from mbd_sim.base.geometry import rotation as rot
from mbd_sim.base.geometry.pose import Pose
from mbd_sim.mechanism.elements.contacts import Solid
from mbd_sim.mechanism.elements.parts import Attachment

BLOCK = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
PLATE = ((0, 1, 2, 3), (3, 2, 1, 0))


def solid(vertices, faces=(), radius=0.0, part="p"):
    return Solid(Attachment(part, np.zeros(3)), np.array(vertices, dtype=float), faces, radius)


def block(x, y, z, radius=0.0, part="p"):
    return solid([0.5 * np.array(s) * (x, y, z) for s in product((-1, 1), repeat=3)], BLOCK, radius, part)


def plate(x, y):
    return solid([(-x / 2, -y / 2, 0), (x / 2, -y / 2, 0), (x / 2, y / 2, 0), (-x / 2, y / 2, 0)], PLATE)


def rod(length, radius):
    return solid([(-length / 2, 0, 0), (length / 2, 0, 0)], (), radius)


def ball(radius):
    return solid([(0.01, -0.02, 0.03)], (), radius)


def random_pose(chance, spread):
    quaternion = chance.normal(size=4)
    return Pose(chance.normal(size=3) * spread, rot.from_quaternion(quaternion / np.linalg.norm(quaternion)))


def placed(body, pose):
    """The vertices (n, 3) in ground's frame."""
    return body.vertices @ pose.rotation.T + pose.position
