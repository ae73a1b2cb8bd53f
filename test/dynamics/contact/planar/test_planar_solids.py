"""Cross-sections of prisms: they are as far apart in the plane as long prisms are in space."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.geometry import rotation as rot
from mbd_sim.base.geometry.pose import Pose
from mbd_sim.dynamics.contact.planar.planar_solids import in_plane
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
    for _ in range(12):
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


CORNER = """
mechanism: corner
parameters: {one: 0, two: 0}
ground: {points: {rod: [0, one, 0], block: [0, two, 0]}}
parts:
  rod: {shape: {type: rod, from: [-0.1, -one, 0], to: [0.1, -one, 0], radius: 0.02, mass: 1}}
  block: {shape: {type: block, size: [0.2, 0.1, 0.1], at: [0, -two, 0], mass: 1}}
joints:
  rod:
    type: planar
    between: [ground.rod, rod]
    axis: [0, -1, 0]
    x_axis: [1, 0, 0]
    position: [0.212, 0.3, 0.3]
    velocity: [0, -2, 0]
  block: {type: fixed, between: [ground.block, block]}
contacts: {c: {between: [rod, block], restitution: 0.5}}
"""


def test_where_frames_are_across_the_plane_does_not_count():
    """A round end strikes a corner: the distance of the frames across the plane is no part of the normal."""
    offsets = {"one": 0.3, "two": -0.2}
    sims = [Simulation.from_text(CORNER, parameters=given) for given in ({}, offsets)]
    for sim in sims:
        sim.step(120)
        assert [event.change for event in sim.contact_events] == ["impact"]
    assert sims[1].state[:6] == pytest.approx(sims[0].state[:6], abs=1e-13)


@pytest.mark.parametrize("still", [0, 1, 2])
def test_discs_on_guides_that_are_turned_in_their_plane_strike_as_circles(still):
    """Frames that are turned there and back differ from none by round-off: flat discs would lie on each other."""
    chance, across = np.random.default_rng(still), np.eye(3)[still]
    axis, radii, masses = (1.0 - across) * chance.normal(size=3), chance.uniform(0.1, 0.3, 2), chance.uniform(1, 2, 2)
    shape = "{{type: disc, radius: {}, mass: {}, axis: {}}}"
    ones, others = (shape.format(radius, mass, across.tolist()) for radius, mass in zip(radii, masses, strict=True))
    sim = Simulation.from_text(f"""
mechanism: guides
gravity: [0, 0, 0]
parts: {{one: {{shape: {ones}}}, other: {{shape: {others}}}}}
joints:
  one: {{type: prismatic, between: [ground, one], axis: {axis.tolist()}, velocity: 2}}
  other: {{type: prismatic, between: [ground, other], axis: {axis.tolist()}, position: 1, velocity: -1}}
contacts: {{c: {{between: [one, other], restitution: 1}}}}
""")
    sim.run(until=0.5)
    assert sim.u == pytest.approx(
        [2.0 - 6.0 * masses[1] / sum(masses), -1.0 + 6.0 * masses[0] / sum(masses)], abs=1e-12
    )
    meeting = (1.0 - sum(radii)) / 3.0
    assert sim.q[0] == pytest.approx(2.0 * meeting + sim.u[0] * (0.5 - meeting), abs=1e-11)
