"""Bodies in contact move alike in any world, frames and order and split, until chaos amplifies round-off.

How fast a scene amplifies differences is measured with a start that differs by `NEARBY`: descriptions of one scene may
differ by as much as starts that differ by `ROUND_OFF` would.
"""

from __future__ import annotations

import json

import numpy as np

from mbd_sim import Simulation
from test.generators.body_scenes import PAIRS, scene, throw
from test.generators.changed_scenes import (
    other_frames,
    random_turn,
    reversed_order,
    turned_world,
    welded,
)

NEARBY, ROUND_OFF = 1e-9, 1e-11
CHAOS = 1e-4  # difference from the nearby start, from which on nothing is compared
SAMPLE, SAMPLES = 5, 100  # steps between comparisons, and comparisons
MOST = 8  # events; later ones bring bodies to rest, which multiplies differences faster than a nearby start shows
SHIFT = np.array([0.3, -0.2, 0.5])


def simulation(data):
    return Simulation.from_text(json.dumps(data), method="tsitouras8")


def events_while_equal(data, changed, seed):
    """How many events a scene has while it is compared with the same one described otherwise; they must move alike."""
    first, other = simulation(data), simulation(changed)
    nearby = first.copy()
    throw(first, np.random.default_rng(seed))
    q, u, rng = first.q.copy(), first.u.copy(), np.random.default_rng([seed, 1])
    nearby.reset(q + NEARBY * rng.normal(size=q.size), u + NEARBY * rng.normal(size=u.size), nearest_speeds=True)
    other.reset(q, u, nearest_speeds=True)
    grown, counted = 1.0, 0
    for _ in range(SAMPLES):
        for each in (first, nearby, other):
            each.step(SAMPLE)
        grown = max(grown, difference(first, nearby) / NEARBY)
        if grown * NEARBY > CHAOS or first.contact_event_count > MOST:
            break
        assert difference(first, other) < ROUND_OFF * grown
        counted = first.contact_event_count
    return counted


def difference(one, other):
    return max(np.abs(one.q - other.q).max(), np.abs(one.u - other.u).max())


def turned(data, rng):
    """In other frames and another order, with parts split in two, in axes along which nothing lies."""
    return turned_world(welded(other_frames(reversed_order(data), rng)), random_turn(rng), SHIFT)


def test_a_scene_in_a_plane():
    """Prisms in the plane xz, and, in a turned world, with the rows and the narrow phase of space."""
    seed = 4  # a corner that meets beside one that touches
    data = json.loads(scene(seed, "plane_loop"))
    assert events_while_equal(data, turned(data, np.random.default_rng(seed)), seed) > 3


def test_two_bodies_in_space():
    seed = PAIRS.index(("ellipsoid", "hull")) + len(PAIRS)
    data = json.loads(scene(seed, "space_pair"))
    assert events_while_equal(data, turned(data, np.random.default_rng(seed)), seed) > 0
