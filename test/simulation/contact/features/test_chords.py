"""Cylinders and cones that lie with their sides on round ends: both ends of the chord carry them."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mbd_sim import Simulation
from mbd_sim.base.geometry.pose import Pose
from mbd_sim.mechanism.elements.contacts import Barrel, ConeBody
from mbd_sim.mechanism.elements.parts import Attachment
from mbd_sim.simulation.contact.features.round_bodies import SmoothPair
from test.simulation.contact.features.rows import row_of

HERE, UP, RIM, WIDE, LONG = Attachment("part", np.zeros(3)), np.array([0.0, 0.0, 1.0]), 0.25, 0.1, 1.2
ENDS = {  # and the height of the end
    "cylinder": (Barrel(HERE, UP, RIM, 0.4), 0.2),
    "disc": (Barrel(HERE, UP, RIM, 0.0), 0.0),
    "cone": (ConeBody(HERE, -UP, RIM, 0.4), 0.2),
}
BARS = {
    "cylinder": (Barrel(HERE, UP, WIDE, LONG), 0.0),
    "cone": (ConeBody(HERE, UP, WIDE, LONG), WIDE / np.hypot(WIDE, LONG)),
}
KINDS = pytest.mark.parametrize(
    ("bar", "end", "order"),
    [("cylinder", "cylinder", 1), ("cone", "disc", -1), ("cylinder", "cone", 1), ("cone", "cylinder", -1)],
)


def lying(bar, ruling, normal, point, along):
    """The pose of a bar that touches a point with its ruling, at a distance from its middle along this."""
    cosine = BARS[bar][1]
    sine = np.sqrt(1.0 - cosine**2)
    axis = sine * ruling - cosine * normal
    radial = -(normal + cosine * axis) / sine
    half = LONG / sine / 2.0  # of the ruling
    base = point - (half + along) * ruling - WIDE * radial
    return Pose(base + 0.5 * LONG * axis, np.column_stack([radial, np.cross(axis, radial), axis]))


class OnEnd:
    """A bar across a round end, whose chord has a direction and passes its axis aside, at a rise from one of its ends."""

    def __init__(self, bar, end, turn, aside, along, rise=0.0, sign=1):
        level, left = np.array([np.cos(turn), np.sin(turn), 0.0]), np.array([-np.sin(turn), np.cos(turn), 0.0])
        half = np.sqrt(RIM**2 - aside**2)
        self.points = [aside * left + k * half * level + ENDS[end][1] * UP for k in (-1, 1)]
        outward = (self.points[(sign + 1) // 2] - ENDS[end][1] * UP) / RIM
        ruling = np.cos(rise) * level - sign * np.sin(rise) * UP  # it sinks beyond this end, and rises at the other one
        self.normal = np.cross(ruling, np.cross(UP, outward))
        self.normal *= np.sign(self.normal[2]) / np.linalg.norm(self.normal)
        self.pose = lying(bar, ruling, self.normal, self.points[(sign + 1) // 2], sign * half + along)

    def poses(self, spin, order):
        """Those of the bar and of the end, turned by a rotation, in an order."""
        return (
            Pose(spin.apply(self.pose.position), spin.as_matrix() @ self.pose.rotation),
            Pose(np.zeros(3), spin.as_matrix()),
        )[::order]


@KINDS
def test_a_side_lies_on_both_ends_of_its_chord(bar, end, order):
    """One of both was found, and which one was round-off: a bar never came to rest. Each is followed as it rises."""
    chance, bodies = np.random.default_rng(5), (BARS[bar][0], ENDS[end][0])[::order]
    pair = SmoothPair(*bodies, 8)
    for _ in range(4):
        numbers = chance.uniform(-3, 3), chance.uniform(-0.95, 0.95) * RIM, chance.uniform(-0.1, 0.1)
        spin, flat = Rotation.random(rng=chance), OnEnd(bar, end, *numbers)
        found = pair.touching(*flat.poses(spin, order), 1e-13)
        assert abs(pair.distance(*flat.poses(spin, order))) <= 1e-13
        assert len(found) == 2
        ends = [row_of(bodies, each, flat.poses(spin, order)) for each in found]
        for sign, place in zip((-1, 1), flat.points, strict=True):
            (k,) = (k for k in (0, 1) if np.linalg.norm(ends[k][2] - spin.apply(place)) < 1e-9)
            assert ends[k][0] == pytest.approx(0.0, abs=1e-13)
            assert ends[k][1] == pytest.approx(order * spin.apply(UP), abs=1e-10)
            assert pair.margin(*flat.poses(spin, order), found[k].numbers) > 0.0
            raised = OnEnd(bar, end, *numbers, 3e-5, sign)
            gap, normal, point = row_of(bodies, found[k], raised.poses(spin, order))
            assert gap == pytest.approx(0.0, abs=1e-13)
            assert normal == pytest.approx(order * spin.apply(raised.normal), abs=1e-10)
            assert point == pytest.approx(spin.apply(place), abs=1e-9)
            assert pair.margin(*raised.poses(spin, order), found[k].numbers) > 0.0


@KINDS
def test_a_short_chord_is_carried_by_its_middle_alone(bar, end, order):
    chance = np.random.default_rng(6)
    pair = SmoothPair(*(BARS[bar][0], ENDS[end][0])[::order], 8)
    for _ in range(8):
        aside = RIM * np.sqrt(1.0 - 10.0 ** chance.uniform(-12.0, -6.1))
        spin, flat = Rotation.random(rng=chance), OnEnd(bar, end, chance.uniform(-3, 3), aside, 0.0)
        found = pair.touching(*flat.poses(spin, order), 1e-13)
        assert len(found) == 1
        assert pair.margin(*flat.poses(spin, order), found[0].numbers) > 0.0


@KINDS
@pytest.mark.parametrize("rise", [3e-3, 0.03, 0.3])
def test_a_side_that_rises_from_the_end_touches_it_once(bar, end, order, rise):
    """Where the chord is short, both of its ends are between two of the directions around the rim that were tried."""
    chance, bodies = np.random.default_rng(8), (BARS[bar][0], ENDS[end][0])[::order]
    pair = SmoothPair(*bodies, 8)
    for k in range(12):
        numbers = chance.uniform(-3, 3), chance.uniform(-0.97, 0.97) * RIM, chance.uniform(-0.1, 0.1)
        spin, risen = Rotation.random(rng=chance), OnEnd(bar, end, *numbers, rise, 1 - 2 * (k % 2))
        assert abs(pair.distance(*risen.poses(spin, order))) <= 1e-13
        (found,) = pair.touching(*risen.poses(spin, order), 1e-13)
        gap, normal, point = row_of(bodies, found, risen.poses(spin, order))
        assert gap == pytest.approx(0.0, abs=1e-13)
        assert normal == pytest.approx(order * spin.apply(risen.normal), abs=1e-11)
        assert point == pytest.approx(spin.apply(risen.points[1 - k % 2]), abs=1e-11)
        assert pair.margin(*risen.poses(spin, order), found.numbers) > 0.0


def simulation(bar, end, order, pose, restitution=0.0, friction=0.0, velocity=(0.0,) * 6):
    """A bar above a round end that is fixed, at a start: one mechanism for all starts of a kind."""
    size = {"cone": {"length": 0.4, "axis": [0, 0, -1], "at": [0, 0, 0.2]}, "cylinder": {"length": 0.4}, "disc": {}}[
        end
    ]
    base = [0, 0, -0.5 * LONG if bar == "cone" else 0.0]
    shapes = {
        "bar": {"type": bar, "radius": WIDE, "length": LONG, "mass": 1, "at": base},
        "end": {"type": end, "radius": RIM, "mass": 1, **size},
    }
    joints = {"bar": {"type": "free", "between": ["ground", "bar"], "position": [0, 0, 2]}}
    joints["end"] = {"type": "fixed", "between": ["ground", "end"]}
    contact = {"between": ["bar", "end"][::order], "restitution": 0, "friction": 0}
    parts = {name: {"shape": shape} for name, shape in shapes.items()}
    data = {"mechanism": "across", "parts": parts, "joints": joints, "contacts": {"c": contact}}
    laws = {"contacts.c.restitution": restitution, "contacts.c.friction": friction}
    sim = Simulation.from_text(json.dumps(data), step=1e-3, live=list(laws))
    sim.set_live(laws)
    x, y, z, w = Rotation.from_matrix(pose.rotation).as_quat()
    sim.reset([*pose.position, w, x, y, z], velocity)
    return sim


@pytest.mark.parametrize(("end", "order", "seed"), [("cylinder", 1, 0), ("disc", -1, 1)])
def test_a_bar_rests_on_both_ends_of_its_chord_with_the_forces_of_a_lever(end, order, seed):
    chance = np.random.default_rng(seed)
    turn, aside, along = chance.uniform(-3, 3), chance.uniform(-0.8, 0.8) * RIM, chance.uniform(-0.05, 0.05)
    lying_flat = OnEnd("cylinder", end, turn, aside, along)
    sim = simulation("cylinder", end, order, lying_flat.pose, friction=0.6)
    sim.run(until=0.05)
    closed = {
        tuple(np.round(state.point, 9)): state.normal for state in sim.contacts().values() if state.state != "open"
    }
    half, (first, last) = np.sqrt(RIM**2 - aside**2), (tuple(np.round(point, 9)) for point in lying_flat.points)
    middle = -along  # of the bar, from that of the chord
    assert closed[first] == pytest.approx(9.81 * (half - middle) / (2.0 * half), rel=1e-9)
    assert closed[last] == pytest.approx(9.81 * (half + middle) / (2.0 * half), rel=1e-9)
    assert len(closed) == 2 and np.abs(sim.u).max() < 1e-12


ORDERS = {("cylinder", "cylinder"): 1, ("cylinder", "disc"): -1, ("cone", "cone"): -1}


@pytest.mark.parametrize(
    ("bar", "end", "seed"), [("cylinder", "cylinder", 0), ("cylinder", "disc", 2), ("cone", "cone", 3)]
)
def test_a_bar_that_rocks_on_a_round_end_keeps_its_energy_and_its_spin_about_the_axis(bar, end, seed):
    """No force on the rim or the end has a moment about the axis, so that impacts do not change that spin either."""
    chance = np.random.default_rng([seed, 7])
    numbers = chance.uniform(-3, 3), chance.uniform(-0.3, 0.3) * RIM, chance.uniform(-0.02, 0.02), 0.02
    above = OnEnd(bar, end, *numbers).pose
    pose = Pose(above.position + 0.01 * UP, above.rotation)
    velocity = [*(0.1 * chance.normal(size=3)), *(0.5 * chance.normal(size=3))]
    sim = simulation(bar, end, ORDERS[bar, end], pose, 0.3 * (seed % 2), velocity=velocity)
    begun = sim.momentum([0, 0, 0]).angular[2]
    while sim.time < 0.5 and sim.q[2] > 0.0:
        sim.step(10)
        assert sim.momentum([0, 0, 0]).angular[2] == pytest.approx(begun, abs=1e-12)
    assert sim.contact_event_count > 4
    assert abs(sim.energies.residual) < 5e-9  # by contacts that are found within 1e-9 m
