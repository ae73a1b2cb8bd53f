"""Distances of pieces in closed form, against the nearest points of fine polygons."""

import math
import random
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from mbd_sim.compiler.ir.python_kinds import packed
from mbd_sim.mechanism.outlines.pieces import Outline, Round, polyline
from mbd_sim.mechanism.outlines.table import POINT, table_of
from mbd_sim.simulation.contact.compiled.features import pieces
from mbd_sim.simulation.contact.compiled.library import called
from mbd_sim.simulation.contact.features.outlines import pieces_of
from test.generators.outlines import built, random_chain


@dataclass(frozen=True)
class PlaneMotion:
    """The place of one plane in another: turned by the angle with this `cosine` and `sine`, then moved by x and y."""

    cosine: float
    sine: float
    x: float
    y: float

    def points(self, points):
        """Points (n, 2), turned and moved."""
        x, y = np.asarray(points).T
        turned = [self.cosine * x - self.sine * y, self.sine * x + self.cosine * y]
        return np.stack(turned, axis=1) + np.array([self.x, self.y])


def compiled(table):
    return pieces_of(table, np.zeros(2))


def numbers_of(place):
    return np.array([place.cosine, place.sine, place.x, place.y])


def distances(one, other, place, firsts, seconds):
    """Gaps, margins, normals and points of pairs of pieces."""
    records, found = [compiled(one), compiled(other)], np.zeros((len(firsts), pieces.MEETING))
    arrays = [packed(record) for record in records]
    for row, i, j in zip(found, firsts.tolist(), seconds.tolist(), strict=True):
        called("meet_pieces", *arrays, numbers_of(place), i, j, row)
    parts = np.split(found[:, 2:], 3, axis=1)
    return SimpleNamespace(gaps=found[:, 0], margins=found[:, 1], normals=parts[0], points=parts[1], others=parts[2])


def lower_bounds(one, other, place):
    records, pairs = [compiled(one), compiled(other)], every_pair(one, other).T.tolist()
    arrays = [packed(record) for record in records]
    return np.array([called("lower_bound", *arrays, numbers_of(place), *pair) for pair in pairs])


def depth(table, x, y):
    records = compiled(POINT), compiled(table)
    return called("depth_of", *map(packed, records), x, y)


def every_pair(one, other):
    return np.indices((len(one), len(other))).reshape(2, -1)


def all_distances(one, other, place):
    return distances(one, other, place, *every_pair(one, other))


def nearest_points(one, other):
    """The distance of two polygons (n, 2) that do not overlap: of all corners from all sides of the other one."""

    def from_sides(points, polygon):
        a, sides = polygon, np.roll(polygon, -1, axis=0) - polygon
        lines = points[:, None] - a
        share = np.clip(np.sum(lines * sides, axis=-1) / np.maximum(np.sum(sides * sides, axis=-1), 1e-300), 0.0, 1.0)
        return np.min(np.linalg.norm(lines - share[..., None] * sides, axis=-1))

    return min(from_sides(one, other), from_sides(other, one))


def random_place(seed, far):
    drawn = random.Random(seed)
    turn, at = drawn.uniform(-math.pi, math.pi), drawn.uniform(-math.pi, math.pi)
    return PlaneMotion(math.cos(turn), math.sin(turn), far * math.cos(at), far * math.sin(at))


@pytest.mark.parametrize("seed", range(6))
def test_the_least_gap_of_pairs_is_the_distance_of_two_outlines(seed):
    outlines = [built(random_chain(2 * seed + k)) for k in (0, 1)]
    tables, place = [table_of(each) for each in outlines], random_place(seed, 4.2)
    found = all_distances(*tables, place)
    valid = (found.margins >= -1e-9) & (found.gaps > 0.0)  # others are on the far sides
    polygons = [polyline(each, 4e-3) for each in outlines]
    expected = nearest_points(place.points(polygons[0]), polygons[1])
    assert np.min(found.gaps[valid]) == pytest.approx(expected, abs=4e-5)  # chords of both
    bounds = lower_bounds(*tables, place)
    assert np.all(found.gaps[valid] >= bounds[valid] - 1e-9)
    apart = np.linalg.norm(found.points - found.others, axis=1)
    np.testing.assert_allclose(apart[valid], found.gaps[valid], atol=1e-12)


@pytest.mark.parametrize("seed", range(6))
def test_the_gap_grows_along_its_normal(seed):
    one, other = (table_of(built(random_chain(2 * seed + k))) for k in (0, 1))
    place, step = random_place(seed, 4.2), 1e-6
    found = all_distances(one, other, place)
    index = int(np.argmin(np.where((found.margins >= 0.0) & (found.gaps > 0.0), found.gaps, np.inf)))
    moved = [
        all_distances(one, other, PlaneMotion(place.cosine, place.sine, place.x + dx, place.y + dy)).gaps[index]
        for dx, dy in ((step, 0.0), (-step, 0.0), (0.0, step), (0.0, -step))
    ]
    gradient = [(moved[0] - moved[1]) / (2.0 * step), (moved[2] - moved[3]) / (2.0 * step)]
    np.testing.assert_allclose(gradient, found.normals[index], atol=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_the_depth_of_points_is_that_in_a_fine_polygon(seed):
    outline = built(random_chain(seed))
    table, polygon = table_of(outline), polyline(outline, 1e-3)
    for x, y in np.random.default_rng(seed).uniform(-2.0, 2.0, (30, 2)).tolist():
        a, b = polygon - (x, y), np.roll(polygon, -1, axis=0) - (x, y)
        turned = np.sum(np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], np.sum(a * b, axis=1)))
        inside, far = abs(turned) > math.pi, nearest_points(np.array([[x, y]]), polygon)
        assert depth(table, x, y) == pytest.approx(far if inside else -far, abs=1e-6)


def test_a_pin_in_a_hollow_touches_the_near_side():
    pin = table_of(Outline((Round((0.0, 0.0), 0.1, -math.pi, math.pi),)))
    hollow = table_of(built([[-1.0, 0.0], {"to": [1.0, 0.0], "through": [0.0, -0.5]}, [1.0, -1.0], [-1.0, -1.0]]))
    index = int(np.flatnonzero(hollow.hollow)[0])
    (cx, cy), radius = hollow.centers[index], -hollow.radii[index]
    place = PlaneMotion(1.0, 0.0, cx + 0.3, cy - 0.9)
    found = distances(pin, hollow, place, np.array([0]), np.array([index]))
    assert found.gaps[0] == pytest.approx(radius - 0.1 - math.hypot(0.3, 0.9), rel=1e-14)
    np.testing.assert_allclose(found.normals[0], np.array([-0.3, 0.9]) / math.hypot(0.3, 0.9), atol=1e-15)
    assert found.margins[0] > 0.0


def involute_tooth(base, rolls, hand):
    """The flank of a tooth as one piece, about the origin of its plane."""
    from test.generators.outlines import built as chain

    def point(roll):
        x, y = math.cos(roll) + roll * math.sin(roll), hand * (math.sin(roll) - roll * math.cos(roll))
        return [base * x, base * y]

    ends = [point(roll) for roll in (rolls if hand > 0.0 else rolls[::-1])]
    outline = chain([ends[0], {"to": ends[1], "involute": base}, [-2.0 * base, hand * 0.1 * base]])
    piece = next(each for each in outline.pieces if isinstance(each, Round) and each.growth)
    return table_of(Outline((piece,)))


@pytest.mark.parametrize("angle", [-0.02, 0.0, 0.03])
def test_two_involutes_touch_on_the_line_that_is_tangent_to_both_base_circles(angle):
    """Turned in the ratio of the base circles, the gap between two flanks is constant, as the theory of gears has it."""
    one, other = involute_tooth(0.3, (0.1, 0.9), 1.0), involute_tooth(0.2, (0.1, 1.2), 1.0)
    gaps = []
    for turn in (angle, angle + 1e-3):
        first, second = (
            0.9 + turn / 0.3,
            math.pi + 0.9 - turn / 0.2,
        )  # of the wheels; the center of the first is at x = 0
        relative = first - second
        x, y = -0.53 * math.cos(second), 0.53 * math.sin(second)
        found = distances(
            one, other, PlaneMotion(math.cos(relative), math.sin(relative), x, y), np.array([0]), np.array([0])
        )
        gaps.append(found.gaps[0])
    assert gaps[0] == pytest.approx(gaps[1], abs=1e-12)
