"""Sharp edges at the rims of round ends: at places where they touch by construction, and discs that slide off a table."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mbd_sim import Simulation
from mbd_sim.base.geometry.pose import Pose
from mbd_sim.dynamics.contact.smooth_rows import ITERATED
from mbd_sim.files.builders.bodies.contact_bodies import BLOCK
from mbd_sim.mechanism.elements.contacts import Barrel, Solid
from mbd_sim.mechanism.elements.parts import Attachment
from mbd_sim.simulation.contact.features.round_bodies import SmoothPair
from mbd_sim.simulation.contact.records import ContactChange

HERE, UP, RIM, HALF = Attachment("part", np.zeros(3)), np.array([0.0, 0.0, 1.0]), 0.25, np.array([0.6, 0.2, 0.2])
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * HALF
CYLINDER, BODY = Barrel(HERE, UP, RIM, 0.4), Solid(HERE, CORNERS, BLOCK, 0.0)


def touching(rise, half, along, spin, order):
    """A block that touches the top of a cylinder with an edge, at one end of a chord, and rises from there.

    :param rise: the sine of the angle between the edge and the end; `half` is half of the chord over the radius.
    :param along: where the middle of the edge is, in m from this end.
    """
    aside = np.sqrt(1.0 - half**2)
    outward = np.array([half, aside, 0.0])  # seen from above, at the end of the chord with the larger x
    edge = np.array([-np.sqrt(1.0 - rise**2), 0.0, rise])
    normal = np.cross(edge, np.cross(UP, outward))
    normal *= np.sign(normal[2]) / np.linalg.norm(normal)
    down = -normal  # the bisector of both faces at the edge
    side = np.cross(down, edge)
    axes = np.column_stack([edge, (down + side) / np.sqrt(2.0), (down - side) / np.sqrt(2.0)])
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    point = RIM * outward + 0.2 * UP
    block = Pose(point + along * edge - axes @ [0.0, HALF[1], HALF[2]], axes)
    poses = (block, Pose(np.zeros(3), np.eye(3)))
    return tuple(Pose(spin.apply(each.position), spin.as_matrix() @ each.rotation) for each in poses)[::order]


@pytest.mark.parametrize("order", (1, -1))
def test_an_edge_touches_a_rim_also_near_the_end_of_its_chord_that_vanishes(order):
    """There the normal is found by no iteration: bodies seemed to be in each other as the chord became short."""
    chance, pair = np.random.default_rng(3), SmoothPair(*(BODY, CYLINDER)[::order], 8)
    for _ in range(60):
        half = 10.0 ** chance.uniform(-3.6, -0.2)
        rise = half * 10.0 ** chance.uniform(-6.0, -1.0)
        poses = touching(rise, half, chance.uniform(0.1, 0.5), Rotation.random(rng=chance), order)
        assert abs(pair.distance(*poses)) < 1e-13


@pytest.mark.parametrize("order", (1, -1))
def test_a_short_chord_is_carried_by_its_middle_alone(order):
    """An edge with another normal beside it would push along a direction that nothing determines."""
    chance, pair = np.random.default_rng(4), SmoothPair(*(BODY, CYLINDER)[::order], 8)
    for _ in range(20):
        half = chance.uniform(2e-4, 9e-4)
        poses = touching(half * 1e-4, half, chance.uniform(0.1, 0.5), Rotation.random(rng=chance), order)
        (features,) = pair.touching(*poses, 1e-9)
        assert not features.numbers[16 + ITERATED]


@pytest.mark.parametrize("order", (1, -1))
def test_a_step_ends_where_a_chord_has_changed_by_a_quarter(order):
    """Its ends run along the rim ever faster as it vanishes, so that no step may lead there at once."""
    spin, pair = Rotation.from_rotvec([0.3, 0.2, -0.1]), SmoothPair(*(BODY, CYLINDER)[::order], 8)
    first, near, far = (touching(1e-6, half, 0.3, spin, order) for half in (0.1, 0.08, 0.07))
    for features in pair.touching(*first, 1e-9):
        assert pair.margin(*first, features.numbers) > 0.0
        assert pair.margin(*near, features.numbers) > 0.0 > pair.margin(*far, features.numbers)
        assert pair.margin(*far, pair.renewed(*far, features.numbers)) > 0.0


@pytest.mark.parametrize("order", (1, -1))
def test_a_step_ends_where_the_lowest_point_of_a_rim_has_run_around_it(order):
    """It does so the faster, the flatter the rim lies."""
    pair, plate = SmoothPair(*(CYLINDER, BODY)[::order], 8), Pose(np.array([0.0, 0.0, -HALF[2]]), np.eye(3))

    def poses(around, tilt=0.1):
        turn = Rotation.from_rotvec([0, 0, around]) * Rotation.from_rotvec([0, tilt, 0])
        lowest = RIM * np.sin(tilt) + 0.2 * np.cos(tilt)
        return (Pose(np.array([0.2, 0.0, lowest]), turn.as_matrix()), Pose(plate.position, plate.rotation))[::order]

    (features,) = pair.touching(*poses(0.0), 1e-9)
    assert pair.margin(*poses(0.1), features.numbers) > 0.0 > pair.margin(*poses(0.2), features.numbers)
    assert pair.margin(*poses(0.2), pair.renewed(*poses(0.2), features.numbers)) > 0.0


def test_the_normal_of_an_edge_at_a_rim_may_turn_by_less_near_its_axis():
    """From farther away, the three steps of a row lead past it: the support of a rim has a kink along its axis."""
    spin, pair = Rotation.from_rotvec([0.3, 0.2, -0.1]), SmoothPair(BODY, CYLINDER, 8)

    def poses(tilt):
        return touching(np.sin(np.arctan(0.6 * np.tan(tilt))), 0.6, 0.3, spin, 1)

    for tilt in (0.6, 0.8):
        (features,) = pair.touching(*poses(tilt), 1e-9)
        assert (
            pair.margin(*poses(0.93 * tilt), features.numbers)
            > 0.0
            > pair.margin(*poses(0.85 * tilt), features.numbers)
        )


SLIDING = {"disc": (0.11, -1), "cone": (0.13, 1), "cylinder": (0.08, -1)}  # the radius, and the order of both bodies


def table_and_end(kind):
    """A round body on a table with the edge x = 0, without friction: one mechanism for all starts of a kind."""
    rim, order = SLIDING[kind]
    shape = {"type": kind, "radius": rim, "mass": 1} | ({} if kind == "disc" else {"length": 0.08})
    table = {"type": "block", "size": [0.2, 1, 0.1], "at": [-0.1, 0, -0.05], "mass": 1}
    joint = {"type": "free", "between": ["ground", "end"], "position": [0, 0, 1]}
    joints = {"table": {"type": "fixed", "between": ["ground", "table"]}, "end": joint}
    contact = {"between": ["end", "table"][::order], "restitution": 0}
    parts = {"end": {"shape": shape}, "table": {"shape": table}}
    return json.dumps({"mechanism": "sliding", "parts": parts, "joints": joints, "contacts": {"c": contact}})


def sliding(kind, seed):
    """A round body that falls on the table near its edge and slides over it."""
    chance, rim = np.random.default_rng([seed, 11]), SLIDING[kind][0]
    simulation = Simulation.from_text(table_and_end(kind), step=1e-3, live=["contacts.c.restitution"])
    simulation.set_live({"contacts.c.restitution": 0.3 * (seed % 2)})
    height = 0.45 * rim + (0.0 if kind == "disc" else 0.045)
    place = [*(rim * chance.uniform(-0.6, 0.6, 2)), height]
    x, y, z, w = Rotation.from_euler("xyz", [*(0.15 * chance.normal(size=2)), chance.normal()]).as_quat()
    velocity, spin = chance.uniform([0.0, -0.2, 0.0], [0.5, 0.2, 0.1]), chance.normal(size=3)
    simulation.reset([*place, w, x, y, z], [*velocity, *spin])
    return simulation


SEEDS = [("disc", 4), ("disc", 15), ("cone", 2), ("cone", 16), ("cylinder", 1), ("cylinder", 7)]
SEEDS += [("cone", 13), ("cone", 17), ("cylinder", 20)]  # edges within the end push it while it leans along them
SEEDS += [("disc", 2), ("disc", 12), ("cone", 18), ("cylinder", 18)]  # the end begins to be bent at edges


@pytest.mark.parametrize(("kind", "seed"), SEEDS)
def test_a_round_body_that_slides_over_an_edge_keeps_its_energy_and_its_momentum_along_it(kind, seed):
    """No force at the table, its edge or its side is along the edge; what hung over it sank into the table."""
    simulation = sliding(kind, seed)
    begun = simulation.momentum().linear[1]
    while simulation.time < 0.5 and simulation.q[2] > -0.1:
        simulation.step(10)
        assert simulation.momentum().linear[1] == pytest.approx(begun, abs=1e-12)
        assert all(event.change is not ContactChange.BOUND for event in simulation.contact_events)
    assert simulation.contact_event_count > 5
    assert abs(simulation.energies.residual) < 5e-9
