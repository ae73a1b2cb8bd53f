"""Capsules at the rims of round ends, from steep to flat: at places where they touch by construction."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mbd_sim import Simulation
from mbd_sim.base.geometry.pose import Pose
from mbd_sim.mechanism.elements.contacts import Barrel, ConeBody, Solid
from mbd_sim.mechanism.elements.parts import Attachment
from mbd_sim.simulation.contact.features.round_bodies import SmoothPair
from test.simulation.contact.features.rocking import require_energy_and_spin, rocking
from test.simulation.contact.features.rows import row_of

HERE, RIM, EDGE, HALF = Attachment("part", np.zeros(3)), 0.25, 0.1, 0.6
UP = np.array([0.0, 0.0, 1.0])
ENDS = {
    "cylinder": (Barrel(HERE, UP, RIM, 0.4), 0.2),
    "disc": (Barrel(HERE, UP, RIM, 0.0), 0.0),
    "cone": (ConeBody(HERE, -UP, RIM, 0.4), 0.2),
}
CAPSULE = Solid(HERE, np.array([[-HALF, 0.0, 0.0], [HALF, 0.0, 0.0]]), (), EDGE)
KINDS = pytest.mark.parametrize(("kind", "order"), [("cylinder", 1), ("disc", -1), ("cone", 1), ("cylinder", -1)])


class Touching:
    """A capsule that touches a rim, which is at the `angle`, from its direction seen from above, behind its middle.

    The capsule is turned about the vertical, and `rise` is the sine of its angle with the end. The normal is across
    the capsule and the rim, and leads out of the end.
    """

    def __init__(self, kind, rise, turn, angle, along):
        place = turn + np.pi + angle
        self.outward = np.array([np.cos(place), np.sin(place), 0.0])
        self.point = RIM * self.outward + ENDS[kind][1] * UP
        spin = Rotation.from_rotvec([0.0, 0.0, turn]) * Rotation.from_rotvec([0.0, -np.arcsin(rise), 0.0])
        normal = np.cross(spin.apply([1.0, 0.0, 0.0]), np.cross(UP, self.outward))
        self.normal = normal / np.linalg.norm(normal) * np.sign(normal[2])
        self.pose = Pose(self.point + EDGE * self.normal + along * spin.apply([1.0, 0.0, 0.0]), spin.as_matrix())

    def poses(self, spin, order, apart=0.0):
        """Those of the capsule and of the end, turned by a rotation, in an order."""
        at = spin.apply(self.pose.position + apart * self.normal)
        return (Pose(at, spin.as_matrix() @ self.pose.rotation), Pose(np.zeros(3), spin.as_matrix()))[::order]


@KINDS
def test_a_capsule_touches_where_it_does_and_not_where_it_is_apart(kind, order):
    """However flat it lies, where the normal is all but that of the end."""
    chance, pair = np.random.default_rng(3), SmoothPair(*(CAPSULE, ENDS[kind][0])[::order], 2)
    for _ in range(40):
        rise, apart = 10.0 ** chance.uniform([-12.0, -12.0], [-0.3, -2.0])
        touching = Touching(kind, rise, chance.uniform(-3, 3), chance.uniform(-1.5, 1.5), chance.uniform(0.1, 0.5))
        spin = Rotation.random(rng=chance)
        assert abs(pair.distance(*touching.poses(spin, order))) <= 5e-15
        assert 0.0 < pair.distance(*touching.poses(spin, order, apart)) <= apart + 5e-15


@KINDS
def test_a_row_follows_a_capsule_that_comes_to_lie_on_the_end(kind, order):
    """In a step in which it turns by a third of its rise: steps from the last normal led past the next one."""
    chance, bodies = np.random.default_rng(4), (CAPSULE, ENDS[kind][0])[::order]
    pair = SmoothPair(*bodies, 2)
    for _ in range(12):
        rise, turn = 10.0 ** chance.uniform(-9.0, -0.7), chance.uniform(-3, 3)
        angle, along, spin = chance.uniform(-1.0, 1.0), chance.uniform(0.1, 0.5), Rotation.random(rng=chance)
        before = Touching(kind, rise, turn, angle, along)
        (features,) = pair.touching(*before.poses(spin, order), 1e-13)
        after = Touching(kind, 0.67 * rise, turn + 0.02, angle - 0.01, along + 0.01)
        for each in (before, after):
            gap, normal, point = row_of(bodies, features, each.poses(spin, order))
            assert gap == pytest.approx(0.0, abs=1e-14)
            assert normal == pytest.approx(order * spin.apply(each.normal), abs=1e-12)
            assert point == pytest.approx(spin.apply(each.point), abs=1e-12)
        renewed = pair.renewed(*after.poses(spin, order), features.numbers)
        assert pair.margin(*after.poses(spin, order), renewed) > 0.0


@KINDS
def test_a_capsule_lies_on_both_ends_of_its_chord(kind, order):
    """Each of them is followed as it rises at the other one."""
    chance, bodies = np.random.default_rng(5), (CAPSULE, ENDS[kind][0])[::order]
    pair = SmoothPair(*bodies, 2)
    for _ in range(8):
        turn, angle, spin = chance.uniform(-3, 3), chance.uniform(-1.4, 1.4), Rotation.random(rng=chance)
        flat = Touching(kind, 0.0, turn, angle, 0.3)
        other = Touching(kind, 0.0, turn + np.pi, -angle, 0.0)
        found = pair.touching(*flat.poses(spin, order), 1e-13)
        points = [row_of(bodies, each, flat.poses(spin, order))[2] for each in found]
        assert len(found) == 2
        for end, back in ((flat, 1), (other, -1)):
            (number,) = (k for k in (0, 1) if np.linalg.norm(points[k] - spin.apply(end.point)) < 1e-9)
            raised = Touching(kind, 3e-4, turn + (0.0 if back == 1 else np.pi), back * angle, 0.3 if back == 1 else 0.0)
            if back == -1:  # the same capsule from its other end
                raised.pose = Pose(raised.pose.position, raised.pose.rotation @ np.diag([-1.0, -1.0, 1.0]))
            gap, normal, _ = row_of(bodies, found[number], raised.poses(spin, order))
            assert gap == pytest.approx(0.0, abs=1e-14)
            assert normal == pytest.approx(order * spin.apply(raised.normal), abs=1e-12)
            assert pair.margin(*raised.poses(spin, order), found[number].numbers) > 0.0


@pytest.mark.parametrize(("kind", "seed"), [("cylinder", 0), ("cylinder", 9), ("disc", 7), ("disc", 22), ("cone", 14)])
def test_a_capsule_that_rocks_on_a_round_end_keeps_its_energy_and_its_spin_about_the_axis(kind, seed):
    require_energy_and_spin(rocking("capsule", kind, seed))


def shot(kind, axes, along, offset):
    """A capsule that flies in its direction at a round body, aside by an offset, in the plane of the first two axes."""
    x, _, z = axes.T.tolist()
    joint, across = {"type": "planar", "axis": z, "x_axis": x}, np.array([-along[1], along[0]])
    flight = {"position": [*(0.4 * along + offset * across), np.arctan2(along[1], along[0])], "velocity": [*-along, 0]}
    size = {"radius": 0.1} | ({"length": 0.1} if kind == "cylinder" else {})
    shapes = {
        "bar": {"type": "capsule", "radius": 0.03, "length": 0.2, "axis": x, "mass": 1},
        "round": {"type": kind, **size, "axis": z, "mass": 1},
    }
    return {
        "mechanism": "shot",
        "gravity": [0, 0, 0],
        "parts": {name: {"shape": shape} for name, shape in shapes.items()},
        "joints": {
            "bar": {**joint, "between": ["ground", "bar"], **flight},
            "round": {**joint, "between": ["ground", "round"]},
        },
        "contacts": {"c": {"between": ["bar", "round"], "restitution": 1}},
    }


@pytest.mark.parametrize(("kind", "is_turned"), [("disc", False), ("disc", True), ("ring", True), ("cylinder", True)])
def test_a_capsule_strikes_what_its_line_passes_through(kind, is_turned):
    """In the plane of a disc there is no normal where its line meets the rim; it flew into the disc."""
    chance = np.random.default_rng(7)
    angle, offset = chance.uniform(0, 2 * np.pi), chance.uniform(-0.09, 0.09)
    flat = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    axes = Rotation.random(rng=chance).as_matrix() if is_turned else flat
    along = np.array([np.cos(angle), np.sin(angle)])
    sim = Simulation.from_text(json.dumps(shot(kind, axes, along, offset)))
    ahead = np.sqrt(0.13**2 - offset**2)  # of the end of the capsule, when it touches
    normal = (ahead * along + offset * np.array([-along[1], along[0]])) / 0.13
    sim.run(until=0.3 - ahead + 0.01)
    (velocity, spin), struck = (sim.u[:2], sim.u[2]), sim.u[3:5]
    end = velocity + 0.1 * spin * np.array([along[1], -along[0]])
    assert (end - struck) @ normal == pytest.approx(along @ normal, abs=1e-12)  # as fast as it came
    assert struck == pytest.approx((struck @ normal) * normal, abs=1e-12) and sim.u[5] == pytest.approx(0, abs=1e-12)
    assert velocity + struck == pytest.approx(-along, abs=1e-12)
    assert abs(sim.energies.residual) < 1e-14
