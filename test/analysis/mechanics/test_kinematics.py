"""Positions without masses: poses and points, the report and the picture of a robot without inertia."""

import json

import numpy as np
import pytest

from mbd_sim import Kinematics, NoInertiaError, Simulation, load_mechanism, parse_mechanism
from mbd_sim.cli.main import main

GRIPPER = """<robot name="gripper"><link name="base_link"/><link name="arm"/><link name="finger"/>
  <joint name="lift" type="prismatic"><origin xyz="0 0 1"/><parent link="base_link"/><child link="arm"/>
    <axis xyz="0 0 1"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint>
  <joint name="turn" type="continuous"><origin xyz="0.5 0 0"/><parent link="arm"/><child link="finger"/>
    <axis xyz="0 0 1"/></joint>
</robot>"""
CRANK = """
mechanism: driven_crank
parts:
  crank: {mass: 0, points: {tip: [0.5, 0, 0]}}
  rod: {mass: 0, points: {tip: [1, 0, 0]}}
  block: {mass: 3}
joints:
  motor: {type: revolute, between: [ground, crank], axis: [0, 0, 1], drive: 2*t}
  slide: {type: prismatic, between: [ground, block], axis: [1, 0, 0], position: 1.5, guess: true}
  pin: {type: revolute, between: [crank.tip, rod], axis: [0, 0, 1], drive: -2*t - asin(0.5*sin(2*t))}
constraints:
  end: {type: distance, between: [crank.tip, block], length: 1}
"""


@pytest.fixture
def gripper():
    return parse_mechanism(GRIPPER, "gripper.urdf")


def test_poses_of_a_robot_without_inertia(gripper):
    kinematics = Kinematics(gripper)
    assert kinematics.start.tolist() == [0.0, 0.0]
    pose = kinematics.poses([0.25, np.pi / 2])["finger"]
    assert pose.position == pytest.approx([0.5, 0.0, 1.25])
    assert pose.rotation @ [1.0, 0.0, 0.0] == pytest.approx([0.0, 1.0, 0.0])
    assert kinematics.point("arm.turn", [0.25, 0.0]) == pytest.approx([0.5, 0.0, 1.25])
    with pytest.raises(ValueError, match=r"there is no point 'arm.trun'. Did you mean 'arm.turn'"):
        kinematics.point("arm.trun")
    with pytest.raises(ValueError, match=r"q must be a list of 2 values, .* in this order: lift, turn"):
        kinematics.poses([0.0])


def test_its_dynamics_say_what_is_missing(gripper):
    with pytest.raises(NoInertiaError) as error:
        Simulation(gripper)
    assert [problem.key for problem in error.value.problems] == ["joint[lift]", "joint[turn]"]
    assert "has mass: 'finger' is a massless chain end. Give the part a mass, fix it" in str(error.value)


def test_check_reports_and_draws_it(capsys, tmp_path):
    file, picture = tmp_path / "gripper.urdf", tmp_path / "gripper.png"
    file.write_text(GRIPPER, encoding="utf-8")
    assert main(["check", str(file), "--draw", str(picture), "--inertia"]) == 1
    out = capsys.readouterr().out
    assert "Degrees of freedom  2  (coordinates: lift, turn)" in out
    assert f"Dynamics            not defined: {file}:2: joint[lift]: nothing that this joint moves has mass" in out
    assert picture.stat().st_size > 5000
    assert main(["check", str(file), "--json"]) == 1
    assert len(json.loads(capsys.readouterr().out)["dynamics"]) == 2
    assert main(["run", str(file), "--quiet"]) == 1


def test_poses_agree_with_those_of_a_simulation():
    mechanism = load_mechanism("four_bar")
    kinematics, simulation = Kinematics(mechanism), Simulation(mechanism)
    simulation.run(until=0.5)
    for name, pose in simulation.poses().items():
        found = kinematics.poses(simulation.q)[name]
        assert found.position == pytest.approx(pose.position, abs=1e-13)
    off = simulation.q + 0.01
    closed = kinematics.closed(off)
    assert np.max(np.abs(closed - simulation.q)) < 0.03
    assert np.max(np.abs(kinematics.constraints.position(0.0, closed))) < 1e-10


def test_driven_joints_need_no_mass_beyond_them():
    simulation = Simulation(parse_mechanism(CRANK))
    simulation.run(until=1.0)
    x = 0.5 * np.cos(2.0) + np.sqrt(1.0 - (0.5 * np.sin(2.0)) ** 2)
    assert simulation.poses()["block"].position[0] == pytest.approx(x, abs=1e-9)
    assert simulation.poses()["rod"].position == pytest.approx(0.5 * np.array([np.cos(2.0), np.sin(2.0), 0.0]))
    assert abs(simulation.energies.residual) < 1e-9
