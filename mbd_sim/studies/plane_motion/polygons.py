"""Velocity and acceleration polygons: vectors of the joints' points from a common pole.

The image of a link in the polygon is similar to the link (Mehmke). The relative acceleration of two of its points has
the normal component ω² r toward the other point, and the tangential one α r across it.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Literal

from mbd_sim.base.short_repr import record
from mbd_sim.mechanism.elements.parts import GROUND
from mbd_sim.studies.plane_motion.snapshot import PlaneSnapshot


@record
class PointVector:
    """The `velocity` and `acceleration` of a point of a `link` at a joint, in m/s and m/s²."""

    link: str
    joint: str
    place: complex
    velocity: complex
    acceleration: complex


@record
class Polygons:
    """The vectors of all joints' points, and of each link its edges: pairs of them with the relative motion.

    `edges` has for each link the pairs of indices of `vectors`; `components` of the relative acceleration of each pair
    are (normal, tangential), in m/s².
    """

    vectors: tuple[PointVector, ...]
    edges: Mapping[str, tuple[tuple[int, int], ...]]
    components: Mapping[tuple[int, int], tuple[complex, complex]]

    def image(self, index: int, kind: Literal["velocity", "acceleration"]) -> complex:
        """The point of a polygon, as seen from its pole."""
        vector = self.vectors[index]
        return vector.velocity if kind == "velocity" else vector.acceleration


def polygons(snapshot: PlaneSnapshot) -> Polygons:
    """The vectors of the points of all moving links at their joints."""
    vectors = []
    for joint in snapshot.joints:
        for name in joint.links:
            if name != GROUND:
                link = snapshot.links[name]
                at = joint.place
                vectors.append(PointVector(name, joint.name, at, link.velocity_of(at), link.acceleration_of(at)))
    edges: dict[str, tuple[tuple[int, int], ...]] = {}
    components = {}
    for name, link in snapshot.links.items():
        own = [index for index, vector in enumerate(vectors) if vector.link == name]
        edges[name] = tuple(pairwise(own)) + (((own[-1], own[0]),) if len(own) > 2 else ())
        for first, second in edges[name]:
            arm = vectors[second].place - vectors[first].place
            components[first, second] = (-(link.omega**2) * arm, 1j * link.alpha * arm)
    return Polygons(tuple(vectors), edges, components)
