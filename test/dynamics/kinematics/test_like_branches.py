"""Branches with the same joints, and their coordinates, speeds and efforts."""

from __future__ import annotations

from mbd_sim.dynamics.kinematics.links import build_links, like_branches
from mbd_sim.dynamics.layouts.vectors import coordinate_layout
from mbd_sim.files.load import parse_mechanism
from test.generators.legged_robots import legged

PARTS = "  {name}: {{mass: 1, inertia: [1, 1, 1]}}\n"


def branches_of(text):
    mechanism = parse_mechanism(text)
    layout = coordinate_layout(mechanism)
    return like_branches(build_links(mechanism), layout.nq), layout


def tree(**joints):
    """Parts and the joints that lead to them: `name=(inboard, type)`."""
    parts = "".join(PARTS.format(name=name) for name in joints)
    lines = "".join(
        f"  to_{name}: {{type: {kind}, between: [{inboard}, {name}]{'' if kind == 'fixed' else ', axis: [0, 0, 1]'}}}\n"
        for name, (inboard, kind) in joints.items()
    )
    return f"mechanism: tree\nparts:\n{parts}joints:\n{lines}"


def test_legs_of_a_free_base():
    (legs,), layout = branches_of(legged())
    assert len(legs) == 4
    for name, leg in zip(("lf", "rf", "lh", "rh"), legs, strict=True):
        expected = []
        for joint in (f"{name}_roll", f"{name}_bend"):
            q, u = layout.q[joint].start, layout.u[joint].start
            expected += [(1, q), (1, layout.nq + u), (2, u)]
        assert leg == expected


def test_a_chain_has_none():
    assert branches_of(tree(a=("ground", "revolute"), b=("a", "revolute"), c=("b", "revolute")))[0] == []


def test_joints_of_other_types_and_longer_branches_are_different():
    groups, _ = branches_of(
        tree(
            a=("ground", "revolute"),
            b=("ground", "prismatic"),
            c=("ground", "revolute"),
            d=("c", "revolute"),
            e=("c", "revolute"),
        )
    )
    assert groups == [[[(1, 3), (1, 8), (2, 3)], [(1, 4), (1, 9), (2, 4)]]]


def test_fixed_joints_are_passed_over():
    groups, _ = branches_of(  # in the order of the tree: c is next to ground
        tree(a=("ground", "fixed"), b=("a", "revolute"), c=("ground", "revolute"), d=("c", "fixed"), e=("b", "fixed"))
    )
    assert groups == [[[(1, 1), (1, 3), (2, 1)], [(1, 0), (1, 2), (2, 0)]]]


def test_branches_within_branches_belong_to_these():
    groups, _ = branches_of(
        tree(
            a=("ground", "revolute"),
            a1=("a", "revolute"),
            a2=("a", "revolute"),
            b=("ground", "revolute"),
            b1=("b", "revolute"),
            b2=("b", "revolute"),
        )
    )
    assert [[len(branch) for branch in group] for group in groups] == [[9, 9]]
