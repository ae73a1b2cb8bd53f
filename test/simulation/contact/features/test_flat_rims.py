"""Round ends that lie nearly flat on a block and hang over its edges: no jumps, and no overlap as their tilt grows."""

from __future__ import annotations

import itertools
import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mbd_sim import Simulation
from mbd_sim.base.geometry.pose import Pose
from mbd_sim.dynamics.contact.shapes import EXACT_TILT, FLAT_TILT
from mbd_sim.files.builders.bodies.contact_bodies import BLOCK
from mbd_sim.mechanism.elements.contacts import Barrel, ConeBody, Solid
from mbd_sim.mechanism.elements.parts import Attachment
from mbd_sim.simulation.contact.features.round_bodies import SmoothPair
from mbd_sim.simulation.contact.records import ContactChange

HERE, UP, RIM, HALF = Attachment("part", np.zeros(3)), np.array([0.0, 0.0, 1.0]), 0.25, np.array([0.3, 0.2, 0.2])
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * HALF
TABLE = Solid(HERE, CORNERS, BLOCK, 0.0)
ENDS = {  # and how far the rim is below the center of the body
    "disc": (Barrel(HERE, UP, RIM, 0.0), 0.0),
    "cylinder": (Barrel(HERE, UP, RIM, 0.1), 0.05),
    "cone": (ConeBody(HERE, UP, RIM, 0.1), 0.05),
}
KINDS = pytest.mark.parametrize(("kind", "order"), [("disc", 1), ("disc", -1), ("cylinder", 1), ("cone", -1)])


class Lying:
    """A round end above the table, with the center of its rim at a place, and with a tilt about a random axis."""

    def __init__(self, kind, order, chance, least, most):
        body, self.below = ENDS[kind]
        self.pair, self.order, self.spin = SmoothPair(*(body, TABLE)[::order], 16), order, Rotation.random(rng=chance)
        around, self.tilt = chance.uniform(-np.pi, np.pi), chance.uniform(least, most)
        turn = Rotation.from_rotvec(np.arcsin(self.tilt) * np.array([np.cos(around), np.sin(around), 0.0]))
        self.turn = (turn * Rotation.from_rotvec([0.0, 0.0, chance.uniform(-np.pi, np.pi)])).as_matrix()

    def distance(self, place):
        """That of the narrow phase, with the center of the rim at a place (3,) above the middle of the face."""
        at = np.array(place) + HALF[2] * UP + self.below * self.turn[:, 2]
        end = Pose(self.spin.apply(at), self.spin.as_matrix() @ self.turn)
        return self.pair.distance(*(end, Pose(np.zeros(3), self.spin.as_matrix()))[:: self.order])

    def lowest(self, place, count=20000):
        """The lowest point above the face, which is on the rim, or a corner of the face beneath the end."""
        angles = np.linspace(0.0, 2.0 * np.pi, count)
        rim = RIM * np.array([np.cos(angles), np.sin(angles), 0.0 * angles]).T @ self.turn.T + place
        above = rim[np.all(np.abs(rim[:, :2]) <= HALF[:2], axis=1)]
        normal, corners = self.turn[:, 2], CORNERS[CORNERS[:, 2] > 0.0][:, :2]
        heights = place[2] - (corners - place[:2]) @ normal[:2] / normal[2]
        arms = np.column_stack([corners, heights]) - place
        return min([*above[:, 2], *heights[np.linalg.norm(arms, axis=1) <= RIM]])

    def touching(self, place):
        """The place (3,) above or below another one at which it touches the face, or None if it touches no face."""
        place = np.array(place)
        for _ in range(6):
            apart = self.distance(place)
            if abs(apart) <= 1e-11:
                return None if abs(place[2]) > 1.1 * RIM * self.tilt + 2e-3 * RIM else place
            place -= apart * UP
        return None


@KINDS
def test_an_end_that_slides_over_edges_and_corners_does_not_jump(kind, order):
    """Points of its rim protruded as soon as they came above the face, but not the rim beside them, nor corners."""
    chance, count, seen = np.random.default_rng(3), 200, 0
    for _ in range(6):
        lying = Lying(kind, order, chance, 0.0, 0.9 * FLAT_TILT)
        start, stop = (np.array([*chance.uniform(-0.4, 0.4, 2), 0.0]) for _ in range(2))
        way = [lying.touching(start + share * (stop - start)) for share in np.linspace(0.0, 1.0, count)]
        for before, after in itertools.pairwise(way):
            if before is not None and after is not None:
                seen += 1
                assert abs(after[2] - before[2]) <= 0.1 * np.linalg.norm(stop - start) / count
    assert seen > 300


@KINDS
def test_an_end_that_touches_does_not_overlap_the_table_where_its_rim_becomes_exact(kind, order):
    """By which it would be thrown out again; nearly flat, it may between the points that carry it, by a little."""
    chance, seen = np.random.default_rng(4), 0
    for number in range(40):
        least, most = ((0.97, 1.0), (0.0, 2.0))[number % 2]
        lying = Lying(kind, order, chance, least * EXACT_TILT, 0.99 * most * EXACT_TILT)
        place = lying.touching([*chance.uniform(-1.0, 1.0, 2) * (HALF[:2] + 0.5 * RIM), 0.0])
        if place is None:
            continue
        seen += 1
        assert lying.lowest(place) >= (-1e-7 if number % 2 == 0 else -4e-4 * RIM)
    assert seen > 15


@pytest.mark.parametrize(("kind", "order"), [("disc", 1), ("disc", -1), ("cone", 1)])
def test_an_end_that_strikes_a_side_of_the_table_is_not_above_its_face(kind, order):
    """It seemed to be as deep as it was below the face when its rim came to be beneath this by round-off."""
    chance = np.random.default_rng(5)
    for _ in range(20):
        lying = Lying(kind, order, chance, 0.0, 0.9 * FLAT_TILT)
        reach = RIM * np.sqrt(1.0 - lying.turn[0, 2] ** 2)
        for apart in (1e-5, -1e-7):
            place = [HALF[0] + reach + apart, 0.3 * HALF[1], -0.1 * RIM]
            assert lying.distance(place) == pytest.approx(apart, abs=1e-12)


def falling(kind, place, seed, step, friction=0.2):
    """A round end that falls flat on two of its points, and slides with the arc between them over an edge or corner."""
    chance = np.random.default_rng([seed, 17])
    aside, around = chance.uniform(-0.5, 0.5), chance.uniform(-0.5, 0.5)
    to, around = (HALF[:2], 0.75 + 0.7 * around) if place == "corner" else ([HALF[0], aside * HALF[1]], 0.0)
    outward, speed = np.array([np.cos(around), np.sin(around)]), chance.uniform(0.2, 0.8)
    center = to - (RIM + speed * chance.uniform(0.004, 0.01)) * outward
    tilt, lean = 10 ** chance.uniform(-3.3, -2.3), around + chance.uniform(-0.4, 0.4)
    turn = Rotation.from_rotvec(tilt * np.array([-np.sin(lean), np.cos(lean), 0.0]))
    turn *= Rotation.from_rotvec([0.0, 0.0, around + np.pi / 6 + chance.uniform(-0.3, 0.3)])
    above = turn.apply([0.0, 0.0, 0.0 if kind == "disc" else 0.04]) + np.array([*center, 1.05 * RIM * tilt])
    simulation = Simulation.from_text(end_and_table(kind), step=step, live=["contacts.c.friction"])
    simulation.set_live({"contacts.c.friction": friction})
    simulation.reset([*above, *np.roll(turn.as_quat(), 1)], [*(speed * outward), 0.0, 0.0, 0.0, 0.0])
    return simulation


def end_and_table(kind):
    """One mechanism for all starts of a kind, which is built once."""
    shape = {"type": kind, "radius": RIM, "mass": 1} | ({} if kind == "disc" else {"length": 0.08})
    table = {"type": "block", "size": [*(2.0 * HALF)], "at": [0, 0, -HALF[2]], "mass": 1}
    end = {"type": "free", "between": ["ground", "end"], "position": [0, 0, 1]}
    joints = {"table": {"type": "fixed", "between": ["ground", "table"]}, "end": end}
    parts = {"end": {"shape": shape}, "table": {"shape": table}}
    contacts = {"c": {"between": ["end", "table"], "friction": 0.2}}
    return json.dumps({"mechanism": "falling", "parts": parts, "joints": joints, "contacts": contacts})


FALLING = [("disc", "edge", 0, 5e-4), ("disc", "edge", 16, 5e-4), ("disc", "corner", 22, 5e-4)]
FALLING += [("cylinder", "edge", 17, 5e-4), ("cylinder", "edge", 37, 2e-3)]


@pytest.mark.parametrize(("kind", "place", "seed", "step"), FALLING)
def test_an_end_that_falls_flat_over_an_edge_keeps_its_energy(kind, place, seed, step):
    """The arc was within the edge as it came there, and was pushed out, or had events without end.

    Or its energy was wrong, where another point of the edge began to bear it at a velocity of its own; and an edge that
    comes to lie flat on the end, within it, was new there.
    """
    simulation = falling(kind, place, seed, step)
    simulation.run(until=0.026)
    assert simulation.contact_event_count > 10
    assert all(event.change is not ContactChange.BOUND for event in simulation.contact_events)
    assert abs(simulation.energies.residual) < 1e-10


@pytest.mark.parametrize(("kind", "seed"), [("disc", 19), ("disc", 21), ("cylinder", 17)])
def test_an_edge_beneath_an_arc_does_not_stop_an_end(kind, seed):
    """The arc, which is within the edge, struck it as a wedge would: ends without friction were stopped or thrown back.

    Their velocity along the face can only change as far as they are tilted.
    """
    simulation = falling(kind, "edge", seed, 5e-4, friction=0.0)
    start = simulation.u[:2].copy()
    simulation.run(until=0.03)
    turn = Rotation.from_quat(np.roll(simulation.q[3:7], -1)).as_matrix()
    assert np.hypot(*turn[:2, 2]) < 0.1 * FLAT_TILT
    assert np.linalg.norm(simulation.u[:2] - start) < 3e-4 * np.linalg.norm(start)
    assert abs(simulation.energies.residual) < 1e-10


@pytest.mark.parametrize("order", [1, -1])
def test_an_end_beside_a_block_that_is_parallel_to_a_face_is_as_far_as_their_sides(order):
    """Also level with that face: what was far beneath the end gave the distance, and they passed through each other."""
    chance = np.random.default_rng(1)
    for _ in range(20):
        half, radius = 0.1 * 10.0 ** chance.uniform(-1.0, 0.3, 3), 0.25 * 10.0 ** chance.uniform(-1.0, 0.3)
        length = chance.choice([0.0, 0.3]) * radius
        block = Solid(HERE, np.sign(CORNERS) * half, BLOCK, 0.0)
        pair = SmoothPair(*(Barrel(HERE, UP, radius, length), block)[::order], 8)
        for _ in range(15):
            around, apart = chance.uniform(0.0, 2.0 * np.pi), 10.0 ** chance.uniform(-5.0, -2.0)
            turn = Rotation.from_rotvec(
                chance.uniform(0.0, EXACT_TILT) * np.array([np.cos(around), np.sin(around), 0.0])
            )
            axis, normal = (
                turn.apply(UP),
                np.array([*chance.normal(size=2), chance.choice([0.0, 1.0]) * chance.normal()]),
            )
            normal[2] *= 0.3 * np.linalg.norm(normal[:2])
            normal /= np.linalg.norm(normal)
            corner = half * np.where(normal == 0.0, chance.uniform(-1.0, 1.0), np.sign(normal))
            outward = normal - (normal @ axis) * axis
            rim = radius * outward / np.linalg.norm(outward) + 0.5 * length * np.sign(normal @ axis) * axis
            end = Pose(corner + apart * normal + rim, turn.as_matrix())
            assert 0.0 < pair.distance(*(end, Pose(np.zeros(3), np.eye(3)))[::order]) <= apart + 1e-12
