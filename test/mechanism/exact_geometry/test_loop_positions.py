"""The search of closed loops ends early where it gets nowhere, and not where it is merely slow."""

import dataclasses

import numpy as np

from mbd_sim.base.geometry.pose import Pose
from mbd_sim.files.load import load_mechanism
from mbd_sim.mechanism.exact_geometry.loop_positions import ATTEMPTS, ITERATIONS, Loops, _is_hopeless


def test_a_gap_that_is_halved_is_followed_and_one_that_stays_is_not():
    assert not any(_is_hopeless([0.5**n for n in range(count)]) for count in range(1, ITERATIONS))
    bouncing = 1.0 + 0.5 * np.random.default_rng(0).random(ITERATIONS)
    assert _is_hopeless(bouncing.tolist())


def test_loops_that_cannot_be_closed_are_given_up_early(monkeypatch):
    mechanism, placed, count = load_mechanism("four_bar"), Loops._placed, 0

    def counted(loops, q):
        nonlocal count
        count += 1
        return placed(loops, q)

    monkeypatch.setattr(Loops, "_placed", counted)
    assert Loops(mechanism).closed is not None and count < ITERATIONS
    joints = dict(mechanism.joints)
    pivot = joints["rocker_pivot"]
    joints["rocker_pivot"] = dataclasses.replace(pivot, parent_pose=Pose(np.array([9.0, 0.0, 0.0]), np.eye(3)))
    count = 0
    assert Loops(dataclasses.replace(mechanism, joints=joints)).closed is None
    assert count < ATTEMPTS * ITERATIONS
