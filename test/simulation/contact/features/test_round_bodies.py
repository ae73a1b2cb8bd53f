"""The narrow phase of round bodies beside convex programs, and its rows beside their own derivatives."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations_with_replacement, product

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from mbd_sim.base.geometry.pose import Pose
from mbd_sim.dynamics.contact.smooth_rows import ITERATED
from mbd_sim.files.builders.bodies.contact_bodies import BLOCK
from mbd_sim.mechanism.elements.contacts import Barrel, ConeBody, EllipsoidBody, Solid
from mbd_sim.mechanism.elements.parts import Attachment
from mbd_sim.simulation.contact.compiled.features.round.bodies import PlacedRound, reach
from mbd_sim.simulation.contact.features.round_bodies import SmoothPair, hull_of, round_body
from test.oracles.convex_distance import distance
from test.simulation.contact.features.rows import row_of

HERE, UP, ROD_RADIUS = Attachment("part", np.zeros(3)), np.array([0.0, 0.0, 1.0]), 0.1
KINDS = ("ellipsoid", "cylinder", "disc", "cone", "block", "rod")
PAIRS = [pair for pair in combinations_with_replacement(KINDS, 2) if set(pair) - {"block", "rod"}]
SMOOTH = [pair for pair in PAIRS if "ellipsoid" in pair or pair == ("cylinder", "cylinder")]


def body(kind, sizes):
    match kind:
        case "ellipsoid":
            return EllipsoidBody(HERE, np.eye(3), tuple(sizes))
        case "cylinder":
            return Barrel(HERE, UP, sizes[0], sizes[1])
        case "disc":
            return Barrel(HERE, UP, sizes[0], 0.0)
        case "cone":
            return ConeBody(HERE, UP, sizes[0], sizes[1])
        case "block":
            corners = [0.5 * np.array(signs) * sizes for signs in product((-1, 1), repeat=3)]
            return Solid(HERE, np.array(corners), BLOCK, 0.0)
    ends = np.outer([-0.5, 0.5], [0.0, 0.0, sizes[0]])
    return Solid(HERE, ends, (), ROD_RADIUS)


def scene(kinds, seed):
    """Two bodies at random places, the sizes that count for each, and the sum of the radii of rods."""
    chance = np.random.default_rng([seed, *map(KINDS.index, kinds)])
    sizes = [chance.uniform(0.2, 1.0, 3) for _ in kinds]
    places = [Pose(0.9 * chance.normal(size=3) - [1.0, 0, 0], Rotation.random(rng=chance).as_matrix())]
    places.append(Pose(0.3 * chance.normal(size=3) + [1.0, 0, 0], Rotation.random(rng=chance).as_matrix()))
    count = {"ellipsoid": 3, "cylinder": 2, "disc": 1, "cone": 2, "block": 3, "rod": 1}
    known = [(kind, size[: count[kind]], pose) for kind, size, pose in zip(kinds, sizes, places, strict=True)]
    bodies = [body(kind, size) for kind, size in zip(kinds, sizes, strict=True)]
    return bodies, known, ROD_RADIUS * kinds.count("rod")


@pytest.mark.parametrize("kinds", PAIRS, ids="-".join)
def test_distances_are_not_more_than_those_of_the_nearest_points(kinds):
    """Equal to them where the surfaces are smooth; sharp corners may be farther apart than is told, but not nearer."""
    seed, apart = -1, 0.0
    while apart < 1e-3:
        seed += 1
        (first, second), (one, other), radius = scene(kinds, seed)
        apart = distance(one, other) - radius
    found = SmoothPair(first, second, 1).distance(one[2], other[2])
    assert 0.0 < found <= apart + 1e-5
    toward = other[2].position - one[2].position
    touching = Pose(one[2].position + toward * _fraction(first, second, one[2], other[2], toward), one[2].rotation)
    assert abs(SmoothPair(first, second, 1).distance(touching, other[2])) < 1e-9
    assert distance((one[0], one[1], touching), other) - radius == pytest.approx(0.0, abs=1e-4)


def _fraction(first, second, one, other, toward):
    """How far a body can move toward the other one, in units of `toward`, by the distances of the narrow phase."""
    pair = SmoothPair(first, second, 1)
    return brentq(lambda way: pair.distance(Pose(one.position + way * toward, one.rotation), other), 0.0, 1.0)


@pytest.mark.parametrize("kinds", SMOOTH, ids="-".join)
def test_a_row_has_the_gap_of_the_narrow_phase_and_the_rate_of_it(kinds):
    """Also after the bodies have moved, with the hint of before."""
    (first, second), (one, other), _ = scene(kinds, 5)
    pair = SmoothPair(first, second, 1)
    toward = other[2].position - one[2].position
    part = _fraction(first, second, one[2], other[2], toward)
    at = Pose(one[2].position + part * toward, one[2].rotation)
    (features,) = pair.touching(at, other[2], 1e-9)
    spin, slide = np.array([0.3, -0.2, 0.4]), np.array([0.1, 0.2, -0.3])

    def moved(time):
        turn = Rotation.from_rotvec(spin * time).as_matrix()
        return Pose(at.position + slide * time, turn @ at.rotation)

    gap, found, point = row_of((first, second), features, (at, other[2]))
    assert abs(gap[0]) < 1e-9
    later, earlier, soon = (row_of((first, second), features, (moved(t), other[2]))[0] for t in (0.02, -1e-5, 1e-5))
    if later > 0.0:
        assert later == pytest.approx(pair.distance(moved(0.02), other[2]), abs=1e-11)
    rate = (soon - earlier) / 2e-5
    assert found @ (slide + np.cross(spin, point - at.position)) == pytest.approx(rate, abs=1e-8)
    assert pair.margin(at, other[2], features.numbers) > 0.0


@pytest.mark.parametrize("order", (1, -1))
def test_an_edge_that_lies_flat_on_a_round_end_has_no_iterated_normal(order):
    """There the normal of a rim is not defined: the forces of such a row are noise, some of them without bound."""
    chance, half = np.random.default_rng(7), np.array([0.3, 0.2, 0.1])
    cylinder, block = body("cylinder", [0.25, 0.4]), body("block", 2.0 * half)
    pair = SmoothPair(*(cylinder, block)[::order], 16)
    for _ in range(40):
        turn = Rotation.from_rotvec([0.0, 0.0, chance.uniform(-3.0, 3.0)])
        x, y = 1.4 * chance.uniform(-half[:2], half[:2])
        end = Pose(turn.apply([x, y, half[2] + 0.2]), turn.as_matrix())
        found = pair.touching(*(end, Pose(np.zeros(3), turn.as_matrix()))[::order], 1e-12)
        assert found and not any(each.numbers[16 + ITERATED] for each in found)


@pytest.mark.parametrize(("kind", "end"), [("cone", -0.2), ("cylinder", -0.2), ("disc", 0.0)])
@pytest.mark.parametrize(("order", "is_turned"), ((1, False), (-1, True)))
def test_balls_across_the_plane_of_a_flat_end_and_beyond_it_are_as_far_as_its_rim(kind, end, order, is_turned):
    """However little they are beyond the rim, where the normal is all but that of the end."""
    chance, radius, ball = np.random.default_rng(5), 0.25, 0.3
    pair = SmoothPair(*(body(kind, [radius, 0.4]), Solid(HERE, np.zeros((1, 3)), (), ball))[::order], 1)
    for beyond in 10.0 ** chance.uniform(-7.0, -1.0, 20):
        spin = Rotation.random(rng=chance) if is_turned else Rotation.identity()
        around, deep = chance.uniform(-3.0, 3.0) * is_turned, -ball + 10.0 ** chance.uniform(-12.0, -3.0)
        center = [(radius + beyond) * np.cos(around), (radius + beyond) * np.sin(around), end + deep]
        poses = (Pose(np.zeros(3), spin.as_matrix()), Pose(spin.apply(center), np.eye(3)))[::order]
        assert pair.distance(*poses) == pytest.approx(np.hypot(beyond, deep) - ball, abs=1e-13)


@pytest.mark.parametrize(("kind", "end"), [("cone", -0.2), ("cylinder", -0.2), ("disc", 0.0)])
@pytest.mark.parametrize("order", (1, -1))
def test_a_ball_changes_between_a_flat_end_and_its_rim_where_its_center_crosses_it(kind, end, order):
    """Each takes the place of the other there; the rim would not notice that the ball has passed onto the end."""
    chance, radius, ball = np.random.default_rng(9), 0.25, 0.3
    pair = SmoothPair(*(body(kind, [radius, 0.4]), Solid(HERE, np.zeros((1, 3)), (), ball))[::order], 1)

    def poses(beyond, spin, around):
        height = -np.sqrt(ball**2 - max(beyond, 0.0) ** 2)
        center = [(radius + beyond) * np.cos(around), (radius + beyond) * np.sin(around), end + height]
        return (Pose(np.zeros(3), spin.as_matrix()), Pose(spin.apply(center), np.eye(3)))[::order]

    for beyond in 10.0 ** chance.uniform(-11.0, -2.0, 20):
        spin, around = Rotation.random(rng=chance), chance.uniform(-3.0, 3.0)
        (rim,), (face,) = (pair.touching(*poses(side * beyond, spin, around), 1e-12) for side in (1, -1))
        assert (rim.numbers[16 + ITERATED], face.numbers[16 + ITERATED]) == (1.0, 0.0)
        for features, outside in ((rim, 1), (face, -1)):
            for side in (1, -1):
                margin = pair.margin(*poses(side * beyond, spin, around), features.numbers)
                assert margin == pytest.approx(side * outside * beyond, abs=1e-15)


def _support(bodies, poses, normal):
    """How far two discs, with radii, are apart along a normal: at most their distance."""
    reach = [
        radius * np.sqrt(max(0.0, 1.0 - (pose.rotation[:, 2] @ normal) ** 2))
        for radius, pose in zip(bodies, poses, strict=True)
    ]
    return normal @ (poses[0].position - poses[1].position) - sum(reach)


@pytest.mark.parametrize("order", [1, -1])
def test_a_tip_beside_the_lowest_point_of_an_ellipsoid_and_level_with_it_is_apart(order):
    """A plane supports both there; the base of the cone, far behind it, counted as a face on which the other one lies."""
    bodies = (EllipsoidBody(HERE, np.eye(3), (0.4, 0.2, 0.2)), ConeBody(HERE, UP, 0.1, 0.2))
    for x, y in ((0.05, 0.0), (0.0, 0.05), (-0.08, 0.02), (0.02, 0.02)):
        height = 0.2 * (1.0 - np.sqrt(1.0 - (x / 0.4) ** 2 - (y / 0.2) ** 2))  # of the surface above the tip
        poses = Pose(np.array([x, y, 0.3]), np.eye(3)), Pose(np.zeros(3), np.eye(3))
        assert 0.5 * height < SmoothPair(*bodies[::order], 8).distance(*poses[::order]) <= height


def test_discs_that_are_almost_in_one_plane_and_apart_do_not_meet():
    """Also those beside each other that overlap from above: both normals of a rim are near the axes of both there."""
    chance, apart = np.random.default_rng(13), 0
    for _ in range(20):
        radii, spin = chance.uniform(0.2, 1.0, 2), Rotation.random(rng=chance)
        tilt = Rotation.from_rotvec([*10.0 ** chance.uniform(-3.0, -0.5) * chance.normal(size=2), 0.0])
        around, overlap = chance.uniform(-3.0, 3.0), 10.0 ** chance.uniform(-3.5, -1.0)
        aside = (sum(radii) - overlap) * np.array([np.cos(around), np.sin(around), 0.0])
        aside[2] = 10.0 ** chance.uniform(-4.0, -1.5) * chance.choice([-1, 1])
        poses = (Pose(np.zeros(3), spin.as_matrix()), Pose(spin.apply(aside), (spin * tilt).as_matrix()))
        place = radii[0] / sum(radii) * poses[1].position
        for _ in range(100):  # projections on both in turn, whose line becomes the normal
            ends = []
            for radius, pose in zip(radii, poses, strict=True):
                own = pose.rotation.T @ (place - pose.position)
                own[2], size = 0.0, np.hypot(own[0], own[1])
                place = pose.position + pose.rotation @ (own * min(1.0, radius / size))
                ends.append(place)
            line = ends[0] - ends[1]
        truth = _support(radii, poses, line / np.linalg.norm(line))
        if truth > 1e-6:
            apart += 1
            pair = SmoothPair(*(body("disc", [radius]) for radius in radii), 1)
            assert pair.distance(*poses) > 0.0
    assert apart > 11


@pytest.mark.parametrize("under", ("disc", "plate"))
@pytest.mark.parametrize("kind", ("disc", "cylinder", "cone"))
@pytest.mark.parametrize("order", (1, -1))
def test_a_rim_above_a_thin_body_is_as_far_as_its_lowest_point(under, kind, order):
    """The other side of the thin body, which is in the same plane, does not count."""
    chance, half = np.random.default_rng(17), 0.2 if kind != "disc" else 0.0
    corners = [[x, y, 0.0] for x, y in ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))]
    thin = body("disc", [0.5]) if under == "disc" else Solid(HERE, np.array(corners), ((0, 1, 2, 3), (3, 2, 1, 0)), 0.0)
    pair = SmoothPair(*(body(kind, [0.3, 2.0 * half]), thin)[::order], 16)
    for _ in range(20):
        sine, around, side = 10.0 ** chance.uniform(-8.0, -2.2), chance.uniform(-3.0, 3.0), chance.choice([-1, 1])
        turn = Rotation.from_rotvec(np.arcsin(sine) * np.array([np.cos(around), np.sin(around), 0.0]))
        turn = turn if side == 1 else turn * Rotation.from_rotvec([np.pi, 0.0, 0.0])
        height, spin = 10.0 ** chance.uniform(-4.0, -1.0), Rotation.random(rng=chance)
        at = [*chance.uniform(-0.1, 0.1, 2), side * height] + side * half * np.array([*np.zeros(2), 1.0])
        poses = (Pose(spin.apply(at), (spin * turn).as_matrix()), Pose(np.zeros(3), spin.as_matrix()))[::order]
        lower = 0.3 * sine + 31.0 * 0.3 * sine**2  # the lowest point of the rim, and how far its points protrude
        assert height - 1.1 * lower <= pair.distance(*poses) <= height


@pytest.mark.parametrize(("order", "tilt"), ((1, 0.0), (-1, 1e-7), (1, 1e-4), (-1, 0.006), (1, 0.03), (-1, 0.06)))
def test_the_ends_of_the_chord_of_an_edge_across_a_round_end_follow_its_motion(order, tilt):
    """The row of a crossing stays on the rim and on the edge, with the rate of its gap, as both bodies move."""
    chance, half, radius = np.random.default_rng(11), np.array([0.6, 0.2, 0.1]), 0.25
    bodies = (body("cylinder", [radius, 0.4]), body("block", 2.0 * half))
    pair, corner = SmoothPair(*bodies[::order], 16), np.array([0.0, 0.2, 0.1])
    for _ in range(2):
        # The block is turned about its edge y = 0.2, z = 0.1, which then rises along x by the tilt.
        spin = Rotation.from_rotvec([0, 0, chance.uniform(-3, 3)]) * Rotation.from_rotvec([0, -tilt, 0])
        spin = spin * Rotation.from_rotvec([0.0, 0.0, 0.0] if tilt == 0.0 else [0.1, 0.0, 0.0])
        end = Pose(np.array([0.0, 0.0, 0.2]), np.eye(3))
        at = spin.apply(corner)
        block = Pose(np.array([0.1 * chance.uniform(-1, 1), 0.1 * chance.uniform(-1, 1), 0.0]) - at, spin.as_matrix())
        edge, direction = block.position + at, spin.apply([1.0, 0.0, 0.0])
        flat = np.array([edge[:2] @ direction[:2], edge[:2] @ edge[:2] - radius**2])
        level = direction[:2] @ direction[:2]
        high = (-flat[0] + np.sqrt(flat[0] ** 2 - level * flat[1])) / level * direction + edge
        block = Pose(block.position - [0, 0, high[2]], block.rotation)
        high[2] = 0.0
        poses = (end, block)[::order]
        found = pair.touching(*poses, 1e-12)
        (features,) = (
            each
            for each in found
            if each.numbers[30] and np.linalg.norm(row_of(bodies[::order], each, poses)[2] - high) < 1e-9
        )
        assert pair.distance(*poses) == pytest.approx(0.0, abs=1e-13)
        assert pair.margin(*poses, features.numbers) > 0.0
        _check_rate(bodies[::order], features, poses, chance)


def test_a_rim_reaches_as_far_in_any_axes_of_its_part():
    """Near the axis of the rim, how far it reaches beyond its center must not be lost beside 1."""
    chance = np.random.default_rng(23)
    for _ in range(20):
        tilt, radius = 10.0 ** chance.uniform(-12.0, 0.0), chance.uniform(0.1, 1.0)
        axis, aside = np.linalg.qr(chance.normal(size=(3, 2)))[0].T
        hull = hull_of(round_body(replace(body("disc", [radius]), axis=axis)))
        placed = PlacedRound(hull, np.zeros(12), np.zeros(3 * hull.count), np.zeros(3), np.zeros(6))
        placed.pose[3::4] = 1.0
        normal = np.cos(tilt) * axis + np.sin(tilt) * aside
        assert reach(placed, normal, 1.0) == pytest.approx(radius * np.sin(tilt), abs=2e-16)


def _check_rate(bodies, features, poses, chance):
    """The rate of a gap that is zero is the velocity along the normal of the points that touch."""
    at, spin, slide = poses[0], chance.normal(size=3), chance.normal(size=3)

    def gap(time):
        turned = Rotation.from_rotvec(spin * time).as_matrix() @ at.rotation
        return float(row_of(bodies, features, (Pose(at.position + slide * time, turned), poses[1]))[0][0])

    value, normal, point = row_of(bodies, features, poses)
    assert abs(value[0]) < 1e-13
    assert np.linalg.norm(normal) == pytest.approx(1.0, abs=1e-14)
    rate = (8.0 * (gap(1e-4) - gap(-1e-4)) - (gap(2e-4) - gap(-2e-4))) / 1.2e-3
    assert normal @ (slide + np.cross(spin, point - at.position)) == pytest.approx(rate, abs=1e-7)


@pytest.mark.parametrize("angle", [0.02, 0.4, -0.1])
def test_a_step_ends_where_the_crossing_of_two_sides_has_run_along_them(angle):
    """It runs through a cylinder in microseconds, with forces of many times the weight, which one long step missed."""
    here, up = Attachment("part", np.zeros(3)), np.array([0.0, 0.0, 1.0])
    pair = SmoothPair(Barrel(here, up, 0.03, 0.4), Barrel(here, up, 0.02, 0.3), 8)

    def crossed(along, turn):
        spin = Rotation.from_rotvec([turn, 0.0, 0.0])
        return Pose(np.array([0.05, 0.0, along]), spin.as_matrix()), Pose(np.zeros(3), np.eye(3))

    (found,) = pair.touching(*crossed(0.0, angle), 1e-13)
    assert pair.margin(*crossed(0.0, angle), found.numbers) == pytest.approx(0.03)
    assert pair.margin(*crossed(0.031, angle), found.numbers) < 0.0
    renewed = pair.renewed(*crossed(0.02, angle), found.numbers)
    assert pair.margin(*crossed(0.031, angle), renewed) == pytest.approx(0.019)
    assert pair.margin(*crossed(0.031, 0.6), found.numbers) > 0.03  # not those that are crossed
