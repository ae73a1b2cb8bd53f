"""The narrow phase of polytopes, beside Minkowski differences, small minimizations, and areas cut from half planes."""

from __future__ import annotations

import json
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import linprog, minimize
from scipy.spatial import ConvexHull, HalfspaceIntersection
from scipy.spatial.transform import Rotation

from mbd_sim import Simulation
from mbd_sim.base.geometry import rotation as rot
from mbd_sim.base.geometry.pose import Pose
from mbd_sim.dynamics.contact.feature_rows import KEY, SLOT_SIZE, slot_touch
from mbd_sim.dynamics.kinematics.poses import SymbolicPose
from mbd_sim.simulation.contact.features.polytopes import PolytopePair
from test.simulation.contact.features.solids import ball, block, placed, plate, random_pose, rod, solid

HERE = Pose(np.zeros(3), np.eye(3))
SHARP = {
    "blocks": (block(0.2, 0.3, 0.1), block(0.4, 0.1, 0.1)),
    "block and plate": (plate(0.3, 0.2), block(0.2, 0.2, 0.2)),
}
ROUND = {
    "rods": (rod(0.4, 0.02), rod(0.3, 0.05)),
    "rod and block": (rod(0.4, 0.03), block(0.3, 0.2, 0.1)),
    "rounded blocks": (block(0.2, 0.3, 0.1, 0.02), block(0.1, 0.1, 0.2, 0.01)),
    "ball and block": (block(0.3, 0.2, 0.1), ball(0.05)),
    "ball and plate": (ball(0.05), plate(0.3, 0.2)),
}  # fmt: skip


def pair_of(bodies, slots=8):
    return PolytopePair(*bodies, slots, None)


def numeric(features, one, other):
    """The gap, normal (3,) and point (3,) of a slot with these features, from its row."""
    frames = [SymbolicPose(ca.DM(pose.position), ca.DM(pose.rotation)) for pose in (one, other)]
    symbols = ca.SX.sym("numbers", SLOT_SIZE)
    touch = slot_touch(symbols, *(SymbolicPose(ca.SX(f.position), ca.SX(f.rotation)) for f in frames), 1.0, None)
    read = ca.Function("slot", [symbols], [touch.distance, touch.normal, touch.point, *touch.sides])
    gap, normal, point, *sides = (np.array(value).ravel() for value in read(features))
    return float(gap[0]), normal, point, sides


@pytest.mark.parametrize("bodies", SHARP.values(), ids=SHARP)
def test_the_distance_of_sharp_bodies_is_that_of_their_minkowski_difference(bodies):
    """Missing axes, wrong signs and wrong normals of faces would all show; apart as well as inside each other."""
    chance, signs = np.random.default_rng(1), []
    for _ in range(24):
        poses = random_pose(chance, 0.09), random_pose(chance, 0.09)
        one, other = (placed(body, pose) for body, pose in zip(bodies, poses, strict=True))
        hull = ConvexHull((one[:, None] - other).reshape(-1, 3))
        expected = float(hull.equations[:, 3].max())
        assert pair_of(bodies).distance(*poses) == pytest.approx(expected, abs=1e-13)
        signs.append(expected > 0.0)
    assert 4 < sum(signs) < 20


@pytest.mark.parametrize("bodies", ROUND.values(), ids=ROUND)
def test_the_distance_of_rounded_bodies_is_that_of_nearest_points(bodies):
    """Weights of the vertices are sought by minimization; the planes across the line found prove a lower bound."""
    chance = np.random.default_rng(2)
    for _ in range(5):
        poses = random_pose(chance, 0.3), random_pose(chance, 0.3)
        one, other = (placed(body, pose) for body, pose in zip(bodies, poses, strict=True))
        count, radius = len(one), sum(body.radius for body in bodies)

        def line(w, one=one, other=other, count=count):
            return w[:count] @ one - w[count:] @ other

        start = np.concatenate([np.full(len(each), 1.0 / len(each)) for each in (one, other)])
        sums = [
            {"type": "eq", "fun": lambda w, part=part: w[part].sum() - 1.0}
            for part in (slice(count), slice(count, None))
        ]
        found = minimize(lambda w: line(w) @ line(w), start, bounds=[(0, 1)] * len(start), constraints=sums, tol=1e-16)
        apart = line(found.x)
        size = np.linalg.norm(apart)
        distance = pair_of(bodies).distance(*poses)
        if size < 1e-3:
            assert distance <= 1e-3 - radius
            continue
        normal = apart / size
        assert (one @ normal).min() - (other @ normal).max() - 1e-12 <= distance + radius <= size + 1e-12
        assert distance + radius == pytest.approx(size, abs=1e-6)


@pytest.mark.parametrize("turn", [0.0, 0.4, np.pi / 4])
@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.13, -0.05), (0.21, 0.16)])
def test_blocks_touch_in_the_corners_of_the_area_between_them(turn, shift):
    """All corners are found, each once: vertices on both sides, and crossings of edges."""
    one, other = block(0.2, 0.3, 0.1), block(0.4, 0.2, 0.2)
    pose = Pose(np.array([*shift, 0.15]), rot.about(np.array([0.0, 0.0, 1.0]), turn))
    planes = []
    for size, center, angle in (((0.2, 0.3), shift, turn), ((0.4, 0.2), (0.0, 0.0), 0.0)):
        for k in range(4):
            normal = np.array([np.cos(angle + k * np.pi / 2), np.sin(angle + k * np.pi / 2)])
            planes.append([*normal, -normal @ center - size[k % 2] / 2])
    lines = np.array(planes)
    inside = linprog(
        [0, 0, -1], np.column_stack([lines[:, :2], np.ones(8)]), -lines[:, 2], bounds=[(None, None)] * 3
    ).x[:2]
    distinct = np.unique(np.round(planes, 12), axis=0, return_index=True)[1]
    expected = HalfspaceIntersection(lines[distinct], inside).intersections
    expected = expected[np.unique(np.round(expected, 9), axis=0, return_index=True)[1]]
    everywhere = random_pose(np.random.default_rng(3), 1.0)
    poses = everywhere @ pose, everywhere
    found = pair_of((one, other)).touching(*poses, 1e-13)
    points = []
    for each in found:
        gap, normal, point, sides = numeric(each.numbers, *poses)
        assert gap == pytest.approx(0.0, abs=1e-14)
        assert normal @ everywhere.rotation == pytest.approx([0, 0, 1], abs=1e-14)
        for side in sides:
            assert side @ normal == pytest.approx(0.0, abs=1e-15)
        points.append((everywhere.inverse().rotation @ (point - everywhere.position))[:2])
        assert pair_of((one, other)).margin(*poses, each.numbers) >= -1e-14
    points = np.array(points)[np.lexsort(np.round(np.array(points), 9).T[::-1])]
    assert points == pytest.approx(expected[np.lexsort(np.round(expected, 9).T[::-1])], abs=1e-13)


def test_of_more_corners_than_slots_those_are_chosen_that_are_far_from_each_other():
    """A prism of sixteen sides stays supported on all sides by eight of its corners."""
    angles = 2.0 * np.pi * np.arange(16) / 16
    ring = 0.1 * np.column_stack([np.cos(angles), np.sin(angles)])
    low, high = (np.column_stack([ring, np.full(16, z)]) for z in (0.0, 0.1))
    sides = [(k, (k + 1) % 16, 16 + (k + 1) % 16, 16 + k) for k in range(16)]
    prism = solid([*low, *high], (tuple(range(15, -1, -1)), tuple(range(16, 32)), *sides))
    found = pair_of((prism, block(0.4, 0.4, 0.2))).touching(Pose(np.array([0, 0, 0.1]), np.eye(3)), HERE, 1e-13)
    points = np.array([numeric(each.numbers, Pose(np.array([0, 0, 0.1]), np.eye(3)), HERE)[2] for each in found])
    turns = np.sort(np.arctan2(points[:, 1], points[:, 0]))
    assert np.diff([*turns, turns[0] + 2 * np.pi]).max() < 0.8


def test_a_tilted_block_touches_with_its_lower_edge_and_leaves_the_face_over_its_border():
    """The lower edge reaches beyond the face: it is supported at a vertex and where it crosses the border."""
    one, other = block(0.2, 0.3, 0.1), block(0.4, 0.2, 0.2)
    tilt = rot.about(np.array([0.0, 1.0, 0.0]), 0.3)
    low = -(tilt @ np.array([0.1, 0.0, -0.05]))
    pose = Pose(np.array([0.05, 0.1, 0.1 + low[2]]), tilt)
    pair = pair_of((one, other))
    found = pair.touching(pose, HERE, 1e-13)
    assert len(found) == 2
    points = np.array([numeric(each.numbers, pose, HERE)[2] for each in found])
    assert sorted(points[:, 1]) == pytest.approx([-0.05, 0.1], abs=1e-14)
    margins = sorted(pair.margin(pose, HERE, each.numbers) for each in found)
    assert margins == pytest.approx([0.05, 0.05], abs=0.15)
    moved = Pose(pose.position + np.array([0.3, 0.0, 0.0]), tilt)
    assert min(pair.margin(moved, HERE, each.numbers) for each in found) < 0.0


def test_a_ball_has_faces_edges_and_vertices_one_after_the_other():
    """Of a point that goes around a block the margin of its features falls through zero where others are nearest."""
    bodies, found_on_path = (ball(0.05), block(0.2, 0.2, 0.2)), []
    pair, path = pair_of(bodies, 1), np.linspace(0.0, 1.0, 51)
    offset = bodies[0].vertices[0]
    for s in path:
        direction = rot.unit(np.array([1.0, 0.2 + s, 3.0 * s - 1.2]))
        pose = Pose(direction - offset, np.eye(3))
        for _ in range(40):  # down to the surface
            pose = Pose(pose.position - pair.distance(pose, HERE) * rot.unit(pose.position + offset), np.eye(3))
        (found,) = pair.touching(pose, HERE, 1e-12)
        _, normal, point, _ = numeric(found.numbers, pose, HERE)
        nearest = np.clip(pose.position + offset, -0.1, 0.1)
        assert normal == pytest.approx((pose.position + offset - nearest) / 0.05, abs=1e-10)
        assert point == pytest.approx(nearest, abs=1e-10)
        assert pair.margin(pose, HERE, found.numbers) >= -1e-12
        if found_on_path and found_on_path[-1].key != found.key:
            assert pair.margin(pose, HERE, found_on_path[-1].numbers) < 1e-12
        found_on_path.append(found)
    changes = [new.key for old, new in pairwise(found_on_path) if new.key != old.key]
    assert len(changes) >= 3
    assert len({each.key for each in found_on_path}) == len(changes) + 1


@pytest.mark.parametrize("bodies", [*SHARP.values(), *ROUND.values()], ids=[*SHARP, *ROUND])
def test_the_row_of_what_touches_is_the_distance_nearby(bodies):
    """To first order the distance grows as the least gap of the slots; the row and the narrow phase are independent."""
    chance, tried = np.random.default_rng(4), 0
    pair = pair_of(bodies)
    while tried < 4:
        one, other = random_pose(chance, 0.0), random_pose(chance, 0.0)
        direction = rot.unit(chance.normal(size=3))
        near, far = 0.0, 2.0  # bisected to a touch
        for _ in range(60):
            middle = 0.5 * (near + far)
            near, far = (
                (middle, far) if pair.distance(Pose(middle * direction, one.rotation), other) < 0 else (near, middle)
            )
        deep = Pose((near - 2e-13) * direction, one.rotation)
        one = Pose(far * direction, one.rotation)
        found = pair.touching(one, other, 1e-13)
        assert found
        assert [each.key for each in pair.touching(deep, other, 1e-13)] == [each.key for each in found]
        step = 1e-7
        moved = Pose(
            one.position + step * chance.normal(size=3), rot.about(rot.unit(chance.normal(size=3)), step) @ one.rotation
        )
        gaps = [numeric(each.numbers, moved, other)[0] for each in found]
        assert pair.distance(moved, other) == pytest.approx(min(gaps), abs=2e-12)
        tried += 1


def test_rods_that_are_nearly_parallel_touch_at_an_end_of_one_of_them():
    """Where their lines are nearest is round-off, but the distances at the ends are not: they differ by much more."""
    chance, bodies = np.random.default_rng(5), (rod(0.4, 0.03), rod(0.3, 0.02))
    pair, ends = pair_of(bodies), []
    for _ in range(100):
        angle = 10.0 ** chance.uniform(-13.0, -7.0) * chance.choice([-1.0, 1.0]) + chance.choice([0.0, np.pi])
        everywhere, turn = random_pose(chance, 1.0), rot.about(np.array([0.0, 1.0, 0.0]), angle)
        along = chance.uniform(-0.3, 0.3)
        (x, _, z), (x2, _, z2) = placed(bodies[1], Pose(np.array([along, 0.0, 0.0]), turn))
        heights = [z + (at - x) * (z2 - z) / (x2 - x) for at in (-0.2, 0.2) if min(x, x2) <= at <= max(x, x2)]
        lowest = min([*heights, *(height for at, height in ((x, z), (x2, z2)) if abs(at) <= 0.2)])
        other = Pose(np.array([along, 0.0, 0.05 - lowest]), turn)  # over the first one, in the plane of both
        poses = everywhere, everywhere @ other
        assert pair.distance(*poses) == pytest.approx(0.0, abs=1e-14)
        found = pair.touching(*poses, 1e-13)
        assert found
        assert min(numeric(each.numbers, *poses)[0] for each in found) == pytest.approx(0.0, abs=1e-14)
        ends.append(len(found))
    assert {1, 2} <= set(ends)


def test_directions_across_are_renewed_before_they_are_along_the_normal():
    """An edge on an edge turns the normal against both bodies."""
    bodies = rod(0.4, 0.05), rod(0.4, 0.05)
    pair = pair_of(bodies)
    across = Pose(np.array([0.0, 0.0, 0.1]), rot.about(np.array([0.0, 0.0, 1.0]), np.pi / 2))
    (found,) = pair.touching(across, HERE, 1e-13)
    assert pair.margin(across, HERE, found.numbers) == pytest.approx(0.2)
    numbers = found.numbers.copy()
    numbers[KEY - 3 : KEY] = rot.unit(np.array([0.1, 0.0, 1.0]))
    assert pair.margin(across, HERE, numbers) < 0.0


@pytest.mark.parametrize("angle", [0.01, 0.4, -0.05])
def test_a_step_ends_where_the_crossing_of_edges_has_run_along_them(angle):
    """It runs through a rod in microseconds, with forces of many times the weight, which one long step missed."""
    bodies, z = (rod(0.4, 0.03), rod(0.3, 0.02)), np.array([0.0, 0.0, 1.0])
    pair = pair_of(bodies)

    def crossed(along, turn):
        return Pose(np.array([along, 0.0, 0.05]), rot.about(z, turn))

    (found,) = pair.touching(crossed(0.0, angle), HERE, 1e-13)
    assert pair.margin(crossed(0.0, angle), HERE, found.numbers) == pytest.approx(0.03)
    assert pair.margin(crossed(0.01, angle), HERE, found.numbers) == pytest.approx(0.02)
    assert pair.margin(crossed(0.031, angle), HERE, found.numbers) < 0.0
    assert pair.margin(crossed(0.031, 0.6), HERE, found.numbers) > 0.03  # not those that are crossed


@pytest.mark.parametrize(
    ("kind", "seed"), [("capsule", 0), ("capsule", 1), ("capsule", 2), ("cylinder", 3), ("cylinder", 4)]
)
def test_a_bar_that_rocks_on_a_nearly_parallel_one_keeps_its_energy(kind, seed):
    chance = np.random.default_rng([seed, 3])
    yaw, pitch, along = chance.uniform(0.002, 0.02), chance.uniform(0.02, 0.05), chance.uniform(-0.1, 0.1)
    bar = {"type": kind, "radius": 0.03, "length": 0.4, "axis": [1, 0, 0], "mass": 1}
    joints = {
        "below": {"type": "fixed", "between": ["ground", "below"]},
        "top": {"type": "free", "between": ["ground", "top"], "position": [0, 0, 0.08]},
    }
    parts, contact = {"below": {"shape": bar}, "top": {"shape": bar}}, {"between": ["top", "below"]}
    text = {"mechanism": "rocking", "parts": parts, "joints": joints, "contacts": {"c": contact}}
    sim = Simulation.from_text(json.dumps(text), step=1e-3)
    x, y, z, w = Rotation.from_euler("xyz", [0.0, pitch, yaw]).as_quat()
    sim.reset([along, 0.0, 0.08, w, x, y, z])
    sim.run(until=0.3)
    assert sim.contact_event_count >= 3
    assert abs(sim.energies.residual) < 1e-9
