"""Mechanisms whose mass matrix is singular or nearly so, and the factorization of small matrices."""

from __future__ import annotations

import json

import casadi as ca
import numpy as np
import pytest

from mbd_sim.base.errors import MechanismError, NoInertiaError
from mbd_sim.dynamics.equations import derive
from mbd_sim.dynamics.math.spatial import SpdFactors, inverse_spd
from mbd_sim.files.checks.override import with_values
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.simulation.run.simulation import BaseSimulation
from test.generators.mechanisms import accelerations, derived, random_state
from test.oracles import kane


def refused(text):
    """The keys of the joints that a mechanism is refused for."""
    with pytest.raises(MechanismError) as caught:
        derived(text)
    for problem in caught.value.problems:
        assert "moves no inertia" in problem.message
        assert problem.remedy and problem.line > 0
    return [problem.key for problem in caught.value.problems]


def chain(*joints, parts, gravity=(0, 0, -9.81)):
    """A mechanism as text: `joints` are (name, type, inboard, outboard, axis)."""
    return json.dumps(
        {
            "mechanism": "chain",
            "gravity": list(gravity),
            "parts": parts,
            "joints": {
                name: {"type": kind, "between": [inboard, outboard]}
                | ({} if axis is None else {"axis": [float(x) for x in axis]})
                for name, kind, inboard, outboard, axis in joints
            },
        }
    )


def rod(direction, mass=1.0, length=1.0):
    end = (np.array(direction) * length / np.linalg.norm(direction)).tolist()
    return {"mass": mass, "shape": {"type": "rod", "to": end}}


@pytest.mark.parametrize(("size", "mass"), [(1e-6, 1.0), (1.0, 1e-9), (1e6, 1e6)])
def test_a_rod_about_itself_is_refused_in_any_direction(mass, size):
    rng = np.random.default_rng(5)
    for direction in (*np.eye(3), *rng.normal(size=(2, 3))):
        parts = {"rod": rod(direction, mass, size)}
        assert refused(chain(("spin", "revolute", "ground", "rod", direction), parts=parts)) == ["joints.spin"]


def test_a_rod_about_itself_is_refused_in_rotated_frames():
    rng = np.random.default_rng(6)
    for _ in range(6):
        direction = rng.normal(size=3)
        rotate = {"axis": rng.normal(size=3).tolist(), "angle": float(rng.uniform(-3, 3))}
        text = json.loads(chain(("spin", "revolute", "ground", "rod.end", (1, 1, 1)), parts={"rod": rod(direction)}))
        end = (0.3 * direction / np.linalg.norm(direction)).tolist()
        text["parts"]["rod"]["points"] = {"end": {"at": end, "rotate": rotate}}
        # the axis is given in ground's frame, which the joint's coordinate at zero aligns with the point's frame
        axis, angle = np.array(rotate["axis"]), rotate["angle"]
        axis /= np.linalg.norm(axis)
        k = kane.skew(axis)
        turn = np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * k @ k
        text["joints"]["spin"]["axis"] = (turn.T @ direction).tolist()
        assert refused(json.dumps(text)) == ["joints.spin"]


def test_only_the_joints_that_cause_the_singularity_are_named():
    rods = {"a": rod((0, 0, 1)), "b": rod((1, 2, 3)), "c": rod((3, 1, 2))}
    text = chain(
        ("base", "revolute", "ground", "a", (1, 0, 0)),
        ("good", "revolute", "a", "b", (1, 0, 0)),
        ("bad", "revolute", "b", "c", (3, 1, 2)),
        parts=rods,
    )
    assert refused(text) == ["joints.bad"]


def neck(head, turned=3.7e-6):
    """Three hinges that turn a head about nearly one point, the second and third nearly in its plane."""
    parts = {
        "low": {"mass": 0.1, "points": {"top": [0, 0.0095, 0]}},
        "high": {"mass": 0.1},
        "head": {"mass": 1.3, "center": [0.0185, -0.11, 0], **head},
    }
    joints = [
        ("pitch", "revolute", "ground", "low", (0, 0, 1)),
        ("roll", "revolute", "low.top", "high", (1, 0, turned)),
        ("yaw", "revolute", "high", "head", (0, 1, 0)),
    ]
    return chain(*joints, parts=parts)


def test_joints_that_together_move_no_inertia_are_named_with_the_particles_that_they_move():
    with pytest.raises(NoInertiaError) as caught:
        derived(neck({}))
    (problem,) = caught.value.problems
    assert problem.key == "joints.yaw" and problem.line > 0
    assert problem.message == "the joints 'roll', 'yaw' together can move without moving any inertia"
    assert problem.remedy.endswith("These parts have none: 'high', 'head'.")
    derived(neck({"inertia": [1e-9, 1e-9, 1e-9]}))
    derived(neck({}, turned=0.1))


def test_a_free_rod_and_a_free_particle_are_refused():
    for direction in ((0, 0, 1), (1, 2, 3), (-0.3, 0.5, 0.2)):
        text = chain(("flight", "free", "ground", "rod", None), parts={"rod": rod(direction)})
        assert refused(text) == ["joints.flight"]
    text = chain(("flight", "free", "ground", "dot", None), parts={"dot": {"mass": 1.0}})
    assert refused(text) == ["joints.flight"]


def test_a_massless_free_base_with_a_hinge_is_refused():
    """The hinge of a massless free part rotates the body about an axis of which the free joint is capable as well."""
    parts = {"base": {"mass": 0.0}, "arm": {"mass": 1.0, "inertia": [1, 2, 2.5]}}
    joints = (("flight", "free", "ground", "base", None), ("hinge", "revolute", "base", "arm", (1, 2, 3)))
    assert refused(chain(*joints, parts=parts)) == ["joints.flight"]


def test_two_joints_with_the_same_motion_are_refused():
    body = {"mass": 3.0, "center": [0.1, 0.2, 0.3], "inertia": [1, 2, 2.5]}
    for kind in ("revolute", "prismatic"):
        for axis in ((0, 0, 1), (1, 2, 3)):
            joints = (("first", kind, "ground", "between", axis), ("second", kind, "between", "body", axis))
            parts = {"between": {"mass": 0.0}, "body": body}
            assert refused(chain(*joints, parts=parts)) == ["joints.first"]


@pytest.mark.parametrize(("kind", "scale"), [("revolute", 1e-12), ("prismatic", 1e6), ("free", 1e-6), ("free", 1.0)])
def test_a_gram_on_a_thousand_tons_is_accepted(kind, scale):
    """Neither the units nor the inertia of inboard parts matter."""
    parts = {
        "base": {"mass": 1e6 * scale, "inertia": [1e9 * scale] * 3},
        "chip": {"mass": 1e-3 * scale, "center": [1e-3, 0, 0], "inertia": [1e-10 * scale] * 3},
    }
    axis = None if kind == "free" else (0, 0, 1)
    joints = (("stand", "prismatic", "ground", "base", (1, 0, 0)), ("chip", kind, "base", "chip", axis))
    mechanism = parse_mechanism(chain(*joints, parts=parts, gravity=(0, 0, 0)))
    equations = derive(mechanism)
    q, u, _ = random_state(mechanism, np.random.default_rng(7), reach=1.0)
    efforts = np.diag(kane.equations(mechanism, q, u, np.zeros(len(u))).mass)
    oracle = kane.equations(mechanism, q, u, efforts)
    error = oracle.scale * (accelerations(equations, q, u, efforts) - oracle.accelerations)
    assert np.linalg.norm(error) <= 1e-13 * oracle.condition * np.linalg.norm(oracle.scale * oracle.accelerations)


def test_a_gram_that_carries_a_ton_is_accepted():
    parts = {"slide": {"mass": 1e-3}, "load": {"mass": 1e3}}
    joints = (("x", "prismatic", "ground", "slide", (1, 0, 0)), ("y", "prismatic", "slide", "load", (1, 0, 0)))
    found = accelerations(derived(chain(*joints, parts=parts)), np.zeros(2), np.zeros(2), np.array([1.0, 0.0]))
    assert found == pytest.approx([1e3, -1e3], rel=1e-9)


def test_small_free_bodies_are_solved_as_well_as_large_ones():
    """Ten nanometers wide: the inertia is 1e-16 of the mass, which a pseudo-inverse would treat as zero."""
    body = {"mass": 1e-18, "inertia": [1e-34, 2e-34, 2.5e-34]}
    text = chain(("flight", "free", "ground", "dust", None), parts={"dust": body}, gravity=(0, 0, 0))
    q, u = np.array([0, 0, 0, 1.0, 0, 0, 0]), np.array([0, 0, 0, 1.0, 2.0, 3.0])
    w1 = [(2.0 - 2.5) / 1.0 * 2 * 3, (2.5 - 1.0) / 2.0 * 3 * 1, (1.0 - 2.0) / 2.5 * 1 * 2]
    assert accelerations(derived(text), q, u) == pytest.approx([0, 0, 0, *w1], rel=1e-13)


def test_a_loop_without_any_mass_is_refused_for_that():
    """Its speeds of least kinetic energy are not determined, and must not count as contradictory."""
    with pytest.raises(NoInertiaError) as caught:
        derive(with_values(load_mechanism("four_bar"), {"density": 0.0}))
    assert [problem.key for problem in caught.value.problems] == [
        f"joints.{name}" for name in ("crank_pivot", "crank_pin", "rocker_pivot")
    ]
    assert all("nothing that this joint moves has mass" in problem.message for problem in caught.value.problems)


def test_massless_parts_between_are_accepted():
    """A gimbal of massless rings is a spherical joint: θ'' of each ring follows from the body alone."""
    body = {"mass": 3.0, "center": [0.1, 0.2, 0.3], "inertia": [1, 2, 2.5]}
    mechanism = parse_mechanism(
        chain(
            ("yaw", "revolute", "ground", "outer", (0, 0, 1)),
            ("pitch", "revolute", "outer", "inner", (0, 1, 0)),
            ("roll", "revolute", "inner", "body", (1, 0, 0)),
            parts={"outer": {"mass": 0.0}, "inner": {"mass": 0.0}, "body": body},
        )
    )
    equations = derive(mechanism)
    rng = np.random.default_rng(8)
    for _ in range(5):
        q, u, efforts = random_state(mechanism, rng, reach=1.0)
        expected = kane.equations(mechanism, q, u, efforts).accelerations
        assert accelerations(equations, q, u, efforts) == pytest.approx(expected, rel=1e-12)


def test_a_massless_part_on_a_free_joint_with_a_weld_is_accepted():
    parts = {"frame": {"mass": 0.0}, "body": {"mass": 2.0, "center": [0.1, 0, 0], "inertia": [1, 2, 2.5]}}
    joints = (("flight", "free", "ground", "frame", None), ("weld", "fixed", "frame", "body", None))
    mechanism = parse_mechanism(chain(*joints, parts=parts))
    q, u, efforts = random_state(mechanism, np.random.default_rng(9))
    expected = kane.equations(mechanism, q, u, efforts).accelerations
    assert accelerations(derive(mechanism), q, u, efforts) == pytest.approx(expected, rel=1e-12)


def test_a_weld_beside_the_only_coordinate():
    parts = {"plate": {"mass": 1.0}, "disc": {"mass": 1.0, "inertia": [1, 1, 2]}}
    for order in (1, -1):
        joints = (("weld", "fixed", "ground", "plate", None), ("hinge", "revolute", "plate", "disc", (0, 0, 1)))
        found = accelerations(derived(chain(*joints[::order], parts=parts)), np.zeros(1), np.zeros(1), [3.0])
        assert found == pytest.approx([1.5], rel=1e-15)


def test_inverse_spd():
    rng = np.random.default_rng(10)
    root = rng.normal(size=(6, 6))
    matrix = root @ root.T
    inverse, pivots = inverse_spd(matrix)
    assert inverse @ matrix == pytest.approx(np.eye(6), abs=1e-11)
    assert pivots == pytest.approx(np.diag(np.linalg.cholesky(matrix)) ** 2, rel=1e-10)
    units = 10.0 ** rng.uniform(-12, 12, 6)
    scaled, _ = inverse_spd(matrix * np.outer(units, units))
    assert scaled * np.outer(units, units) == pytest.approx(inverse, rel=1e-11)


@pytest.mark.parametrize("matrix", [np.zeros((3, 3)), np.diag([1.0, -1.0, 2.0]), np.ones((3, 3)), np.eye(3) * np.nan])
def test_matrices_that_are_not_definite_have_a_pivot_that_is_not_positive(matrix):
    inverse, pivots = inverse_spd(matrix)
    assert not np.all(pivots > 0.0)
    assert np.all(np.isfinite(inverse))


def test_factors_give_each_row_its_own_pivot():
    """The symbolic factorization may reorder rows; the pivots must not be reordered with them."""
    values = np.diag([1.0, 10.0, 100.0, 1e3]) + 0.0
    values[0, 1:] = values[1:, 0] = 0.1  # an arrow, which a fill-reducing order reverses
    x = ca.SX.sym("x", 10)
    place = {pair: n for n, pair in enumerate((i, j) for i in range(4) for j in range(i, 4))}
    matrix = ca.SX(4, 4)
    for (i, j), n in place.items():
        if values[i, j]:
            matrix[i, j] = matrix[j, i] = x[n]
    right = ca.SX(ca.DM([1.0, 2.0, 3.0, 4.0]))
    factors = SpdFactors(matrix)
    solution, pivots = factors.solve(right), factors.pivots
    numbers = [values[pair] for pair in place]
    found, rows = ca.Function("f", [x], [solution, pivots])(numbers)
    assert values @ np.array(found).ravel() == pytest.approx([1.0, 2.0, 3.0, 4.0], rel=1e-13)
    assert np.array(rows).ravel() == pytest.approx(np.diag(values), rel=0.05)


def test_a_massless_rod_in_a_loop_moves_like_a_distance():
    """The joint of the crank closes the loop then, and carries a piece of the crank."""
    text = """
mechanism: slider_crank
parts:
  crank: {mass: 1, inertia: [1, 1, 1], points: {tip: [1, 0, 0]}}
  slide: {mass: 1}
  rod: {mass: 0, points: {end: [3, 0, 0]}}
joints:
  main: {type: revolute, between: [ground, crank], axis: [0, 1, 0], position: 1, velocity: 2}
  rail: {type: prismatic, between: [ground, slide], axis: [1, 0, 0], position: 3, guess: true}
  pin: {type: revolute, between: [crank.tip, rod], axis: [0, 1, 0]}
  eye: {type: revolute, between: [rod.end, slide], axis: [0, 1, 0]}
"""
    distance = "".join(line for line in text.splitlines(keepends=True) if "rod" not in line)
    distance += "constraints: {rod: {type: distance, between: [crank.tip, slide], length: 3}}\n"
    states = []
    for one in (text, distance):
        simulation = BaseSimulation(parse_mechanism(one))
        simulation.run(until=0.3)
        found = dict(zip(simulation.coordinate_names, simulation.q, strict=True))
        states.append([found["main"], found["rail"]])
    np.testing.assert_allclose(states[0], states[1], rtol=1e-12)
