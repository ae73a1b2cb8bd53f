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


def pair(one, other, slots=4):
    bodies = [PlanarBody(Attachment(name, np.zeros(3)), np.zeros(3), np.eye(3), each) for name, each in (("a", one), ("b", other))]  # fmt: skip
    return OutlinePair(*bodies, slots, ("a", "b"))


def at(x, y, angle=0.0):
    c, s = math.cos(angle), math.sin(angle)
    return Pose(np.array([x, y, 0.0]), np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))


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
