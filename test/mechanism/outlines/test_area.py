"""The area of an outline and its moments, against closed forms and sums over triangles."""

import math

import numpy as np
import pytest

from mbd_sim.mechanism.outlines.area import area_of
from mbd_sim.mechanism.outlines.pieces import Outline, Straight, polyline
from test.generators.outlines import built, random_chain


def values(area):
    return np.array([area.area, *area.center, area.xx, area.yy, area.xy])


def triangle_sums(points):
    """The same of a polygon (n, 2): every triangle to the origin, with the mean of its three edge midpoints."""
    a, b = points, np.roll(points, -1, axis=0)
    areas = 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    middles = np.stack([0.5 * a, 0.5 * b, 0.5 * (a + b)])
    means = np.mean(middles[..., :, None] * middles[..., None, :], axis=0)
    total = np.sum(areas)
    center = np.sum(areas[:, None] * (a + b) / 3.0, axis=0) / total
    second = np.sum(areas[:, None, None] * means, axis=0) - total * np.outer(center, center)
    return np.array([total, *center, second[0, 0], second[1, 1], second[0, 1]])


@pytest.mark.parametrize("seed", range(8))
def test_a_chain_of_lines_and_arcs_has_the_moments_of_fine_polygons(seed):
    outline = built(random_chain(seed))
    coarse, fine = (triangle_sums(polyline(outline, turn)) for turn in (4e-3, 2e-3))
    np.testing.assert_allclose(values(area_of(outline)), fine + (fine - coarse) / 3.0, rtol=1e-7, atol=1e-7)


def test_half_a_disc_has_its_closed_form():
    r = 0.3
    area = area_of(built([[-r, 0.0], [r, 0.0], {"to": [-r, 0.0], "through": [0.0, r]}]))
    height, half = 4.0 * r / (3.0 * math.pi), 0.5 * math.pi * r * r
    expected = [half, 0.0, height, math.pi * r**4 / 8.0, math.pi * r**4 / 8.0 - half * height**2, 0.0]
    np.testing.assert_allclose(values(area), expected, rtol=1e-14, atol=1e-16)


def test_far_from_the_origin_moments_lose_no_digits():
    near, far = (built([[x, 5.0 * x], [x + 0.01, 5.0 * x], [x + 0.01, 5.0 * x + 0.02]]) for x in (0.0, 1000.0))
    np.testing.assert_allclose([area_of(far).xx, area_of(far).xy], [area_of(near).xx, area_of(near).xy], rtol=1e-8)


def test_an_involute_encloses_the_area_of_its_closed_form():
    b, roll = 0.2, 1.3
    tip = [b * (math.cos(roll) + roll * math.sin(roll)), b * (math.sin(roll) - roll * math.cos(roll))]
    outline = built([[0.0, 0.0], [b, 0.0], {"to": tip, "involute": b}])
    sector = b * b * roll**3 / 6.0  # swept by the radius: 1/2 ∫ (x y' - y x') ds
    assert area_of(outline).area == pytest.approx(sector, rel=1e-13)


def test_the_direction_of_a_chain_does_not_matter():
    points = [[0.0, 0.0], [1.0, 0.0], {"to": [1.0, 1.0], "radius": 0.8}, {"to": [0.0, 1.0], "radius": -2.0}]
    backward = [[0.0, 0.0], [0.0, 1.0], {"to": [1.0, 1.0], "radius": 2.0}, {"to": [1.0, 0.0], "radius": -0.8}]
    np.testing.assert_allclose(values(area_of(built(points))), values(area_of(built(backward))), rtol=1e-14, atol=2e-16)


def test_a_clockwise_record_has_a_negative_area():
    corners = [(0.0, 0.0), (0.0, 1.0), (1.0, 1.0)]
    pieces = tuple(Straight(a, b) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True))
    assert area_of(Outline(pieces)).area == pytest.approx(-0.5)
