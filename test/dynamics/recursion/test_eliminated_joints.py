"""Joints eliminated from the equations of their links, against each other and against Featherstone, table 7.1."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from mbd_sim.compiler.lists.instruction_list import instructions_of
from mbd_sim.dynamics.kinematics.joint_motions import fixed, free, revolute
from mbd_sim.dynamics.math.spatial import constant, symmetric
from mbd_sim.dynamics.recursion.eliminated_joints import EliminatedJoint, _GeneralJoint, _SimpleJoint, eliminated

ROOT, FORCES = ca.SX.sym("root", 6, 6), ca.SX.sym("force", 1)
BIAS, ACCELERATION, CARRIED = (ca.SX.sym(name, 6) for name in ("bias", "acceleration", "carried"))
INERTIAS = {
    "dense": symmetric(ROOT),
    "planar": symmetric(ROOT * constant(np.kron([[1.0, 1.0], [1.0, 1.0]], np.diag([0.0, 0.0, 1.0])) + np.eye(6))),
    "numbers": constant(np.diag([0.1, 0.2, 0.3, 2.0, 2.0, 2.0])),
}
AXES = ([0.0, 0.0, 1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0, 0.0, 0.3], [0.48, 0.6, 0.64, 0.0, 0.0, 0.0])


def results(joint: EliminatedJoint, force: ca.SX, acceleration: ca.SX | None) -> list[ca.SX]:
    """All that a joint gives."""
    net_force, transmitted = joint.inward(force, BIAS, acceleration)
    outward = joint.outward(net_force, CARRIED)
    return [joint.factors.pivots, joint.projected_inertia, net_force, transmitted, *outward]


def function(values: list[ca.SX]) -> ca.Function:
    """A function of all symbols."""
    return ca.Function("f", [ROOT, FORCES, BIAS, ACCELERATION, CARRIED], [ca.densify(value) for value in values])


@pytest.mark.parametrize("acceleration", [None, ACCELERATION], ids=["still", "accelerated"])
@pytest.mark.parametrize("added", [0.0, 0.7])
@pytest.mark.parametrize("axis", AXES, ids=str)
@pytest.mark.parametrize("inertia", INERTIAS.values(), ids=INERTIAS)
def test_a_joint_with_one_coordinate_gives_the_instructions_of_the_general_one(inertia, axis, added, acceleration):
    s, more = constant(np.array(axis)), ca.SX(added)
    simple, general = _SimpleJoint(s, inertia, more), _GeneralJoint(s, inertia, more)
    assert simple.projected_inertia.sparsity() == general.projected_inertia.sparsity()
    one, other = (instructions_of(function(results(joint, FORCES, acceleration))) for joint in (simple, general))
    assert one == other


def test_the_numbers_are_those_of_dense_matrices():
    rng = np.random.default_rng(3)
    root = rng.uniform(-1.0, 1.0, (6, 6))
    inertia, (force, bias, acceleration, carried) = root @ root.T, (rng.uniform(-1.0, 1.0, n) for n in (1, 6, 6, 6))
    s = np.array([[0.48], [0.6], [0.64], [0.1], [0.2], [-0.3]])
    joint = eliminated(revolute(np.array([0.0, 0.0, 1.0]), ca.SX.sym("q"), ca.SX.sym("u")), constant(inertia), None)
    assert isinstance(joint, _SimpleJoint)
    joint = _SimpleJoint(constant(s), symmetric(ROOT), ca.SX(0.7))
    found = [
        np.array(value)
        for value in function(results(joint, FORCES, ACCELERATION))(inertia, force, bias, acceleration, carried)
    ]
    own = (s.T @ inertia @ s + 0.7).item()
    projected = inertia - inertia @ s @ s.T @ inertia / own
    net_force = force - s.T @ bias
    u_rate = (net_force - s.T @ inertia @ carried) / own
    expected = [
        own,
        projected,
        net_force,
        bias + projected @ acceleration + (inertia @ s)[:, 0] * net_force / own,
        carried + s[:, 0] * u_rate,
        u_rate,
    ]
    for one, other in zip(found, expected, strict=True):
        assert one.ravel() == pytest.approx(np.ravel(other), abs=2e-14)


def test_a_fixed_joint_transmits_everything():
    joint = eliminated(fixed(), INERTIAS["dense"], None)
    none = ca.SX(0, 1)
    net_force, transmitted = joint.inward(none, BIAS, ACCELERATION)
    acceleration, u_rates = joint.outward(net_force, CARRIED)
    assert ca.is_equal(joint.projected_inertia, INERTIAS["dense"], 1) and u_rates.shape == (0, 1)
    assert ca.is_equal(acceleration, CARRIED, 1)
    assert instructions_of(function([transmitted])) == instructions_of(
        function([BIAS + INERTIAS["dense"] @ ACCELERATION])
    )


def test_a_free_link_accelerates_as_in_its_own_axes():
    rng, state = np.random.default_rng(4), [ca.SX.sym("q", 7), ca.SX.sym("u", 6)]
    motion = free(*state)
    joint = eliminated(motion, symmetric(ROOT), None)
    force = ca.SX.sym("forces", 6)
    net_force, transmitted = joint.inward(force, BIAS, None)
    acceleration, u_rates = joint.outward(net_force, CARRIED)
    values = [net_force, transmitted, acceleration, CARRIED + motion.partial_velocities @ u_rates]
    evaluate = ca.Function("f", [*state, ROOT, force, BIAS, CARRIED], [ca.densify(value) for value in values])
    root, q = rng.uniform(-1.0, 1.0, (6, 6)), rng.uniform(-1.0, 1.0, 7)
    q[3:] /= np.linalg.norm(q[3:])
    inertia, (u, forces, bias, carried) = root @ root.T + np.eye(6), (rng.uniform(-1.0, 1.0, 6) for _ in range(4))
    net, passed, found, by_speeds = (
        np.array(value).ravel() for value in evaluate(q, u, inertia, forces, bias, carried)
    )
    assert joint.projected_inertia.nnz() == 0 and net == pytest.approx(passed - bias, abs=1e-15)
    assert found == pytest.approx(np.linalg.solve(inertia, net), abs=1e-13)
    assert by_speeds == pytest.approx(found, abs=1e-13)
