"""Robots as mechanism files for the comparison, and MuJoCo's model of them."""

import importlib.util
import math
from xml.etree import ElementTree

import numpy as np
import pytest

from benchmarks.judge import Judge
from benchmarks.measure import STEP, difference
from benchmarks.mechanisms import shipped
from benchmarks.plan import robot_plan
from benchmarks.robots import POSITION, SPEED, started
from mbd_sim.files.load import parse_mechanism

LINK = '<link name="{}"><inertial><mass value="{}"/><origin xyz="0.1 0.2 -0.3"/><inertia {}/></inertial></link>'
ROUND = 'ixx="0.01" iyy="0.02" izz="0.02" ixy="0.001" ixz="0" iyz="0.002"'
IMPOSSIBLE = 'ixx="0.01" iyy="0.01" izz="0.04" ixy="0" ixz="0" iyz="0"'
JOINT = (
    '<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/><origin xyz="0 0.3 0.1" rpy="0.1 0.2 0.3"/>'
    '<axis xyz="{4}"/><dynamics damping="2" friction="1"/><limit lower="-1" upper="1" effort="5" velocity="2"/></joint>'
)
# The joints of the second branch are declared first: MuJoCo has them last.
URDF = "".join([
    '<robot name="dog">', LINK.format("trunk", 10, ROUND), LINK.format("thigh", 2, ROUND),
    LINK.format("shank", 1, ROUND), LINK.format("tail", 0.5, ROUND), LINK.format("foot", 0.3, IMPOSSIBLE),
    JOINT.format("hip", "revolute", "trunk", "thigh", "0 1 0"), JOINT.format("wag", "prismatic", "trunk", "tail", "1 0 0"),
    JOINT.format("knee", "revolute", "thigh", "shank", "0 1 1"), JOINT.format("ankle", "fixed", "shank", "foot", "1 0 0"),
    "</robot>",
])  # fmt: skip


@pytest.fixture(scope="module")
def floating():
    text = started(parse_mechanism(URDF, base="free").source.data)
    return robot_plan(text), Judge(text)


def test_a_robot_starts_in_motion_without_losses(floating):
    plan, judge = floating
    mechanism = judge.sim.mechanism
    assert plan.names == ("hip", "wag", "knee") and plan.floating and (len(plan.q), len(plan.u)) == (10, 9)
    assert np.all(np.abs(plan.q[7:]) <= POSITION) and np.all(np.abs(plan.u[6:]) <= SPEED)
    assert np.all(plan.q[7:]) and np.all(plan.u[6:]) and not np.any(plan.u[:6])
    assert not any(np.any(joint.damping) or joint.friction or joint.limits for joint in mechanism.joints.values())
    np.testing.assert_allclose(mechanism.parts["foot"].inertia, 0.02 * np.eye(3))
    np.testing.assert_allclose(mechanism.parts["shank"].inertia[0], [0.01, 0.001, 0.0])


def test_the_tape_of_a_floating_robot_has_the_rates_of_its_quaternion(floating):
    plan, judge = floating
    q, u = plan.random_states(1)[0]
    found = np.array(plan.tape.run([*q, *u], math.sin, math.cos))
    w, v, omega = q[3], q[4:7], u[3:6]  # the angular velocity is in the axes of the base
    np.testing.assert_allclose(found[:3], u[:3])
    np.testing.assert_allclose(found[3:7], 0.5 * np.array([-v @ omega, *(w * omega + np.cross(v, omega))]), atol=1e-14)
    np.testing.assert_allclose(found[7:10], u[6:])
    np.testing.assert_allclose(found[10:], judge.accelerations(q, u), rtol=1e-11)


def test_loops_and_other_joints_are_refused():
    ball = "mechanism: ball\nparts: {bob: {mass: 1, inertia: [1, 1, 1]}}\njoints: {pin: {type: spherical, between: [ground, bob]}}"
    with pytest.raises(ValueError, match="ball: only hinges and sliders"):
        robot_plan(ball)
    with pytest.raises(ValueError, match="four_bar: only trees"):
        robot_plan(shipped("four_bar"))


@pytest.mark.skipif(not importlib.util.find_spec("mujoco"), reason="MuJoCo is not installed")
def test_mujoco_has_the_same_robot(floating):
    from benchmarks.engines.mujoco import MuJoCo, exported

    plan, judge = floating
    engine = MuJoCo(plan, STEP, "RK4")
    assert difference(plan, judge, engine) < 1e-12
    written = ElementTree.fromstring(exported(plan, STEP, "RK4"))
    assert not written.findall(".//geom") and not written.findall(".//site") and len(written.findall("option")) == 1
    engine.reset(plan.q, plan.u)
    engine.many(3000)
    assert judge.error(*engine.state()) < 1e-7
