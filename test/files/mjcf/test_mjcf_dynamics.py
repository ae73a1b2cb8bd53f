"""What an MJCF means, against MuJoCo: masses, accelerations, tendons, actuators and equalities."""

import numpy as np
import pytest

from mbd_sim.files.load import parse_mechanism
from test.files.mjcf.models import ACTUATORS, BODIES, EQUALITIES, FORCES, JOINT_FORCES, LINKS, linked
from test.generators.mechanisms import consistent_state, random_state
from test.oracles.mujoco_oracle import MujocoOracle, OwnAccelerations, import_mujoco

mujoco = import_mujoco()


def read(text):
    mechanism = parse_mechanism(text)
    return mechanism, MujocoOracle(mujoco, mujoco.MjModel.from_xml_string(text)), OwnAccelerations(mechanism)


def test_bodies_and_their_joints():
    mechanism, oracle, own = read(BODIES)
    rng = np.random.default_rng(1)
    assert mechanism.mass == pytest.approx(30.0, rel=1e-14)
    for _ in range(4):
        state = random_state(mechanism, rng)
        exact = oracle.accelerations(*state)
        assert np.max(np.abs(own(*state) - exact)) <= 1e-12 * np.max(np.abs(exact))


def test_the_start_is_mujocos_reference_position():
    _, oracle, own = read(BODIES)
    np.testing.assert_allclose(own.equations.start.q, oracle.model.qpos0, rtol=0, atol=1e-15)


def test_tendons_and_actuators():
    mechanism, oracle, own = read(FORCES)
    rng = np.random.default_rng(2)
    for _ in range(6):
        q, u, efforts = random_state(mechanism, rng, reach=0.4)
        pull, push, hold, spin, mixed, through = rng.uniform(-0.3, 0.3, 6)
        exact = oracle.accelerations(q, u, efforts, (pull, push, hold, spin, mixed, through))
        ours = {"pull": 3.0 * pull, "push": -2.0 * push, "hold": hold / 2.0, "spin": spin / 1.5, "mixed": 4.0 * mixed}
        found = own(q, u, efforts, ours | {"through": 2.0 * through})
        assert np.max(np.abs(found - exact)) <= 1e-12 * np.max(np.abs(exact))


def test_friction_of_a_moving_joint():
    """MuJoCo's friction is a constraint, of which qacc contains the force; at rest the two differ."""
    joint = '<joint name="a" axis="0 1 0" frictionloss="0.3"/>'
    text = f'<mujoco><worldbody><body>{joint}<geom size="0.1" pos="0.2 0 0"/></body></worldbody></mujoco>'
    _, oracle, own = read(text)
    for speed in (2.0, -3.0):
        q, u, none = np.array([0.4]), np.array([speed]), np.zeros(1)
        oracle.forward(q, u, none, ())
        assert own(q, u, none) == pytest.approx(oracle.data.qacc, rel=1e-8)


@pytest.mark.parametrize("kind", EQUALITIES)
def test_equalities_are_exact_constraints(kind):
    _, oracle, own = read(LINKS.replace("EQUALITY", EQUALITIES[kind]))
    q, u, efforts = consistent_state(own.equations, np.random.default_rng(3), reach=0.3)
    exact = oracle.constrained(q, u, efforts)
    violations = oracle.data.efc_pos[: oracle.data.ne]
    assert oracle.data.ne and np.max(np.abs(violations)) <= 1e-3  # moved by the last difference
    assert np.max(np.abs(own(q, u, efforts) - exact)) <= 1e-8 * np.max(np.abs(exact))


def test_an_equality_of_two_joints_names_the_follower():
    """The first joint is the one that the polynomial gives; an export has the mimic there."""
    for polynomial in ("0.2 3", "0 1 0.5"):
        equality = f'<equality><joint joint1="jb" joint2="ja" polycoef="{polynomial}"/></equality>'
        (coupling,) = parse_mechanism(linked().replace("</mujoco>", equality + "</mujoco>")).constraints
        assert coupling.follower == ("jb" if polynomial == "0.2 3" else None)


def state_of(own, rng):
    """A random state in which nothing is almost at rest, where friction differs."""
    q = own.equations.start.q.copy()
    q[:2] += rng.uniform(-0.6, 0.6, 2)
    q[2:6] = rng.normal(size=4)
    q[2:6] /= np.linalg.norm(q[2:6])
    q[9:] = rng.normal(size=4)
    q[9:] /= np.linalg.norm(q[9:])
    return q, rng.uniform(0.4, 1.5, len(own.equations.start.u)) * rng.choice([-1.0, 1.0], len(own.equations.start.u))


@pytest.mark.parametrize("name", ACTUATORS)
def test_an_actuator_exerts_what_mujocos_does(name):
    """Gains, biases, ranges and places, beyond the ranges as well, and before the first command."""
    element, factor = ACTUATORS[name]
    joint = 'actuatorfrcrange="-3 1"' if name == "joint force range" else ""
    _, oracle, own = read(linked(element, joint=joint))
    rng = np.random.default_rng(7)
    for command in (None, *rng.uniform(-2.0, 2.0, 3)):
        q, u = state_of(own, rng)
        exact = oracle.accelerations(q, u, np.zeros(len(u)), () if command is None else (command,))
        found = own(q, u, np.zeros(len(u)), {} if command is None else {"m": factor * command})
        assert np.max(np.abs(found - exact)) <= 1e-11 * np.max(np.abs(exact))


@pytest.mark.parametrize("name", JOINT_FORCES)
def test_forces_of_joints(name):
    _, oracle, own = read(linked(**JOINT_FORCES[name]))
    rng = np.random.default_rng(8)
    for _ in range(3):
        q, u = state_of(own, rng)
        friction = -oracle.model.dof_frictionloss * np.sign(u)
        exact = oracle.accelerations(q, u, friction)
        assert np.max(np.abs(own(q, u, np.zeros(len(u))) - exact)) <= 1e-11 * np.max(np.abs(exact))


def test_a_rest_length_is_that_at_the_rest_positions():
    """Without springlength, a tendon is at rest where all joints are at their springref."""
    spring = '<fixed name="s" stiffness="20 3"><joint joint="ja" coef="1"/><joint joint="jb" coef="2"/></fixed>'
    line = '<spatial name="l" stiffness="50 7"><site site="wall"/><site site="mid"/></spatial>'
    text = linked(joint='springref="0.5" ref="0.3"').replace("<tendon>", f"<tendon>{spring}{line}")
    _, oracle, own = read(text)
    q, u = state_of(own, np.random.default_rng(9))
    exact = oracle.accelerations(q, u, np.zeros(len(u)))
    assert np.max(np.abs(own(q, u, np.zeros(len(u))) - exact)) <= 1e-11 * np.max(np.abs(exact))


def test_bodies_that_are_replicated_and_attached():
    world = '<replicate count="3" offset="0 1 0" euler="0 0 20"><body name="a"><joint name="j" axis="0 1 0"/>'
    world += '<frame euler="30 0 0" pos="0.1 0 0.2"><inertial pos="0.1 0 0.3" mass="3" diaginertia="1 1.2 1.4"/>'
    world += "</frame></body></replicate>"
    mechanism, oracle, own = read(f"<mujoco><worldbody>{world}</worldbody></mujoco>")
    assert [*mechanism.joints] == ["j0", "j1", "j2"]
    state = random_state(mechanism, np.random.default_rng(1))
    exact = oracle.accelerations(*state)
    assert np.max(np.abs(own(*state) - exact)) <= 1e-12 * np.max(np.abs(exact))
