"""SDF read by Drake: its poses and accelerations are ours, of files that others and that we write."""

import numpy as np
import pytest

from mbd_sim import Kinematics
from mbd_sim.load import parse_mechanism
from test.generators.mechanisms import random_state
from test.oracles.mujoco_oracle import OwnAccelerations
from test.sdf.models import PENDULUM, ROBOT

pytest.importorskip("pydrake", reason="needs the extra 'robots': pip install '.[robots]'")

from test.oracles.drake_oracle import DrakeOracle


@pytest.mark.parametrize("text", [ROBOT.replace('type="ball"', 'type="fixed"'), PENDULUM], ids=["robot", "pendulum"])
def test_poses_and_accelerations(text):
    mechanism, oracle = parse_mechanism(text), DrakeOracle(text)
    own, rng = OwnAccelerations(mechanism), np.random.default_rng(1)
    kinematics = Kinematics(mechanism)
    for _ in range(3):
        q, u, _ = random_state(mechanism, rng, reach=1.0)
        oracle.set_state(mechanism, q, u)
        for name, pose in kinematics.poses(q).items():
            theirs = oracle.pose(name)
            np.testing.assert_allclose(pose.position, theirs.translation(), rtol=0, atol=1e-14)
            np.testing.assert_allclose(pose.rotation, theirs.rotation().matrix(), rtol=0, atol=1e-14)
        exact = oracle.accelerations(mechanism)
        found = own(q, u, np.zeros(len(u)))
        assert np.max(np.abs(found - exact)) <= 1e-11 * np.max(np.abs(exact))
