"""The gap of a slot between a cluster of bodies and a plane: what touches is among its numbers.

A part has many corners, of which few touch a plane at a time. They share slots, so that what is computed in a step does
not depend on the number of corners.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.constraints.rows import perpendiculars
from mbd_sim.dynamics.contact.feature_rows import KEY, SLOT_SIZE
from mbd_sim.dynamics.contact.rows.normal_searches import TINY
from mbd_sim.dynamics.contact.shapes import EXACT_TILT, Touch, protrusion, withdrawn
from mbd_sim.dynamics.kinematics.poses import SymbolicPose
from mbd_sim.dynamics.math.spatial import constant
from mbd_sim.mechanism.elements.contacts import Face

BALL, RIM, RIM_POINT = 1.0, 2.0, 3.0  # kinds of bodies; 0 is a slot that is not used


@dataclass(frozen=True, eq=False)
class ClusterBody:
    """A body of a cluster as numbers: its `kind`, and in the frame of the part its center (3,).

    `radius` is that of a ball, or of the circle around `axis` (3,); a point of a rim is in the `direction` (3,) from
    the center of the first rim, the other of which is at the distance `length` along the axis.
    """

    kind: float
    point: Array
    radius: float
    axis: Array
    length: float
    direction: Array
    key: int

    @property
    def numbers(self) -> Array:
        """The numbers (SLOT_SIZE,) of a slot at which it touches."""
        found = np.zeros(SLOT_SIZE)
        found[:3] = self.kind, self.radius, self.length
        found[3:6], found[6:9], found[9:12], found[KEY] = self.point, self.axis, self.direction, self.key
        return found


def cluster_touch(numbers: ca.SX, first: SymbolicPose, second: SymbolicPose, face: Face, length: float) -> Touch:
    """The geometry of a slot; its gaps are those of single balls, rims and their points, see `shapes`.

    :param length: the gap in m of a slot that is not used.
    """
    kind, radius, across = numbers[0], numbers[1], numbers[2]
    normal = second.rotation @ constant(face.normal)
    sides = [second.rotation @ constant(side) for side in perpendiculars(face.normal)]
    center = first.position + first.rotation @ numbers[3:6]
    axis, arm = first.rotation @ numbers[6:9], first.rotation @ numbers[9:12]
    is_ball, is_rim, is_point = (ca.SX(kind == each) for each in (BALL, RIM, RIM_POINT))
    in_disc = normal - axis * ca.dot(normal, axis)
    square = ca.dot(in_disc, in_disc)
    exact = ca.fmax(square, (0.5 * EXACT_TILT) ** 2)
    lowest = center - in_disc * (radius / ca.sqrt(exact + TINY))
    far = center + axis * (across * (ca.dot(axis, normal) < 0.0)) + radius * arm
    point = is_ball * (center - radius * normal) + is_rim * lowest + is_point * far
    distance = ca.dot(normal, point - second.position) - is_point * protrusion(radius, square)
    flat = ca.dot(normal, center - second.position) - withdrawn(radius, square)
    distance = ca.if_else(is_rim * (square < EXACT_TILT**2), flat, distance)
    gap = ca.if_else(kind > 0.0, distance, length)
    return Touch(gap, normal, point, (sides[0], sides[1]))
