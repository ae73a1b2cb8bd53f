"""Where two outlines meet: the sign of their distance, the points in which they touch, and when others take over."""

import math

import numpy as np
import pytest

from mbd_sim.base.errors import DivergedError
from mbd_sim.base.geometry.pose import Pose
from mbd_sim.mechanism.elements.contacts import PlanarBody
from mbd_sim.mechanism.elements.parts import Attachment
from mbd_sim.simulation.contact.features.outlines import OutlinePair
from test.generators.outlines import built

TOLERANCE = 1e-12
CLEAR = 1e-9  # of the size, from which on the sign of a distance is beyond doubt


def pair(one, other, slots=4):
    bodies = [PlanarBody(Attachment(name, np.zeros(3)), np.zeros(3), np.eye(3), each) for name, each in (("a", one), ("b", other))]  # fmt: skip
    return OutlinePair(*bodies, slots, ("a", "b"))


def at(x, y, angle=0.0):
    c, s = math.cos(angle), math.sin(angle)
    return Pose(np.array([x, y, 0.0]), np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))


def polygon(chance):
    """The corners of a convex polygon on a circle, some of them sharp."""
    while True:
        angles = np.sort(chance.uniform(0.0, 2.0 * math.pi, chance.integers(3, 6)))
        turns = np.diff(angles, append=angles[0] + 2.0 * math.pi)
        if turns.min() > 0.2 and turns.max() < 0.95 * math.pi:
            return chance.uniform(0.4, 1.0) * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def turned(points, angle):
    return points @ at(0.0, 0.0, angle).rotation[:2, :2].T


def corner_at_corner(seed):
    """Two polygons, a place of the first one with a corner at one of the second, and how far it is from there at most.

    Half of them have an edge that is nearly in line with one of the other.
    """
    chance = np.random.default_rng(seed)
    one, other = polygon(chance), polygon(chance)
    first, second = (np.roll(points, chance.integers(len(points)), axis=0) for points in (one, other))
    angle, size = chance.uniform(0.0, 2.0 * math.pi), 10.0 ** chance.uniform(-8.0, -1.0)
    if chance.uniform() < 0.5:
        (ax, ay), (bx, by) = (points[chance.choice([0, 1])] - points[chance.choice([-1, 2])] for points in (first, second))  # fmt: skip
        angle = math.atan2(by, bx) - math.atan2(ay, ax) + 10.0 ** chance.uniform(-4.0, -1.0) * chance.normal()
    return first, second, second[0] - turned(first[:1], angle)[0] + size * chance.normal(size=2), angle


def overlap(one, other):
    """By how much two convex polygons overlap, as seen along the normals of their edges; negative where one parts them."""
    found = math.inf
    for own, opposite in ((one, other), (other, one)):
        edges = np.roll(own, -1, axis=0) - own
        normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1) / np.hypot(*edges.T)[:, None]
        found = min(found, *(normal @ corner - (opposite @ normal).min() for normal, corner in zip(normals, own, strict=True)))  # fmt: skip
    return found


SQUARE = built([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
WEDGE = built([[0.0, 0.0], [3.0, -0.2], [3.0, 0.2]])  # a sharp tip at the origin
SLOT = built(
    [[-2.0, -1.0], [2.0, -1.0], [2.0, 1.0], [0.5, 1.0], {"to": [-0.5, 1.0], "through": [0.0, 0.5]}, [-2.0, 1.0]]
)
DISC = built([[0.3, 0.0], {"to": [-0.3, 0.0], "through": [0.0, 0.3]}, {"to": [0.3, 0.0], "through": [0.0, -0.3]}])


def test_the_distance_changes_its_sign_where_outlines_meet():
    boxes = pair(SQUARE, SQUARE)
    for angle in (0.0, 0.3, math.pi / 4.0):
        reach = math.cos(angle) + math.sin(angle)
        for depth in (1e-9, 1e-3, 0.1):
            assert boxes.distance(at(1.0 + reach + depth, 0.1, angle), at(0.0, 0.0)) == pytest.approx(depth, abs=1e-12)
            assert boxes.distance(at(1.0 + reach - depth, 0.1, angle), at(0.0, 0.0)) < 0.0


def test_a_point_beside_a_sharp_tip_is_not_inside_its_far_side():
    corner = pair(SQUARE, WEDGE)
    for x in (0.01, 0.1, 1.0):
        height = x * 0.2 / 3.0
        place = at(x + math.sqrt(2.0), height + 1e-6 + math.sqrt(2.0), 0.0)
        assert corner.distance(place, at(0.0, 0.0)) > 0.0
        turned = at(x, height + math.sqrt(2.0) + 1e-6, math.pi / 4.0)
        assert 0.0 < corner.distance(turned, at(0.0, 0.0)) < 1e-6
        assert corner.distance(at(x, height + math.sqrt(2.0) - 1e-6, math.pi / 4.0), at(0.0, 0.0)) < 0.0


def test_outlines_overlap_as_convex_polygons_do_where_a_corner_passes_a_corner():
    """Also where neither corner is inside the other outline any more, as it has left that on the other side."""
    signs = {True: 0, False: 0}
    for seed in range(350):
        one, other, (x, y), angle = corner_at_corner(seed)
        depth = overlap(turned(one, angle) + np.array([x, y]), other)
        if abs(depth) > CLEAR and depth < 0.01:
            phase = pair(built(one.tolist()), built(other.tolist()))
            assert (phase.distance(at(x, y, angle), at(0.0, 0.0)) < 0.0) == (depth > 0.0), seed
            signs[depth > 0.0] += 1
    assert min(signs.values()) > 25


def test_a_corner_that_has_left_an_outline_beside_another_contact_still_overlaps():
    """Of a box that stands on one edge, the other one is below a sharp edge of the ground, but past its side."""
    angle, depth = -2e-6, 4e-6
    ground = built([[-3.0, -3.0], [0.5, -3.0], [1.0, -1.0], [-3.0, -1.0]])
    x, y = np.array([-1.0 - 0.1 * depth, -1.0]) - turned(np.array([[-1.0, -1.0]]), angle)[0]
    assert pair(SQUARE, ground).distance(at(x, y, angle), at(0.0, 0.0)) == pytest.approx(-depth, rel=1e-3)


def test_corners_touch_where_their_distance_is_zero_however_near_they_pass_each_other():
    """What is a little beyond the end of its piece, and meets first there, does not count: it does not touch."""
    count = 0
    for seed in range(150):
        one, other, _, angle = corner_at_corner(seed)
        aside = 10.0 ** np.random.default_rng([seed, 1]).uniform(-11.0, -8.0, 2)
        phase, outward = pair(built(one.tolist()), built(other.tolist())), other[0] - other.mean(axis=0)
        start = other[0] - turned(one[:1], angle)[0] + aside
        low, high = -1e-6, 1e-6
        if overlap(turned(one, angle) + start + high * outward, other) > 0.0:
            continue  # they do not meet at the corners
        for _ in range(60):
            middle = 0.5 * (low + high)
            is_apart = phase.distance(at(*(start + middle * outward), angle), at(0.0, 0.0)) >= 0.0
            low, high = (low, middle) if is_apart else (middle, high)
        place = at(*(start + high * outward), angle)
        assert phase.distance(place, at(0.0, 0.0)) < TOLERANCE, seed
        assert phase.touching(place, at(0.0, 0.0), TOLERANCE), seed
        count += 1
    assert count > 25


def test_an_outline_within_another_one_penetrates_it():
    assert pair(DISC, SQUARE).distance(at(0.1, 0.2), at(0.0, 0.0)) < 0.0
    assert pair(SQUARE, DISC).distance(at(0.0, 0.0), at(0.1, 0.2)) < 0.0


def test_faces_touch_at_both_ends_of_where_they_meet():
    found = pair(SQUARE, SQUARE).touching(at(2.0, 0.5), at(0.0, 0.0), TOLERANCE)
    assert len(found) == 2
    with pytest.raises(DivergedError, match="touch in 2 points at once"):
        pair(SQUARE, SQUARE, slots=1).touching(at(2.0, 0.5), at(0.0, 0.0), TOLERANCE)


def test_a_disc_rests_on_both_edges_of_a_narrow_hollow_and_on_the_ground_of_a_wide_one():
    wide = 2.0 / math.sqrt(3.0)
    edges = pair(built([[wide, 0.0], {"to": [-wide, 0.0], "through": [0.0, wide]}, {"to": [wide, 0.0], "through": [0.0, -wide]}]), SLOT)  # fmt: skip
    assert len(edges.touching(at(0.0, 1.0 + math.sqrt(wide**2 - 0.25)), at(0.0, 0.0), TOLERANCE)) == 2
    low = pair(DISC, SLOT).touching(at(0.0, 0.8), at(0.0, 0.0), TOLERANCE)
    assert len(low) == 1 and low[0].numbers[14] == -1.0  # hollow


def test_a_contact_ends_where_its_point_leaves_the_piece():
    phase = pair(DISC, SQUARE)
    (found,) = phase.touching(at(0.9, 1.3), at(0.0, 0.0), TOLERANCE)
    assert phase.margin(at(0.9, 1.3), at(0.0, 0.0), found.numbers) == pytest.approx(0.1, rel=1e-12)
    assert phase.margin(at(1.1, 1.3), at(0.0, 0.0), found.numbers) == pytest.approx(-0.1, rel=1e-12)
