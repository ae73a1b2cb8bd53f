"""A mechanism written as MJCF: MuJoCo's accelerations of it are ours, and read again it is the same."""

from dataclasses import replace

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.cli.main import main
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.files.mjcf.writer import to_mjcf
from mbd_sim.files.sdf.writer import to_sdf
from test.files.mjcf.models import BODIES, EQUALITIES, LINKS
from test.generators.mechanisms import AUDITED, FLOATING, consistent_state, random_state
from test.oracles.mujoco_oracle import MujocoOracle, OwnAccelerations, import_mujoco

mujoco = import_mujoco()

JOINTS = """
mechanism: joints
parts:
  wheel: {mass: 2, shape: {type: disc, radius: 0.3}, points: {rim: {at: [0.3, 0, 0], rotate: {rpy: [0.3, 0.2, 0.1]}}}}
  collar: {mass: 1, shape: {type: cylinder, radius: 5 cm, length: 10 cm}}
  bob: {mass: 1, center: [0, 0.1, -1], inertia: [0.02, 0.03, 0.01]}
  puck: {mass: 0.5, shape: {type: cylinder, radius: 8 cm, length: 3 cm}, points: {end: {at: [0, 0.1, 0], rotate: {rpy: [1, 0, 0]}}}}
  top: {mass: 0.5, shape: {type: disc, radius: 0.1, at: [0, 0, 0.2]}}
  flier: {mass: 0.3, inertia: [0.01, 0.02, 0.02], points: {back: {at: [0, 0, 0.1], rotate: {rpy: [0, 1, 0]}}}}
joints:
  hinge: {type: revolute, between: [wheel.rim, ground], axis: [0, 0, 1], damping: 0.1}
  guide: {type: cylindrical, between: [wheel.rim, collar], axis: [0, 1, 1], stiffness: [80, 2], rest: [0.1, 0], damping: [1, 2]}
  cross: {type: universal, between: [bob, collar], axes: [[1, 0, 0], [1, 1, 0]], position: [0, 40 deg], stiffness: [3, 4]}
  table: {type: planar, between: [ground, puck.end], axis: [0, 0, 1], x_axis: [1, 1, 0]}
  point: {type: spherical, between: [puck, top], orientation: {axis: [0, 1, 0], angle: 30 deg}, damping: 0.02}
  flight: {type: free, between: [ground, flier.back], position: [1, 2, 3]}
"""
FORCES = """
mechanism: forces
ground: {points: {wall: [-1, 0, 0.5]}}
parts:
  cart: {mass: 2, points: {hook: [0.2, 0, 0.1]}}
  arm: {mass: 1, shape: {type: rod, to: [0, 0, -0.7]}, points: {tip: [0, 0, -0.7]}}
joints:
  rail: {type: prismatic, between: [ground, cart], axis: [1, 0, 0], position: 0.1}
  pin: {type: revolute, between: [cart, arm], axis: [0, 1, 0], position: 0.3}
forces:
  spring: {type: spring, between: [ground.wall, arm.tip], stiffness: 30, length: 0.8, damping: 0.5}
  strut: {type: damper, between: [ground.wall, cart.hook], coefficient: 2}
actuators:
  push: {type: effort, joint: rail, effort_limit: 3, rotor_inertia: 0.001, lead: 10 mm}
  hold: {type: effort, joint: pin, servo: {controls: position, kp: 20, kd: 2}, gear_ratio: 30, rotor_inertia: 1e-5}
"""


def written(mechanism):
    model = mujoco.MjModel.from_xml_string(to_mjcf(mechanism).text)
    return MujocoOracle(mujoco, model), OwnAccelerations(mechanism)


def order(mechanism, model):
    """For each of MuJoCo's speeds the index of ours: joints of MuJoCo are in the order of the tree."""
    names = list(mechanism.coordinate_names)
    found = []
    for index in range(model.njnt):
        joint = model.joint(index)
        count = {mujoco.mjtJoint.mjJNT_FREE: 6, mujoco.mjtJoint.mjJNT_BALL: 3}.get(int(joint.type[0]), 1)
        first = joint.name if count == 1 else f"{joint.name}.x" if count == 6 else f"{joint.name}.rx"
        found += range(names.index(first), names.index(first) + count)
    return np.array(found)


@pytest.mark.parametrize("name", ["double_rod", "six_axis_arm"])
def test_shipped_trees(name):
    mechanism = load_mechanism(name)
    oracle, own = written(mechanism)
    rng = np.random.default_rng(1)
    for _ in range(3):
        q, u, efforts = random_state(mechanism, rng)
        exact = own(q, u, efforts)
        found = oracle.accelerations(q, u, efforts)
        assert np.max(np.abs(found - exact)) <= 1e-10 * np.max(np.abs(exact))


def mapped(mechanism, oracle, q, u):
    """MuJoCo's qpos and qvel for our q and u, by the writer of the start."""
    moved = replaced_start(mechanism, q, u)
    key = mujoco.MjModel.from_xml_string(to_mjcf(moved).text).key("start")
    return np.array(key.qpos), np.array(key.qvel)


def replaced_start(mechanism, q, u):
    """The mechanism with other start values."""
    joints, in_q, in_u = {}, 0, 0
    for name, joint in mechanism.joints.items():
        nq, nv = joint.kind.nq, joint.kind.nv
        joints[name] = replace(joint, position=q[in_q : in_q + nq], velocity=u[in_u : in_u + nv])
        in_q, in_u = in_q + nq, in_u + nv
    return replace(mechanism, joints=joints)


TREES = {"joints": JOINTS, "audited": AUDITED.replace(", STOP", ""), "floating": FLOATING}


@pytest.mark.parametrize("name", TREES)
def test_every_type_of_joint_in_both_directions(name):
    """Where coordinates of MuJoCo are others, such as of reversed balls, those of one coordinate are compared."""
    mechanism = parse_mechanism(TREES[name])
    oracle, own = written(mechanism)
    rng = np.random.default_rng(2)
    names, places = mechanism.coordinate_names, order(mechanism, oracle.model)
    single = [i for i, place in enumerate(places) if not names[place].endswith((".rx", ".ry", ".rz"))]
    for _ in range(3):
        q, u, _ = random_state(mechanism, rng)
        found = oracle.accelerations(*mapped(mechanism, oracle, q, u), np.zeros(len(u)))
        exact = own(q, u, np.zeros(len(u)))[places]
        single = [i for i in single if name != "joints" or names[places[i]] not in FLIGHT]
        assert np.max(np.abs(found[single] - exact[single])) <= 1e-10 * np.max(np.abs(exact))
        assert energies(oracle) == pytest.approx(kinetic(own, q, u), rel=1e-12)


FLIGHT = ("flight.x", "flight.y", "flight.z")  # of the point, and in MuJoCo of the body


def energies(oracle):
    """The kinetic energy by MuJoCo's mass matrix and speeds."""
    mass = np.zeros((oracle.model.nv, oracle.model.nv))
    mujoco.mj_fullM(oracle.model, oracle.data, mass)
    return 0.5 * oracle.data.qvel @ mass @ oracle.data.qvel


def kinetic(own, q, u):
    y = own.equations.start_state.copy()
    layout = own.equations.layout
    y[: layout.nq], y[layout.nq : layout.nq + layout.nv] = q, u
    return float(own.equations.energies(0.0, y)[0])


def test_springs_dampers_and_actuators():
    mechanism = parse_mechanism(FORCES)
    oracle, own = written(mechanism)
    rng = np.random.default_rng(3)
    for _ in range(4):
        q, u, efforts = random_state(mechanism, rng)
        push, hold = rng.uniform(-4.0, 4.0, 2)
        exact = own(q, u, efforts, {"push": push, "hold": hold})
        found = oracle.accelerations(q, u, efforts, (push, hold))
        assert np.max(np.abs(found - exact)) <= 1e-10 * np.max(np.abs(exact))


CYCLED = {
    "bodies": BODIES.replace(' stiffness="3"', "").replace(' stiffness="2"', ""),  # springs of ball and free joints
    "forces": FORCES,
    "connect": LINKS.replace("EQUALITY", EQUALITIES["connect"]),
    "joint": LINKS.replace("EQUALITY", EQUALITIES["joint"]),
    "tendons": LINKS.replace("EQUALITY", EQUALITIES["tendons"] + EQUALITIES["tendon_length"]),
}


@pytest.mark.parametrize("text", CYCLED.values(), ids=CYCLED)
def test_what_was_read_is_written_and_read_again(text):
    """Our accelerations of both; parts without mass, and names, may differ."""
    first = parse_mechanism(text)
    second = parse_mechanism(to_mjcf(first).text)
    assert not [note for note in to_mjcf(first).left_out if not note.startswith("parts without mass")]
    rng, one, other = np.random.default_rng(4), OwnAccelerations(first), OwnAccelerations(second)
    assert first.coordinate_names == second.coordinate_names
    q, u, efforts = consistent_state(one.equations, rng, reach=0.3)
    commands = {actuator.name: 0.1 for actuator in first.actuators}
    exact, found = one(q, u, efforts, commands), other(q, u, efforts, commands)
    assert np.max(np.abs(found - exact)) <= 1e-11 * np.max(np.abs(exact))


def test_four_bar():
    mechanism = load_mechanism("four_bar")
    oracle, own = written(mechanism)
    assert oracle.model.neq == 2
    rng = np.random.default_rng(1)
    places = order(mechanism, oracle.model)
    for _ in range(3):
        q, u, efforts = consistent_state(own.equations, rng)
        found = oracle.constrained(q[places], u[places], efforts[places])
        exact = own(q, u, efforts)[places]
        assert np.max(np.abs(found - exact)) <= 1e-8 * np.max(np.abs(exact))
    start = oracle.model.key("start")
    oracle.forward(start.qpos, start.qvel, np.zeros(3), ())
    assert np.max(np.abs(oracle.data.efc_pos)) <= 1e-12  # the keyframe closes the loop
    assert start.qvel[0] == pytest.approx(2.0)


def test_mujoco_runs_the_four_bar_from_its_keyframe():
    """Its loop is soft there, and yields with 1e-4 of the forces: speeds differ more than positions."""
    model = mujoco.MjModel.from_xml_string(to_mjcf(load_mechanism("four_bar")).text)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("start").id)
    mujoco.mj_step(model, data, 300)
    sim = Simulation.from_file("four_bar")
    sim.step(300)
    np.testing.assert_allclose(data.qpos, sim.q, rtol=0, atol=1e-7)
    np.testing.assert_allclose(data.qvel, sim.u, rtol=0, atol=1e-5)


def test_the_command_prints_the_file_and_what_it_lacks(capsys):
    assert main(["convert", "cart_massive_spring", "--to", "mjcf"]) == 0
    printed = capsys.readouterr()
    assert mujoco.MjModel.from_xml_string(printed.out).nv == 2
    assert printed.err == "note: not in this file: masses of springs: spring\n"
    assert main(["convert", "double_rod", "--to", "mjcf", "--expand"]) == 1
    assert "no effect with --to" in capsys.readouterr().err


def test_what_is_not_written_is_listed():
    text = """
mechanism: rest
parts:
  a: {mass: 1, points: {p: [1, 0, 0]}}
  b: {mass: 1, inertia: [1, 1, 1]}
joints:
  rail: {type: prismatic, between: [ground, a], axis: [1, 0, 0], drive: 0.1*t}
  pin: {type: revolute, between: [a.p, b], axis: [0, 1, 0], spring: {force: x**3}, effort_limit: 3}
forces: {wind: {type: force, at: b, vector: [1, 0, 0]}}
sensors: {gyro: {type: imu, at: b}}
"""
    left_out = to_mjcf(parse_mechanism(text)).left_out
    assert "drives, whose joints move freely: rail" in left_out
    assert "nonlinear springs and dampers of joints: pin" in left_out
    assert "effort limits of joints: pin" in left_out
    assert "forces, efforts, potentials and bushings: wind" in left_out
    assert "sensors: gyro" in left_out


def test_what_is_left_out_of_several_pairs_of_bodies_is_told_once():
    """A contact of many bodies was listed once for each of its pairs."""
    bodies = "\n".join(f"  b{i}: {{shape: {{type: sphere, radius: 0.1, mass: 1}}}}" for i in range(4))
    joints = "\n".join(f"  b{i}: {{type: free, between: [ground, b{i}], position: [{i}, 0, 1]}}" for i in range(4))
    text = f"mechanism: balls\nparts:\n{bodies}\njoints:\n{joints}\ncontacts:\n"
    text += "  hit: {among: all, restitution: 0.5}\n  floor: {parts: all, plane: ground, restitution: 0.5}\n"
    mechanism = parse_mechanism(text)
    for written in (to_mjcf(mechanism), to_sdf(mechanism)):
        assert written.left_out
        for note in written.left_out:
            names = note.partition(": ")[2].split(", ")
            assert len(set(names)) == len(names), note
