"""Kinematics and the terms of the equations of motion of robots, against Pinocchio.

The robots of example-robot-data and Pinocchio come with the extra 'robots'; what is missing is skipped.
"""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.files.load import parse_mechanism
from test.generators.mechanisms import random_state
from test.generators.urdf_robots import arm, quadruped

pin = pytest.importorskip("pinocchio", reason="needs the extra 'robots': pip install '.[robots]'")

from test.oracles.urdf_oracle import Oracle  # noqa: E402

FOLDERS = [Path(place) / "cmeel.prefix" / "share" / "example-robot-data" / "robots" for place in sys.path]
ROBOTS = next((folder for folder in FOLDERS if folder.is_dir()), None)
CASES = [
    ("panda_description/urdf/panda.urdf", "fixed"),
    ("ur_description/urdf/ur5_robot.urdf", "fixed"),
    ("kinova_description/robots/kinova.urdf", "fixed"),
    ("xarm_description/urdf/xarm7.urdf", "fixed"),
    ("anymal_c_simple_description/urdf/anymal.urdf", "free"),
    ("solo_description/robots/solo12.urdf", "free"),
]
OWN = {"arm": (arm(), "fixed"), "quadruped": (quadruped(), "free")}
EXACT = 1e-10


def text_of(path):
    return re.sub(r"<mimic[^>]*/>", "", (ROBOTS / path).read_text(encoding="utf-8"))


def compared(text, base):
    mechanism, rng = parse_mechanism(text, base=base), np.random.default_rng(4)
    sim, oracle = Simulation(mechanism, method="rk4"), Oracle(pin, text, mechanism, base == "free")
    for _ in range(2):
        q, u, efforts = random_state(mechanism, rng)
        sim.reset()
        y = sim.state
        y[sim.model.q_range], y[sim.model.u_range] = q, u
        sim.restore(y, 0)
        sim.set_efforts(np.clip(efforts, -sim.effort_map.limits, sim.effort_map.limits))
        compare_terms(sim, oracle)
        compare_frames(sim, oracle)


def close(found, expected):
    np.testing.assert_allclose(found, expected, rtol=0, atol=EXACT * (1.0 + np.max(np.abs(expected), initial=0.0)))


def compare_terms(sim, oracle):
    model, data = oracle.model, oracle.data
    q, v, turn, w = oracle.state(sim.q, sim.u)
    mass = pin.crba(model, data, q)
    mass = np.triu(mass) + np.triu(mass, 1).T  # only the upper triangle is computed
    close(sim.mass_matrix(), turn.T @ mass @ turn)
    close(sim.bias_terms(), turn.T @ (pin.nonLinearEffects(model, data, q, v) + mass @ w))
    close(sim.gravity_terms(), turn.T @ pin.computeGeneralizedGravity(model, data, q))
    rates = oracle.accelerations(sim.q, sim.u, sim.efforts)
    close(sim.u_rates, rates)
    close(sim.forward_dynamics(), rates)
    wanted = np.cos(np.arange(len(sim.u)))
    efforts = turn.T @ pin.rnea(model, data, q, v, turn @ wanted + w) + oracle.losses(sim.u)
    close(sim.inverse_dynamics(wanted), efforts)
    momentum = pin.computeCentroidalMomentum(model, data, q, v)
    own = sim.momentum(data.com[0])
    close(own.linear, momentum.linear)
    close(own.angular, momentum.angular)
    acceleration = turn @ sim.u_rates + w
    pin.centerOfMass(model, data, q, v, acceleration)
    center, share = sim.center_of_mass, data.mass[0] / sim.mechanism.mass  # links on ground have no part in Pinocchio's
    close(center.velocity, share * data.vcom[0])
    close(center.acceleration, share * data.acom[0])
    close(center.jacobian, share * pin.jacobianCenterOfMass(model, data, q) @ turn)
    if share > 1.0 - 1e-12:
        close(center.position, data.com[0])


def compare_frames(sim, oracle):
    """Frames of Pinocchio's joints, which are those of our parts, in the axes of the world."""
    model, data, aligned = oracle.model, oracle.data, pin.LOCAL_WORLD_ALIGNED
    q, v, turn, w = oracle.state(sim.q, sim.u)
    pin.forwardKinematics(model, data, q, v, turn @ sim.u_rates + w)
    pin.updateFramePlacements(model, data)
    pin.computeJointJacobiansTimeVariation(model, data, q, v)
    bodies = {re.sub(r"\W+", "_", frame.name): n for n, frame in enumerate(model.frames) if frame.type == pin.BODY}
    for name in [name for name in sim.mechanism.parts if name in bodies][-1::-6]:
        frame, number = sim.frame(name), bodies[name]
        placement = data.oMf[number]
        close(frame.position, placement.translation)
        close(frame.rotation, placement.rotation)
        velocity = pin.getFrameVelocity(model, data, number, aligned)
        close(frame.velocity, velocity.linear)
        close(frame.angular_velocity, velocity.angular)
        acceleration = pin.getFrameClassicalAcceleration(model, data, number, aligned)
        close(frame.acceleration, acceleration.linear)
        close(frame.angular_acceleration, acceleration.angular)
        jacobian = pin.getFrameJacobian(model, data, number, aligned)
        close(frame.jacobian, jacobian @ turn)
        rate = pin.getFrameJacobianTimeVariation(model, data, number, aligned)
        close(frame.bias_acceleration, rate @ v + jacobian @ w)
        close(frame.jacobian_rate @ sim.u, frame.bias_acceleration)


@pytest.mark.parametrize("name", OWN)
def test_generated_robots(name):
    compared(*OWN[name])


@pytest.mark.skipif(ROBOTS is None, reason="needs the extra 'robots': pip install '.[robots]'")
@pytest.mark.parametrize(("path", "base"), CASES, ids=[Path(path).stem for path, _ in CASES])
def test_robots_of_example_robot_data(path, base):
    compared(text_of(path), base)
