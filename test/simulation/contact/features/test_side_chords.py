"""Round sides that lie across round ends: at places where they touch by construction, and cylinders that rock there."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mbd_sim.base.geometry.pose import Pose
from mbd_sim.mechanism.elements.contacts import Barrel, ConeBody
from mbd_sim.mechanism.elements.parts import Attachment
from mbd_sim.simulation.contact.features.round_bodies import SmoothPair
from test.simulation.contact.features.rocking import require_energy_and_spin, rocking
from test.simulation.contact.features.rows import row_of

HERE, RIM, SIDE, HALF, UP = Attachment("part", np.zeros(3)), 0.25, 0.1, 0.6, np.array([0.0, 0.0, 1.0])
ENDS = {
    "cylinder": (Barrel(HERE, UP, RIM, 0.4), 0.2),
    "disc": (Barrel(HERE, UP, RIM, 0.0), 0.0),
    "cone": (ConeBody(HERE, -UP, RIM, 0.4), 0.2),
}
ROLLER = Barrel(HERE, np.array([1.0, 0.0, 0.0]), SIDE, 2.0 * HALF)
KINDS = pytest.mark.parametrize(("kind", "order"), [("cylinder", 1), ("disc", -1), ("cone", 1), ("disc", 1)])


class Touching:
    """A roller that touches a rim at an `angle` behind its middle, seen from above from the direction of its axis.

    `rise` is the sine of the angle between this axis and the end; its middle is `along` the axis from where it touches.
    """

    def __init__(self, kind, rise, turn, angle, along):
        place = turn + np.pi + angle
        outward = np.array([np.cos(place), np.sin(place), 0.0])
        self.point = RIM * outward + ENDS[kind][1] * UP
        spin = Rotation.from_rotvec([0.0, 0.0, turn]) * Rotation.from_rotvec([0.0, -np.arcsin(rise), 0.0])
        axis = spin.apply([1.0, 0.0, 0.0])
        normal = np.cross(axis, np.cross(UP, outward))
        self.normal = normal / np.linalg.norm(normal) * np.sign(normal[2])
        self.pose = Pose(self.point + SIDE * self.normal + along * axis, spin.as_matrix())

    def poses(self, spin, order):
        """Those of the roller and of the end, turned by a rotation, in an order."""
        at = spin.apply(self.pose.position)
        return (Pose(at, spin.as_matrix() @ self.pose.rotation), Pose(np.zeros(3), spin.as_matrix()))[::order]


def points_of(bodies, found, poses):
    """The points at which features touch, from their rows."""
    return [row_of(bodies, each, poses)[2] for each in found]


@KINDS
def test_a_side_lies_on_both_ends_of_its_chord_or_on_its_own_end(kind, order):
    """One of the ends of the chord was found, perhaps that beyond the end of the side, where nothing touches."""
    chance, bodies = np.random.default_rng(5), (ROLLER, ENDS[kind][0])[::order]
    pair = SmoothPair(*bodies, 8)
    for number in range(8):
        turn, angle, spin = chance.uniform(-3, 3), chance.uniform(-1.4, 1.4), Rotation.random(rng=chance)
        chord = 2.0 * RIM * np.cos(angle)
        along = chance.uniform(chord - HALF, HALF) if number % 2 else HALF - chance.uniform(0.1, 0.9) * chord
        along = along if number % 2 else chord - along
        flat = Touching(kind, 0.0, turn, angle, along)
        axis = np.array([np.cos(turn), np.sin(turn), 0.0])
        expected = [flat.point + max(along - HALF, 0.0) * axis, flat.point + min(chord, along + HALF) * axis]
        poses = flat.poses(spin, order)
        points = points_of(bodies, pair.touching(*poses, 1e-13), poses)
        assert len(points) == 2
        for point in expected:
            assert min(np.linalg.norm(spin.apply(point) - each) for each in points) < 1e-9
        assert abs(pair.distance(*poses)) < 1e-13


@KINDS
def test_a_side_touches_the_rim_where_it_does_also_at_a_short_chord(kind, order):
    """Of a chord shorter than the steps around the rim with which the search begins, the deeper end was not found."""
    chance, pair = np.random.default_rng(8), SmoothPair(*(ROLLER, ENDS[kind][0])[::order], 8)
    for _ in range(60):
        rise, angle = 10.0 ** chance.uniform(-9.0, -0.3), chance.choice([-1, 1]) * chance.uniform(0.0, 1.55)
        touching = Touching(kind, rise, chance.uniform(-3, 3), angle, chance.uniform(0.1, 0.5))
        assert abs(pair.distance(*touching.poses(Rotation.random(rng=chance), order))) <= 1e-14


@KINDS
def test_each_end_of_a_chord_is_followed_as_the_side_rises_from_the_other_one(kind, order):
    """From flat on: the side leans against the rim at one end, with the numbers of before."""
    chance, bodies = np.random.default_rng(6), (ROLLER, ENDS[kind][0])[::order]
    pair = SmoothPair(*bodies, 8)
    for _ in range(6):
        turn, angle, spin = chance.uniform(-3, 3), chance.uniform(-1.3, 1.3), Rotation.random(rng=chance)
        flat = Touching(kind, 0.0, turn, angle, 0.3)
        before = flat.poses(spin, order)
        found = pair.touching(*before, 1e-13)
        points = points_of(bodies, found, before)
        (number,) = (k for k in (0, 1) if np.linalg.norm(points[k] - spin.apply(flat.point)) < 1e-9)
        raised = Touching(kind, 3e-4, turn, angle, 0.3)
        after = raised.poses(spin, order)
        gap, normal, point = row_of(bodies, found[number], after)
        assert gap == pytest.approx(0.0, abs=1e-14)
        assert normal == pytest.approx(order * spin.apply(raised.normal), abs=1e-11)
        assert point == pytest.approx(spin.apply(raised.point), abs=1e-11)
        assert pair.margin(*after, found[number].numbers) > 0.0
        assert pair.margin(*after, pair.renewed(*after, found[number].numbers)) > 0.0


@KINDS
def test_a_side_that_rises_is_handed_on_without_a_gap(kind, order):
    """From the end of a chord, which two signs tell apart, to the pair of a side and a rim that has none."""
    chance, bodies = np.random.default_rng(7), (ROLLER, ENDS[kind][0])[::order]
    pair = SmoothPair(*bodies, 8)
    for _ in range(6):
        turn, angle, spin = chance.uniform(-3, 3), chance.uniform(-1.3, 1.3), Rotation.random(rng=chance)
        keys = set()
        for rise in np.geomspace(1e-9, 0.9, 30):
            poses = Touching(kind, rise, turn, angle, 0.3).poses(spin, order)
            (features,) = pair.touching(*poses, 1e-13)
            assert pair.margin(*poses, features.numbers) > 0.0
            keys.add(features.key)
        assert len(keys) == 2


@pytest.mark.parametrize(("kind", "seed"), [("cylinder", 0), ("disc", 1), ("disc", 4), ("cone", 3)])
def test_a_roller_that_rocks_on_a_round_end_keeps_its_energy_and_its_spin_about_the_axis(kind, seed):
    require_energy_and_spin(rocking("cylinder", kind, seed))
