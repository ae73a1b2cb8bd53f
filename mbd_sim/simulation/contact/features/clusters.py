"""The narrow phase of a cluster of bodies on a plane: how far each of its corners, balls and rims is from it.

The gaps are those that slots have, see `cluster_rows`. As in all narrow phases, sums are written out.
"""

from __future__ import annotations

import numpy as np

from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.dynamics.contact.cluster_rows import BALL, RIM, RIM_POINT, ClusterBody
from mbd_sim.dynamics.contact.shapes import EXACT_TILT, protrusion, rim_directions, withdrawn
from mbd_sim.mechanism.elements.contacts import Ball, Cluster, Face
from mbd_sim.simulation.contact.features.narrow_phase import Bounds
from mbd_sim.simulation.contact.features.polytopes import dots, spread, turned

DEEPER = 8.0  # times the tolerance, by which bodies that touch at once may be less deep than the deepest one


class ClusterOnPlane:
    """A cluster and a plane; at most as many bodies touch at once as there are `slots`."""

    iterates = False
    found_at = -1

    def __init__(self, cluster: Cluster, face: Face, slots: int) -> None:
        self.bodies, self._slots, self._face = _cluster_bodies(cluster), slots, face
        numbers = np.array([body.numbers for body in self.bodies])
        kinds, self._radii, self._lengths = numbers[:, 0], numbers[:, 1], numbers[:, 2]
        self._points, self._axes, self._directions = numbers[:, 3:6], numbers[:, 6:9], numbers[:, 9:12]
        self._rims, self._rim_points, self._is_round = kinds == RIM, kinds == RIM_POINT, bool(np.any(kinds != BALL))
        center = 0.5 * (self._points.max(axis=0) + self._points.min(axis=0))
        line = self._points - center
        reach = float((np.sqrt(dots(line, line)) + self._radii + self._lengths).max())
        self.bounds = Bounds(center, reach), Bounds(face.at.point, np.inf)

    def gaps(self, one: Pose, other: Pose) -> Array:
        """The distance (bodies,) of each body in m."""
        normal = turned(other.rotation, self._face.normal)
        away = one.position - other.position - turned(other.rotation, self._face.at.point)
        own = turned(one.rotation.T, normal)  # in the part's axes, in which the bodies stay where they are
        heights: Array = dots(self._points, own) + dots(away, normal)
        if not self._is_round:
            return np.asarray(heights - self._radii)
        slope = dots(self._axes, own)
        across = own - self._axes * slope[:, None]
        square = dots(across, across)
        low = self._radii * square / np.sqrt(np.maximum(square, (0.5 * EXACT_TILT) ** 2))
        below = np.where(square < EXACT_TILT**2, withdrawn(self._radii, square), low)
        far = heights + self._lengths * slope * (slope < 0.0) + self._radii * dots(self._directions, own)
        points = far - protrusion(self._radii, square)
        return np.where(self._rim_points, points, heights - np.where(self._rims, below, self._radii))

    def distance(self, one: Pose, other: Pose) -> float:
        """That of the lowest body in m."""
        return float(self.gaps(one, other).min())

    def touching(self, one: Pose, other: Pose, tolerance: float) -> list[ClusterBody]:
        """The bodies whose gaps are zero up to the tolerance; of too many, those that are farthest from each other."""
        gaps = self.gaps(one, other)
        found = np.flatnonzero(gaps <= max(tolerance, float(gaps.min()) + DEEPER * tolerance))
        if len(found) > self._slots:
            found = found[spread(self._points[found] + self._radii[found, None] * self._directions[found], self._slots)]
        return [self.bodies[index] for index in found.tolist()]

    def margin(self, one: Pose, other: Pose, numbers: Array) -> float:
        """A corner, ball or rim touches a plane for as long as it is not lifted."""
        return np.inf

    def renewed(self, one: Pose, other: Pose, numbers: Array) -> Array:
        """The numbers stay."""
        return numbers


def _cluster_bodies(cluster: Cluster) -> list[ClusterBody]:
    found: list[ClusterBody] = []
    zero = np.zeros(3)
    for body in cluster.bodies:
        key = len(found) + 1
        if isinstance(body, Ball):
            found.append(ClusterBody(BALL, body.at.point, body.radius, zero, 0.0, zero, key))
            continue
        found.append(ClusterBody(RIM, body.at.point, body.radius, body.axis, 0.0, zero, key))
        for direction in rim_directions(body.axis) if body.first else ():
            key = len(found) + 1
            found.append(ClusterBody(RIM_POINT, body.at.point, body.radius, body.axis, body.length, direction, key))
    return found
