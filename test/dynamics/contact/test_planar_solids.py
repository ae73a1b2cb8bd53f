"""Cross-sections of prisms: they are as far apart in the plane as long prisms are in space."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mbd_sim.base.geometry import rotation as rot
from mbd_sim.base.geometry.pose import Pose
from mbd_sim.dynamics.contact.planar_solids import in_plane
from mbd_sim.mechanism.elements.constraints import ContactLaw
from mbd_sim.mechanism.elements.contacts import Contact
from mbd_sim.simulation.contact.features.polytopes import PolytopePair
from test.simulation.contact.features.solids import ball, block, rod, solid

PLACES = {"p": 0.0, "q": 0.0}


def contact_of(first, second):
    return Contact("c", "q", ("a", "b"), first, second, ContactLaw(0.0), slots=8)


def turned(body, rotation):
    return replace(body, vertices=body.vertices @ rotation.T)


@pytest.mark.parametrize("still", [0, 1, 2])
@pytest.mark.parametrize("bodies", [
    (block(0.2, 4, 0.1), block(0.3, 6, 0.2)),
    (block(0.2, 4, 0.1), ball(0.05)),
    (turned(rod(0.3, 0.02), np.eye(3)), block(0.3, 2, 0.1)),
], ids=["blocks", "ball", "rod"])  # fmt: skip
def test_cross_sections_are_as_far_apart_as_prisms(bodies, still):
    """All axes across the plane: sections in the wrong order have normals that point inward."""
    axes = np.roll(np.eye(3), still - 1, axis=1)
    bodies = [turned(body, axes.T) for body in bodies]
    contact = in_plane(contact_of(*bodies), still, PLACES)
    assert contact.still == still and contact.slots <= 2
    flat, space = PolytopePair(contact.first, contact.second, 2, still), PolytopePair(*bodies, 8, None)
    chance, across = np.random.default_rng(1), np.eye(3)[still]
    for _ in range(40):
        poses = []
        for _ in bodies:
            position = chance.normal(size=3) * 0.1 * (1.0 - across)
            poses.append(Pose(position, rot.about(across, chance.uniform(0, 6))))
        assert flat.distance(*poses) == pytest.approx(space.distance(*poses), abs=1e-14)


def test_other_bodies_stay_in_space_and_prisms_beside_each_other_never_meet():
    pyramid = solid([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)))
    contact = contact_of(pyramid, block(1, 1, 1))
    assert in_plane(contact, 1, PLACES) is contact
    tilted = contact_of(turned(block(1, 1, 1), rot.about(np.array([1.0, 0, 0]), 0.1)), block(1, 1, 1))
    assert in_plane(tilted, 1, PLACES) is tilted
    beside = contact_of(block(1, 1, 1), block(1, 1, 1, part="q"))
    assert in_plane(beside, 1, {"p": 0.0, "q": 1.0}) is None
    assert in_plane(beside, 1, {"p": 0.0, "q": 0.9}).still == 1
    above = contact_of(ball(0.3), block(1, 1, 1, part="q"))  # may touch the edge from beside
    assert in_plane(above, 1, {"p": 0.0, "q": 0.7}) is above
