"""A cluster of bodies of a part and a plane, for `compiled.features.clusters`."""

from __future__ import annotations

import numpy as np

from mbd_sim.dynamics.contact.cluster_rows import BALL, RIM, RIM_POINT, ClusterBody
from mbd_sim.dynamics.contact.feature_rows import SLOT_SIZE
from mbd_sim.dynamics.contact.shapes import rim_directions
from mbd_sim.mechanism.elements.contacts import Ball, Cluster, Face
from mbd_sim.simulation.contact.compiled.features.clusters import ClusterOnFace
from mbd_sim.simulation.contact.features.narrow_phase import Bounds, CompiledPhase
from mbd_sim.simulation.contact.features.polytopes import dots


class ClusterOnPlane(CompiledPhase):
    """A cluster and a plane; at most as many bodies touch at once as there are `slots`: see `NarrowPhase`."""

    def __init__(self, cluster: Cluster, face: Face, slots: int) -> None:
        bodies = _cluster_bodies(cluster)
        points = np.array([body.point for body in bodies])
        center = 0.5 * (points.max(axis=0) + points.min(axis=0))
        line, extents = points - center, np.array([body.radius + body.length for body in bodies])
        bounds = Bounds(center, float((np.sqrt(dots(line, line)) + extents).max())), Bounds(face.at.point, np.inf)
        numbers = np.concatenate([body.numbers for body in bodies])
        record = ClusterOnFace(len(bodies), numbers, face.at.point, face.normal, slots)
        super().__init__("cluster", record, bounds, slots, SLOT_SIZE, iterates=False)


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
