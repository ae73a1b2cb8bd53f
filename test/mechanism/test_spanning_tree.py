"""Which joints make the tree and which close loops."""

from __future__ import annotations

import inspect
import json
import sys
from itertools import pairwise

import numpy as np
import pytest

from mbd_sim.base.errors import MechanismError
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import parse_mechanism
from test.generators.mechanisms import accelerations

BODY = {"mass": 1, "inertia": [1, 1, 1]}


def mechanism(joints, constraints=None, parts=None):
    """A mechanism with hinges about y unless said; `joints` are (name, first, second, what else it has)."""
    names = list(dict.fromkeys(part for _, *ends, _ in joints for part in ends if part != "ground"))
    text = {
        "mechanism": "loops",
        "parts": dict.fromkeys(parts or names, BODY),
        "joints": {
            name: {"between": [first, second], "type": "revolute"}
            | ({"axis": [0, 1, 0]} if "type" not in more else {})
            | more
            for name, first, second, more in joints
        },
        "constraints": constraints or {},
    }
    return parse_mechanism(json.dumps(text))


def ring(*more):
    """Four hinges around three parts, each with what it has more."""
    ends = [("ground", "a"), ("a", "b"), ("b", "c"), ("c", "ground")]
    return [(f"j{n}", *pair, more[n] if n < len(more) else {}) for n, pair in enumerate(ends)]


def refused(*arguments, **named):
    with pytest.raises(MechanismError) as caught:
        mechanism(*arguments, **named)
    return [str(problem) for problem in caught.value.problems]


def test_an_open_chain_closes_nothing():
    found = mechanism(ring()[:3])
    assert not found.closing
    assert found.tree == ("j0", "j1", "j2")


def test_a_loop_is_cut_as_far_from_ground_as_possible():
    found = mechanism(ring())
    assert list(found.closing) == ["j2"]
    assert found.tree == ("j0", "j3", "j1")
    assert found.joints["j3"].reversed
    assert not found.joints["j1"].reversed


def test_coordinates_are_in_declared_order_without_those_of_cut_joints():
    assert mechanism(ring()).coordinate_names == ("j0", "j1", "j3")


@pytest.mark.parametrize("name", ["j0", "j1", "j2", "j3"])
def test_any_joint_of_a_loop_may_be_cut(name):
    joints = [(n, a, b, {"cut": True} if n == name else {}) for n, a, b, _ in ring()]
    assert list(mechanism(joints).closing) == [name]


NEEDS = {
    "stiffness": {"stiffness": 1},
    "damping": {"damping": 1},
    "a drive": {"drive": "t"},
    "limits": {"limits": {"lower": -1, "upper": 1}},
    "an effort limit": {"effort_limit": 1},
    "a spring": {"spring": {"force": "x"}},
    "a damper": {"damper": {"coefficient": 1, "exponent": 2}},
    "friction": {"friction": {"coulomb": 1}},
    "a start position": {"position": 0.3},
    "a start velocity": {"velocity": 0.3},
    "a guessed position": {"position": 0.3, "guess": True},
}


@pytest.mark.parametrize("need", NEEDS.values(), ids=NEEDS)
def test_a_joint_that_needs_its_coordinate_stays(need):
    """By itself the third joint would be cut."""
    found = mechanism(ring({}, {}, need))
    assert "j2" in found.joints
    assert len(found.closing) == 1


def test_a_joint_that_a_constraint_refers_to_stays():
    gear = {"type": "gear", "joints": ["j0", "j2"], "radii": [1, 2]}
    assert "j2" in mechanism(ring(), {"mesh": gear}).joints


def test_a_joint_with_a_drive_comes_before_one_with_a_guess():
    found = mechanism(ring(*[{"position": 0.1, "guess": True}] * 2, {"drive": "t"}, {"position": 0.1, "guess": True}))
    assert "j2" in found.joints
    assert list(found.closing) == ["j3"]


def test_where_all_joints_of_a_loop_need_their_coordinates_the_last_splits_a_part():
    found = mechanism(ring(*[{"damping": 1}] * 4))
    assert not found.closing
    assert found.coordinate_names == ("j0", "j1", "j2", "j3")
    assert [name for name, joint in found.joints.items() if joint.splits] == ["j3"]
    assert {name: body.mass for name, body in found.bodies.items()} == {"a": 1, "b": 1, "c": 0.5, "c/j3": 0.5}
    assert found.parts["c"].mass == 1


def test_a_cut_joint_that_needs_its_coordinate_splits_a_part():
    found = mechanism(ring({}, {"cut": True, "stiffness": 1}))
    assert found.joints["j1"].splits
    assert found.tree[-1] == "j1"


def test_a_part_that_two_joints_split_is_in_three_pieces():
    twice = [(name, "a", "ground", {"damping": 1, "cut": True}) for name in ("j1", "j2")]
    found = mechanism([("j0", "ground", "a", {}), *twice])
    assert [body.mass for body in found.bodies.values()] == [1 / 3] * 3
    assert found.mass == 1


def test_a_free_joint_is_never_cut_by_itself():
    """A part may be placed by it and led by other joints."""
    found = mechanism([("pin", "ground", "a", {}), ("flight", "ground", "a", {"type": "free"})])
    assert list(found.closing) == ["pin"]
    assert len(found.coordinate_names) == 6


def test_start_values_of_all_joints_of_a_loop_may_be_too_many():
    with pytest.raises(MechanismError, match=r"remains open here by .* with the given positions.*guess: true"):
        derive(mechanism(ring(*[{"position": 0.1}] * 4)))


def test_a_joint_that_holds_parts_alone_cannot_be_cut():
    with pytest.raises(MechanismError) as caught:
        mechanism([("j0", "ground", "a", {"cut": True}), ("j1", "a", "b", {})])
    (problem,) = caught.value.problems
    assert problem.key == "joints.j0.cut" and "no other joint connects" in problem.message


def test_of_one_loop_one_joint_can_be_cut():
    """Of two that ask for it the later one is cut, and the other one is told."""
    ring = [("j0", "ground", "a", {}), ("j1", "a", "b", {"cut": True}), ("j2", "b", "c", {})]
    with pytest.raises(MechanismError) as caught:
        mechanism([*ring, ("j3", "c", "ground", {"cut": True})])
    assert [problem.key for problem in caught.value.problems] == ["joints.j1.cut"]


def test_of_two_joints_between_the_same_parts_one_closes_a_loop():
    found = mechanism([("j0", "ground", "a", {}), ("j1", "ground", "a", {})])
    assert list(found.joints) == ["j0"]
    assert list(found.closing) == ["j1"]


def test_several_loops_are_each_cut_once():
    """A ladder with rungs: as many cuts as rungs beyond the first."""
    joints = [("base_l", "ground", "l0", {}), ("base_r", "ground", "r0", {}), ("rung0", "l0", "r0", {})]
    for n in range(1, 5):
        joints += [(f"l{n}", f"l{n - 1}", f"l{n}", {}), (f"r{n}", f"r{n - 1}", f"r{n}", {})]
        joints.append((f"rung{n}", f"l{n}", f"r{n}", {}))
    found = mechanism(joints)
    assert list(found.closing) == [f"rung{n}" for n in range(5)]
    assert len(found.joints) == 10


@pytest.fixture
def few_calls():
    """Python allows 120 calls beyond the present one."""
    limit = sys.getrecursionlimit()
    sys.setrecursionlimit(len(inspect.stack(0)) + 120)
    yield
    sys.setrecursionlimit(limit)


def test_a_deep_chain_and_a_long_ring(few_calls):
    """Without recursion."""
    count = 160
    names = ["ground", *(f"p{n}" for n in range(count))]
    joints = [(f"j{n}", a, b, {"damping": 1}) for n, (a, b) in enumerate(pairwise(names))]
    found = mechanism([*joints, ("last", names[-1], "ground", {})])
    assert list(found.closing) == ["last"] and len(found.tree) == count


def test_the_same_file_is_always_cut_in_the_same_way():
    joints = [(f"j{a}{b}", f"p{a}", f"p{b}", {}) for a in range(6) for b in range(a)] + [("base", "ground", "p3", {})]
    first, second = mechanism(joints), mechanism(joints)
    assert first.tree == second.tree
    assert list(first.closing) == list(second.closing)
    assert len(first.joints) == 6


def test_a_free_joint_cannot_close_a_loop():
    flights = [("j0", "ground", "a", {}), ("flight", "ground", "a", {"type": "free", "cut": True})]
    (problem,) = refused(flights)
    assert "joints.flight: a free joint restricts nothing: it cannot close a loop" in problem


def test_parts_in_a_loop_without_ground_are_not_connected():
    problems = refused([("j0", "a", "b", {}), ("j1", "b", "c", {}), ("j2", "c", "a", {})])
    assert len(problems) == 3
    assert all("does not lead to ground" in problem for problem in problems)


def test_a_weld_that_closes_onto_ground_leaves_nothing_to_move():
    """The file is sound; that nothing moves is only known when the loop is assembled."""
    found = mechanism([("pin", "ground", "a", {}), ("weld", "a", "ground", {"type": "fixed"})])
    with pytest.raises(MechanismError, match="nothing can move"):
        derive(found)


LADDER = """
mechanism: ladder
parts: {rod: {shape: {type: rod, to: [2, 0, 0], mass: 3}, points: {top: [2, 0, 0]}}, shoe: {mass: 0.5}}
joints:
  wall: {type: planar, between: [ground, rod], axis: [0, 1, 0], x_axis: [1, 0, 0], position: [1, 0, 0], guess: true}
  floor: {type: prismatic, between: [ground, shoe], axis: [1, 0, 0]}
  hinge: {type: revolute, between: [shoe, rod], axis: [0, 1, 0], position: -2, velocity: 0.7, damping: 0.2}
constraints: {top: {type: on_plane, point: rod.top, normal: [1, 0, 0]}}
"""


def test_a_particle_in_a_loop_is_moved_by_the_joint_in_which_it_has_inertia():
    """With the angle θ of the rod to the floor, (m l²/3 + M l² sin²θ) θ'' + M l² sinθ cosθ θ'² + m g l/2 cosθ + d θ' = 0."""
    mechanism = parse_mechanism(LADDER)
    assert list(mechanism.closing) == ["wall"]
    s, c, rate = np.sin(np.pi - 2.0), np.cos(np.pi - 2.0), 0.7
    moment = 0.5 * 4.0 * s * c * rate**2 + 3.0 * 9.81 * c + 0.2 * rate
    derived = derive(mechanism)
    q, u = derived.start.q, derived.start.u
    found = accelerations(derived, q, u, np.zeros(2))
    assert q == pytest.approx([2.0 * c, -2.0], rel=1e-14)
    assert found[1] == pytest.approx(-moment / (3.0 * 4.0 / 3.0 + 0.5 * 4.0 * s**2), rel=1e-13)


def loop_of_parts(**parts):
    text = {"mechanism": "loop", "parts": parts, "joints": {}}
    for name, first, second, _ in ring():
        text["joints"][name] = {"type": "revolute", "between": [first, second], "axis": [0, 1, 0]}
    return parse_mechanism(json.dumps(text))


def test_a_rod_without_mass_and_a_particle_are_moved_with_a_part_that_has_inertia():
    """By itself the third joint would be cut, and the rod and the particle would be the ends of two branches."""
    found = loop_of_parts(a=BODY, b={"mass": 0}, c={"mass": 1})
    assert list(found.closing) == ["j0"]
    assert found.tree == ("j3", "j2", "j1")


def test_the_tree_stays_where_nothing_has_inertia():
    """Only positions can be computed of a mechanism without mass; particles on all axes are refused later."""
    for mass in (0, 1):
        assert list(loop_of_parts(**{name: {"mass": mass} for name in "abc"}).closing) == ["j2"]
