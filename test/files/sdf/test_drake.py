"""SDF read by Drake: its poses and accelerations are ours, of files that others and that we write."""

import re

import numpy as np
import pytest

from mbd_sim import Kinematics
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.files.sdf.writer import to_sdf
from test.files.sdf.models import PENDULUM, ROBOT
from test.files.sdf.test_writer import JOINTS
from test.generators.mechanisms import random_state
from test.oracles.mujoco_oracle import OwnAccelerations

pytest.importorskip("pydrake", reason="needs the extra 'robots': pip install '.[robots]'")

from test.oracles.drake_oracle import DrakeOracle


def written(mechanism):
    """Its SDF without dry friction, which Drake does not read."""
    return re.sub(r"<friction>.*?</friction>", "", to_sdf(mechanism).text)


def for_drake(text):
    """Without what Drake does not read: springs of universal joints, dampers that differ, axes that are not perpendicular."""
    without = text.replace(", stiffness: [3, 4], damping: [0.1, 0.2]", "")
    return without.replace("spherical", "fixed").replace("[1, 1, 0]]", "[0, 1, 0]]")


FILES = {
    "robot": lambda: ROBOT.replace('type="ball"', 'type="fixed"'),  # Drake's ball joints have other coordinates
    "pendulum": lambda: PENDULUM,
    "double_rod": lambda: written(load_mechanism("double_rod")),
    "six_axis_arm": lambda: written(load_mechanism("six_axis_arm")),
    "joints": lambda: written(parse_mechanism(for_drake(JOINTS))),
}


@pytest.mark.parametrize("name", FILES)
def test_poses_and_accelerations(name):
    text = FILES[name]()
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
