"""Rims at other rims, round sides and ellipsoids, at places where they touch by construction, with normals up to the axes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mbd_sim.base.geometry.pose import Pose
from mbd_sim.mechanism.elements.contacts import Barrel, ConeBody, EllipsoidBody
from mbd_sim.mechanism.elements.parts import Attachment
from mbd_sim.simulation.contact.features.round_bodies import SmoothPair
from test.simulation.contact.features.rows import row_of

HERE, RIM, UP = Attachment("part", np.zeros(3)), 0.25, np.array([0.0, 0.0, 1.0])
RADII = np.array([0.3, 0.2, 0.15])
BODIES = {  # and how far the rim is below the center of the body
    "cylinder": (Barrel(HERE, UP, RIM, 0.4), 0.2),
    "disc": (Barrel(HERE, UP, RIM, 0.0), 0.0),
    "cone": (ConeBody(HERE, UP, RIM, 0.4), 0.2),
    "ellipsoid": (EllipsoidBody(HERE, np.eye(3), tuple(RADII)), 0.0),
    "side": (Barrel(HERE, UP, RIM, 0.4), 0.0),
    "slope": (ConeBody(HERE, UP, RIM, 0.4), RIM / np.hypot(RIM, 0.4)),  # and the cosine of its normal with the axis
}
RIMS = ("cylinder", "disc", "cone")
PAIRS = [(one, two) for one in BODIES for two in BODIES if one in RIMS or two in RIMS]
KINDS = pytest.mark.parametrize("kinds", PAIRS, ids="-".join)


def frame(tangent, normal, tilt, turned):
    """The rotation of a body whose rim has a tangent, and is lowest along a normal at a tilt against its axis."""
    across = np.cross(tangent, normal)
    axis = np.cos(tilt) * normal + np.sin(tilt) * across  # of the lower end, upwards
    outward = np.cross(axis, tangent)
    outward *= -np.sign(outward @ normal) if outward @ normal else 1.0
    first = turned * outward + np.sqrt(1.0 - turned**2) * np.cross(axis, outward)
    return np.column_stack([first, np.cross(axis, first), axis]), outward


def touching(kinds, numbers, spin, apart=0.0):
    """The poses of two bodies that touch, the normal, and the point of the first one.

    :param numbers: the tilts of the normal against the axes, the angle of the tangents, and turns about the axes.
    """
    (tilt, other_tilt), psi, turns = numbers
    normal = spin.apply(UP)
    poses = []
    for kind, sign, angle, lean, turned in zip(kinds, (1, -1), (0.0, psi), (tilt, other_tilt), turns, strict=True):
        own, depth = sign * normal, BODIES[kind][1]
        tangent = spin.apply([np.cos(angle), np.sin(angle), 0.0])
        rotation, outward = frame(tangent, own, lean, turned)
        arm = RIM * outward - depth * rotation[:, 2]
        if kind == "ellipsoid":  # the lowest point along its own normal
            own = rotation.T @ own
            arm = -rotation @ (RADII**2 * own / np.sqrt(np.sum((RADII * own) ** 2)))
        if kind in ("side", "slope"):  # in the middle of it
            sine = np.sqrt(1.0 - depth**2)
            axis = sine * tangent - depth * own
            radial = -(own + depth * axis) / sine
            first = turned * radial + np.sqrt(1.0 - turned**2) * np.cross(axis, radial)
            rotation = np.column_stack([first, np.cross(axis, first), axis])
            arm = (0.5 if kind == "slope" else 1.0) * RIM * radial
        poses.append(Pose((sign > 0) * apart * normal - arm, rotation))
    return poses, normal, apart * normal


def numbers_of(chance, least):
    """As `touching` is given; one of the bodies does not lie flat on the end of the other one."""
    tilts = chance.choice([-1, 1], 2) * 10.0 ** chance.uniform(least, -0.1, 2)
    tilts[chance.integers(2)] = chance.uniform(0.1, 1.3)
    return tilts, chance.uniform(0.8, 2.3), chance.uniform(-1.0, 1.0, 2)


@KINDS
def test_a_rim_touches_where_it_does_and_not_where_it_is_apart(kinds):
    """Also where the normal is all but the axis of a rim, near which steps from other normals did not find it."""
    chance, pair = np.random.default_rng(3), SmoothPair(*(BODIES[kind][0] for kind in kinds), 8)
    for _ in range(25):
        numbers, spin = numbers_of(chance, -7.0), Rotation.random(rng=chance)
        apart = 10.0 ** chance.uniform(-9.0, -3.0)
        poses, _, _ = touching(kinds, numbers, spin)
        assert abs(pair.distance(*poses)) <= 1e-13
        assert 0.0 < pair.distance(*touching(kinds, numbers, spin, apart)[0]) <= apart + 1e-13


@KINDS
def test_a_row_follows_a_rim_past_the_axis(kinds):
    """As the normal turns, with the numbers of before: the steps of a row led past it near the axis."""
    chance, bodies = np.random.default_rng(4), tuple(BODIES[kind][0] for kind in kinds)
    pair = SmoothPair(*bodies, 8)
    for _ in range(2):
        tilts, psi, turns = numbers_of(chance, -5.0)
        spin = Rotation.random(rng=chance)
        poses, _, _ = touching(kinds, (tilts, psi, turns), spin)
        found = pair.touching(*poses, 1e-13)
        assert len(found) == 1
        for tilt, turn in ((tilts, psi), (tilts - np.clip(0.3 * tilts, -0.01, 0.01), psi + 0.005)):
            after, normal, point = touching(kinds, (tilt, turn, turns), spin)
            gap, own, at = row_of(bodies, found[0], after)
            assert gap == pytest.approx(0.0, abs=1e-14)
            assert own == pytest.approx(normal, abs=1e-11)
            assert at == pytest.approx(point, abs=1e-11)
            assert pair.margin(*after, found[0].numbers) > 0.0
        assert pair.margin(*after, pair.renewed(*after, found[0].numbers)) > 0.0


@pytest.mark.parametrize("kinds", [("cylinder", "cylinder"), ("cone", "disc"), ("disc", "cylinder")], ids="-".join)
def test_a_row_is_a_number_where_one_rim_touches_along_the_axis_of_the_other(kinds):
    """As where a cylinder that lies on an end rolls off it; the reach of a rim along its axis was a root of round-off."""
    chance, bodies = np.random.default_rng(5), tuple(BODIES[kind][0] for kind in kinds)
    pair = SmoothPair(*bodies, 8)
    for _ in range(20):
        numbers = np.array([0.5 * np.pi, 0.0]), chance.uniform(0.8, 2.3), chance.uniform(-1.0, 1.0, 2)
        poses, normal, point = touching(kinds, numbers, Rotation.random(rng=chance))
        rows = [row_of(bodies, found, poses) for found in pair.touching(*poses, 1e-13)]
        assert min(np.linalg.norm(at - point) for _, _, at in rows) < 1e-11
        for gap, own, _ in rows:
            assert gap == pytest.approx(0.0, abs=1e-13)
            assert own == pytest.approx(normal, abs=1e-11)


def beside_thin(kind, chance, radius, sizes, apart):
    """The poses of a disc of a radius and a body of a kind, apart along its normal at a random place.

    :param sizes: the radius and the length of a cylinder or a cone, the half axes of an ellipsoid.
    """
    spin = Rotation.random(rng=chance)
    normal, tangent, angle = spin.apply(UP), spin.apply([1.0, 0.0, 0.0]), chance.uniform(0.0, np.pi)
    tilt, turned = chance.choice([-1, 1]) * chance.uniform(0.1, 1.5), Rotation.random(rng=chance).as_matrix()
    rotation, outward = frame(tangent, normal, tilt, chance.uniform(-1, 1))
    disc = Pose(apart * normal - radius * outward, rotation)
    if kind == "ellipsoid":
        own = turned.T @ normal
        arm = turned @ (sizes**2 * own / np.sqrt(np.sum((sizes * own) ** 2)))
        return disc, Pose(-arm, turned)
    width, length, _ = sizes
    less = width if kind == "slope" else 0.0  # of the radius, at the tip
    along = spin.apply([np.cos(angle), np.sin(angle), 0.0])
    axis = (length * along + less * normal) / np.hypot(length, less)
    radial = (length * normal - less * along) / np.hypot(length, less)
    share = chance.uniform(0.02, 0.98)
    arm = (width - share * less) * radial + (share - 0.5) * length * axis
    first = Rotation.from_rotvec(chance.uniform(0.0, np.pi) * axis).apply(radial)
    return disc, Pose(-arm, np.column_stack([first, np.cross(axis, first), axis]))


@pytest.mark.parametrize("kind", ["side", "slope", "ellipsoid"])
def test_a_rim_beside_a_body_of_any_size_is_apart(kind):
    """The search ended where both overlap along another normal, beside thin bodies often, and they entered each other."""
    chance = np.random.default_rng(6)
    for _ in range(40):
        radius, sizes = 0.25 * 10.0 ** chance.uniform(-0.4, 0.0), 0.25 * 10.0 ** chance.uniform(-1.5, 0.3, 3)
        bodies = {"ellipsoid": EllipsoidBody(HERE, np.eye(3), tuple(sizes))}
        bodies |= {"side": Barrel(HERE, UP, *sizes[:2]), "slope": ConeBody(HERE, UP, *sizes[:2])}
        pair = SmoothPair(Barrel(HERE, UP, radius, 0.0), bodies[kind], 8)
        for _ in range(20):
            apart = 10.0 ** chance.uniform(-5.0, -2.0)
            assert 0.0 < pair.distance(*beside_thin(kind, chance, radius, sizes, apart)) <= apart + 1e-12


def test_an_ellipsoid_above_the_tip_of_a_cone_is_apart():
    """However flat it is: steps from the best of some normals missed that of the tip, and they entered each other."""
    chance = np.random.default_rng(9)
    for _ in range(40):
        (width, length), axes = 0.25 * 10.0 ** chance.uniform(-1.5, 0.3, 2), 0.25 * 10.0 ** chance.uniform(-1.5, 0.0, 3)
        pair = SmoothPair(ConeBody(HERE, UP, width, length), EllipsoidBody(HERE, np.eye(3), tuple(axes)), 8)
        for _ in range(25):
            tilt, apart, turned = (
                chance.uniform(0.0, np.arctan2(length, width)),
                10.0 ** chance.uniform(-5.0, -2.0),
                Rotation.random(rng=chance),
            )
            normal = np.array([np.sin(tilt), 0.0, np.cos(tilt)])
            own = turned.inv().apply(-normal)
            arm = turned.apply(axes**2 * own / np.sqrt(np.sum((axes * own) ** 2)))
            poses = Pose(np.zeros(3), np.eye(3)), Pose(0.5 * length * UP + apart * normal - arm, turned.as_matrix())
            assert 0.0 < pair.distance(*poses) <= apart + 1e-12
