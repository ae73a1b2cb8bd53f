"""Known distances bound others, whatever happened between the poses."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from mbd_sim.base.geometry import rotation as rot
from mbd_sim.base.geometry.pose import Pose, pack_poses
from mbd_sim.simulation.contact.compiled.pairs import (
    KNOWN,
    MEMORY,
    PATH,
    SEEN,
    FeaturePair,
    at_least,
    is_far,
    note,
    path_between,
    see,
    spheres_apart,
    travel,
)
from mbd_sim.simulation.contact.features.narrow_phase import Bounds
from mbd_sim.simulation.contact.features.polytopes import PolytopePair
from test.simulation.contact.features.solids import block, random_pose, rod


def packed(*poses):
    return pack_poses(np.array([pose.position for pose in poses]), np.array([pose.rotation for pose in poses])).ravel()


def remembered(bounds, first, second):
    """A pair of the bodies with these rows of poses; only what bounds its distance."""
    memory = np.zeros(MEMORY)
    memory[[KNOWN, SEEN]] = -np.inf
    one, other = bounds
    centers, radii = np.concatenate([one.center, other.center]), np.array([one.radius, other.radius])
    own = first, second, centers, radii, np.ones(3), 0, np.zeros(0), *[0] * 7, memory
    return FeaturePair(0, 0, 0, 0, 0, 0, False, -1, *own)


def test_bounds_are_below_the_distances_after_any_motion():
    """Bodies that turn and move, of which the spheres are not around the origins of their parts."""
    pair = PolytopePair(block(0.2, 0.3, 0.1), rod(0.4, 0.03), 2, None)
    known = remembered(pair.bounds, 1, 0)
    chance, near = np.random.default_rng(1), []
    assert at_least(known, packed(*(random_pose(chance, 1.0) for _ in range(2)))) == -np.inf
    for _ in range(40):
        start = [random_pose(chance, 1.0) for _ in range(2)]
        note(known, packed(*start), pair.distance(start[1], start[0]))
        moved = []
        for pose in start:
            axis, size = rot.unit(chance.normal(size=3)), chance.uniform(0, 0.3)
            moved.append(Pose(pose.position + size * chance.normal(size=3), rot.about(axis, 3 * size) @ pose.rotation))
        distance, bound = pair.distance(moved[1], moved[0]), at_least(known, packed(*moved))
        assert bound <= distance + 1e-15
        assert spheres_apart(known, packed(*moved)) <= distance + 1e-15
        near.append(distance - bound)
    assert min(near) < 0.2


def test_an_infinite_plane_bounds_as_long_as_it_does_not_turn():
    known = remembered((Bounds(np.zeros(3), 0.1), Bounds(np.zeros(3), np.inf)), 0, 1)
    still = Pose(np.zeros(3), np.eye(3))
    high = Pose(np.array([0.0, 0.0, 1.0]), np.eye(3))
    note(known, packed(high, still), 0.9)
    lower = Pose(np.array([0.0, 0.0, 0.8]), np.eye(3))
    assert at_least(known, packed(lower, still)) == pytest.approx(0.7)
    tilted = Pose(np.zeros(3), rot.about(np.array([1.0, 0.0, 0.0]), 1e-3))
    assert at_least(known, packed(lower, tilted)) == -np.inf
    assert path_between(known, packed(lower, still), packed(lower, tilted)) == np.inf


def test_bodies_that_are_passed_over_are_far_from_each_other():
    """Ways that are forgotten where a state jumps, or turned bodies whose spheres are not around the origins."""
    pair = PolytopePair(block(0.2, 0.3, 0.1), rod(0.4, 0.03), 2, None)
    known, chance = remembered(pair.bounds, 1, 0), np.random.default_rng(2)
    reaches = np.array([np.linalg.norm(bounds.center) for bounds in (pair.bounds[1], pair.bounds[0])])
    memory = [reaches, *np.zeros((2, 2)), np.zeros(24)]
    c = SimpleNamespace(
        places=24, accuracy=1e-12, reaches=reaches, stepped=memory[1], travelled=memory[2], latest=memory[3]
    )
    poses, passed = [random_pose(chance, 0.5) for _ in range(2)], 0
    for number in range(400):
        if number % 40 == 0:  # a reset
            poses = [random_pose(chance, 0.5) for _ in range(2)]
        before, moved = packed(*poses), []
        for pose in poses:
            axis, size = rot.unit(chance.normal(size=3)), chance.uniform(0, 0.05)
            moved.append(Pose(pose.position + size * chance.normal(size=3), rot.about(axis, 3 * size) @ pose.rotation))
        after, poses = packed(*moved), moved
        travel(c, before, after)
        if is_far(c, known):
            passed += 1
            assert spheres_apart(known, before) + spheres_apart(known, after) > PATH * path_between(
                known, before, after
            )
        else:
            see(c, known, after)
    assert 20 < passed < 380
