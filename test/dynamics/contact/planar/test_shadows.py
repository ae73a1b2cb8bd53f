"""The outlines of bodies in the plane of another outline, beside the bodies themselves as polytopes."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry import rotation as rot
from mbd_sim.base.geometry.pose import Pose
from mbd_sim.dynamics.contact.planar.planar_solids import between_outlines, convex_polygon, rounded_polygon
from mbd_sim.files.builders.bodies.contact_bodies import BLOCK
from mbd_sim.mechanism.elements.constraints import ContactLaw
from mbd_sim.mechanism.elements.contacts import Barrel, ConeBody, Contact, PlanarBody, Solid
from mbd_sim.mechanism.elements.parts import Attachment
from mbd_sim.mechanism.outlines.area import area_of
from mbd_sim.simulation.contact.features.outlines import OutlinePair
from mbd_sim.simulation.contact.features.polytopes import PolytopePair

ORIGIN = np.zeros(3)
TABLE = rounded_polygon([(-0.5, -0.3), (0.5, -0.3), (0.5, 0.0), (-0.5, 0.0)], 0.0)


def solid(points, faces=(), radius=0.0):
    return Solid(Attachment("b", ORIGIN), np.array(points, dtype=float), faces, radius)


def block(x, y, z):
    return solid([(a * x, b * y, c * z) for a, b, c in product((-0.5, 0.5), repeat=3)], BLOCK)


def contact_of(body, axes=None):
    table = PlanarBody(Attachment("a", ORIGIN), ORIGIN, np.eye(3) if axes is None else axes, TABLE)
    return Contact("c", "c", ("b", "a"), body, table, ContactLaw(0.0), slots=8)


@pytest.mark.parametrize("body", [
    block(0.3, 0.2, 0.4),
    solid([(-0.2, 0.0, 0.0), (0.2, 0.1, 0.0)], radius=0.05),
    solid([(-0.2, 0.0, 0.0), (0.2, 0.1, 0.0)]),
], ids=["block", "capsule", "rod"])  # fmt: skip
def test_a_shadow_meets_an_outline_where_the_body_meets_a_block(body):
    """Apart, and where a corner is a little inside; in turned axes. A thin rod has no inside."""
    turned = rot.about(rot.unit((1, 2, 3)), 0.7)
    contact = between_outlines(contact_of(body, turned), {"a": np.eye(3), "b": turned})
    assert contact.slots == 4
    flat = OutlinePair(contact.first, contact.second, contact.slots, contact.names)
    space, chance, signs = PolytopePair(body, block(1.0, 0.3, 9.0), 8, None), np.random.default_rng(2), set()
    table, middle = Pose(ORIGIN, np.eye(3)), Pose(turned @ np.array([0.0, -0.15, 0.0]), turned)
    for _ in range(50):
        angle, x, y = chance.uniform(0.0, 6.0), chance.uniform(-1.0, 1.0), chance.uniform(-0.35, 0.35)
        pose = Pose(turned @ np.array([x, y, 0.0]), rot.about(turned[:, 2], angle) @ turned)
        expected = space.distance(pose, middle)
        if expected > -0.02:
            signs.add(expected > 0.0)
            assert (flat.distance(pose, table) > 0.0) == (expected > 0.0)
    assert signs == {True, False}


def test_cylinders_and_cones_have_circles_and_polygons_as_shadows():
    kinds = [
        (Barrel(Attachment("b", ORIGIN), np.array([0.0, 0.0, 1.0]), 0.2, 0.6), np.pi * 0.04),
        (Barrel(Attachment("b", ORIGIN), np.array([0.6, 0.8, 0.0]), 0.2, 0.6), 0.24),
        (ConeBody(Attachment("b", ORIGIN), np.array([0.0, 0.0, -1.0]), 0.2, 0.6), np.pi * 0.04),
        (ConeBody(Attachment("b", ORIGIN), np.array([0.0, 1.0, 0.0]), 0.2, 0.6), 0.12),
    ]
    rotations = {"a": np.eye(3), "b": np.eye(3)}
    for body, area in kinds:
        contact = between_outlines(contact_of(body), rotations)
        assert area_of(contact.first.outline).area == pytest.approx(area, rel=1e-13)
    tilted = Barrel(Attachment("b", ORIGIN), np.array([0.6, 0.0, 0.8]), 0.2, 0.6)
    with pytest.raises(InputError, match="neither across the plane of the outline nor in it"):
        between_outlines(contact_of(tilted), rotations)


def test_corners_behind_each_other_and_on_a_line_are_one():
    points = np.array([[0, 0], [1, 0], [2, 1e-13], [2, 1], [0, 1], [0, 1], [1, 0.5], [0, 0.5]], dtype=float)
    assert convex_polygon(points) == [(0.0, 0.0), (2.0, 1e-13), (2.0, 1.0), (0.0, 1.0)]
    assert convex_polygon(np.array([[1.0, 2.0], [1.0, 2.0]])) == [(1.0, 2.0)]
    assert len(convex_polygon(np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]]))) == 2
