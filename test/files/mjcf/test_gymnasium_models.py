"""Gymnasium's models for MuJoCo: their accelerations are MuJoCo's, without contacts, limits and the medium."""

from pathlib import Path

import gymnasium
import numpy as np
import pytest

from mbd_sim.files.load import load_mechanism
from test.generators.mechanisms import random_state
from test.oracles.mujoco_oracle import MujocoOracle, OwnAccelerations, import_mujoco

mujoco = import_mujoco()

FOLDER = Path(gymnasium.__file__).parent / "envs" / "mujoco" / "assets"


# Chains in a plane and in space, on rails and on a free base, with and without tendons; the rest are of the same kinds.
@pytest.mark.parametrize(
    "name", ["ant", "half_cheetah", "humanoid", "inverted_double_pendulum", "pusher", "reacher", "swimmer"]
)
def test_accelerations_are_those_of_mujoco(name):
    path = FOLDER / f"{name}.xml"
    mechanism, rng = load_mechanism(path), np.random.default_rng(5)
    oracle = MujocoOracle(mujoco, mujoco.MjModel.from_xml_path(str(path)))
    own = OwnAccelerations(mechanism)
    names = [actuator.name for actuator in mechanism.actuators][: oracle.model.nu]
    for _ in range(3):
        q, u, efforts = random_state(mechanism, rng)
        commands = oracle.commands(rng)
        exact = oracle.accelerations(q, u, efforts, commands)
        found = own(q, u, efforts, dict(zip(names, commands * oracle.model.actuator_gear[:, 0], strict=True)))
        assert np.max(np.abs(found - exact)) <= 2e-13 * np.max(np.abs(exact))
    assert np.all(oracle.data.nefc == 0)


def test_the_models_are_all_there():
    wanted = (
        "ant half_cheetah hopper humanoid humanoidstandup inverted_double_pendulum inverted_pendulum pusher reacher"
    )
    assert {*wanted.split(), "swimmer", "walker2d"} <= {path.stem for path in FOLDER.glob("*.xml")}
