"""Bushings, and the springs of spherical and free joints: three derivations, closed forms, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.errors import MechanismError
from mbd_sim.dynamics.lagrange import lagrange_equations
from mbd_sim.files.load import parse_mechanism
from test.dynamics.test_against_oracles import check
from test.exports.c_code.compiled import CompiledModule

MOUNTED = """
mechanism: mounted
ground: {points: {foot: {at: [0.1, 0.2, 0], rotate: {axis: [1, 2, 0], angle: 20 deg}}}}
parts:
  frame: {mass: 4, inertia: [0.3, 0.4, 0.5], points: {a: [0.2, 0, 0], b: {at: [0, 0.3, 0.1], rotate: {rpy: [0.1, 0.2, 0.3]}}}}
  engine: {mass: 2, inertia: [0.1, 0.2, 0.15], center: [0.02, 0, 0.1], points: {c: [0, 0.1, 0]}}
  rotor: {mass: 1, inertia: [0.1, 0.1, 0.2]}
joints:
  fly: {type: free, between: [ground, frame], stiffness: [10, 20, 30, 4, 5, 6], damping: [1, 2, 3, 0.1, 0.2, 0.3],
        rest: {at: [0.1, 0, 0.2], rotate: {axis: [0, 1, 0], angle: 0.4}}}
  ball: {type: spherical, between: [engine, frame.b], stiffness: [3, 2, 1], damping: [0.1, 0.2, 0.3], rest: {axis: [0, 0, 1], angle: 0.3}}
  shaft: {type: revolute, between: [engine.c, rotor], axis: [1, 0, 1], drive: 2*t}
forces:
  foot: {type: bushing, between: [ground.foot, engine.c], stiffness: [100, 200, 300], damping: 5, rotational_stiffness: 7}
  rubber: {type: bushing, between: [rotor, frame.a], rotational_damping: [0.1, 0.2, 0.3], stiffness: 50}
  coupled:
    type: bushing
    between: [frame.b, ground]
    stiffness_matrix:
      [[9, 1, 0, 0, 0, 1], [1, 8, 0, 0, 0, 0], [0, 0, 7, 1, 0, 0], [0, 0, 1, 6, 0, 0], [0, 0, 0, 0, 5, 2], [1, 0, 0, 0, 2, 4]]
    damping_matrix:
      [[2, 1, 0, 0, 0, 0], [1, 2, 0, 0, 0, 0], [0, 0, 2, 1, 0, 0], [0, 0, 1, 2, 0, 0], [0, 0, 0, 0, 2, 1], [0, 0, 0, 0, 1, 2]]
"""


def test_three_derivations_agree():
    assert check(parse_mechanism(MOUNTED), np.random.default_rng(7), states=5)


BLOCK = """
mechanism: block
gravity: [0, 0, 0]
parts: {block: {mass: 2, inertia: [0.2, 0.3, 0.4]}}
joints: {fly: {type: free, between: [ground, block], START}}
FORCES
"""


def block(start, forces="", **options):
    forces = f"forces: {{mount: {{type: bushing, between: [ground, block], {forces}}}}}" if forces else ""
    return Simulation.from_text(BLOCK.replace("START", start).replace("FORCES", forces), **options)


def test_a_large_rotation_about_one_axis_oscillates_harmonically():
    """I φ'' = -k φ up to angles near half a turn, where small-angle formulas would be far off."""
    sim = block("orientation: {axis: [0, 0, 1], angle: 170 deg}", "rotational_stiffness: [1, 2, 3.6]")
    sim.run(until=2.0)
    angle = np.radians(170.0) * np.cos(3.0 * 2.0)
    assert 2.0 * np.arctan2(sim.q[6], sim.q[3]) == pytest.approx(angle, abs=1e-12)
    assert abs(sim.energies.residual) < 1e-12


BALL = """
mechanism: ball
gravity: [0, 0, 0]
parts: {arm: {mass: 2, inertia: [0.2, 0.3, 0.4], center: [0, 0, 0]}}
joints: {ball: {type: spherical, between: [ground, arm], stiffness: [3, 2, 1]}}
"""
INERTIA, STIFFNESS = np.array([0.2, 0.3, 0.4]), np.array([3.0, 2.0, 1.0])


def nearly_half_turns(seed):
    """Quaternions of turns about coordinate axes, about lines between them, and about random axes."""
    rng = np.random.default_rng(seed)
    signs = rng.choice([-1.0, 1.0], (6, 3))
    axes = [*np.eye(3), *-np.eye(3), *signs * (1.0 - np.tile(np.eye(3), (2, 1))), *rng.normal(size=(6, 3))]
    for axis in axes:
        for gap in (1e-1, 1e-3, 1e-5, 1e-7, 1e-9, 1e-12):
            yield np.array([np.sin(0.5 * gap), *(np.cos(0.5 * gap) * axis / np.linalg.norm(axis))])


def accelerations_of_ball(q):
    """ω' (3,) in the axes of the arm, at rest: by Euler's equations, from the rates of the rotation vector φ.

    With the angular velocity ω in the axes of the arm, φ' = ω + ½ φ x ω + φ x (φ x ω) (1 - ½ θ cot ½ θ) / θ².
    """
    sine = np.linalg.norm(q[1:])
    half = np.arctan2(sine, q[0])
    phi = 2.0 * half * q[1:] / sine
    swept = np.cross(phi, STIFFNESS * phi)
    part = (1.0 - half * q[0] / sine) / (4.0 * half**2)
    return -(STIFFNESS * phi - 0.5 * swept + part * np.cross(phi, swept)) / INERTIA


def test_springs_of_ball_joints_are_exact_up_to_half_a_turn():
    """The axis was computed from R - Rᵀ, which vanishes there: wrong by 4e-5 at π - 1e-6, by more than all at π - 1e-9."""
    sim, mechanism = Simulation.from_text(BALL), parse_mechanism(BALL)
    module, lagrange = CompiledModule(mechanism), lagrange_equations(mechanism)
    for q in nearly_half_turns(3):
        rates = accelerations_of_ball(q)
        exact = pytest.approx(rates, abs=1e-14 * np.linalg.norm(rates))
        sim.reset(q=q)
        assert sim.model.accelerations(0.0, sim.y, sim.inputs) == exact
        module.y[: len(q)] = q
        assert module.rates(0.0)[len(q) : len(q) + 3] == exact
        assert lagrange.accelerations(q, np.zeros(3), np.zeros(3), 0.0) == exact


def test_all_six_directions_are_damped_independently():
    """m x'' + c x' + k x = 0 for small displacements and rotations along each axis."""
    sim = block(
        "position: [0.1, 0.2, 0.3], angular_velocity: [0, 0, 1e-5]",
        "stiffness: [50, 60, 70], damping: [1, 2, 3], rotational_stiffness: 4, rotational_damping: [0.1, 0.2, 0.3]",
    )
    sim.run(until=1.5)
    for start, k, c, x in zip((0.1, 0.2, 0.3), (50, 60, 70), (1, 2, 3), sim.q[:3], strict=True):
        rate, decay = np.sqrt(k / 2.0 - (c / 4.0) ** 2), c / 4.0
        exact = start * np.exp(-decay * 1.5) * (np.cos(rate * 1.5) + decay / rate * np.sin(rate * 1.5))
        assert x == pytest.approx(exact, abs=1e-13)
    rate, decay = np.sqrt(4.0 / 0.4 - (0.3 / 0.8) ** 2), 0.3 / 0.8
    assert 2.0 * sim.q[6] == pytest.approx(1e-5 / rate * np.exp(-decay * 1.5) * np.sin(rate * 1.5), abs=1e-17)
    assert abs(sim.energies.residual) < 1e-13


def test_springs_of_joints_are_bushings_between_their_frames():
    start = "position: [0.1, 0.2, 0.3], velocity: [1, 0, 2], angular_velocity: [1, 2, 3]"
    inside = block(f"{start}, stiffness: [50, 60, 70, 4, 5, 6]")
    between = block(start, "stiffness: [50, 60, 70], rotational_stiffness: [4, 5, 6]")
    inside.run(until=1.0), between.run(until=1.0)
    assert inside.state == pytest.approx(between.state, abs=1e-14)
    resting = block("position: [0.5, 0, 0], stiffness: [1, 1, 1, 1, 1, 1], rest: {at: [0.5, 0, 0]}")
    resting.run(until=1.0)
    assert resting.q[:3] == pytest.approx([0.5, 0.0, 0.0], abs=1e-15) and resting.energies.potential == 0.0


@pytest.mark.parametrize("method", ["rosenbrock", "gauss6"])
def test_methods_agree(method):
    start, keys = (
        "position: [0.1, 0, 0], angular_velocity: [1, 2, 3]",
        "stiffness: 40, rotational_stiffness: [4, 5, 6], damping: 2",
    )
    reference = block(start, keys)
    other = block(start, keys, method=method)
    reference.run(until=0.5), other.run(until=0.5)
    assert other.q == pytest.approx(reference.q, abs=1e-11)


def test_modes_and_live_stiffness():
    sim = block(
        "position: [0, 0, 0]", "stiffness: [50, 60, 70], rotational_stiffness: 4", live=["forces.mount.stiffness[0]"]
    )
    frequencies = sorted(np.abs(np.linalg.eigvals(sim.linearize().a).imag))[::2]
    exact = sorted([*np.sqrt(np.array([50.0, 60.0, 70.0]) / 2.0), *np.sqrt(4.0 / np.array([0.2, 0.3, 0.4]))])
    assert frequencies == pytest.approx(exact, rel=1e-10)
    sim.set_live({"forces.mount.stiffness[0]": 98.0})
    assert np.any(np.abs(np.linalg.eigvals(sim.linearize().a).imag - 7.0) < 1e-10)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ("stiffness: [1, 2]", "forces.mount.stiffness: has 2 values, not 3"),
        ("stiffness: -1", "forces.mount.stiffness: must be at least 0"),
        ("stiffness: 5 N*m/rad", "the unit 'N*m/rad' does not fit"),
        ("length: 1", "unknown key 'length'"),
        ("stiffness: 1, stiffness_matrix: MATRIX", "has stiffness_matrix and stiffness"),
        (
            "stiffness_matrix: MATRIX".replace(
                "MATRIX", str([[float(i == j or j == 0) for j in range(6)] for i in range(6)])
            ),
            "is not symmetric",
        ),
        ("stiffness_matrix: " + str(np.diag([1.0, 1, 1, 1, 1, -1]).tolist()), "has a negative eigenvalue"),
    ],
)
def test_a_wrong_bushing_is_refused(keys, words):
    with pytest.raises(MechanismError) as caught:
        block("position: [0, 0, 0]", keys.replace("MATRIX", str(np.eye(6).tolist())))
    assert words in str(caught.value)


def test_a_bushing_without_stiffness_or_damping_is_refused():
    text = BLOCK.replace("START", "position: [0, 0, 0]").replace(
        "FORCES", "forces: {m: {type: bushing, between: [ground, block]}}"
    )
    with pytest.raises(MechanismError, match="has neither stiffness nor damping"):
        parse_mechanism(text)
