"""Reactions of statically indeterminate mechanisms against a model whose joints are springs."""

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.geometry.rotation import skew
from test.generators.overconstrained import linkage_text


def direction(sim, poses, joint, axis):
    """An axis of a joint in ground's axes."""
    rotation = np.eye(3) if joint.parent == "ground" else poses[joint.parent].rotation
    return rotation @ joint.parent_pose.rotation @ axis


def moment_directions(sim, poses, joint):
    """The projection (3, 3) onto the moments that a joint transmits."""
    match joint.type:
        case "revolute":
            axis = direction(sim, poses, joint, joint.axis)
            return np.eye(3) - np.outer(axis, axis)
        case "spherical":
            return np.zeros((3, 3))
        case "universal":
            second = poses[joint.child].rotation @ joint.child_pose.rotation @ joint.second
            normal = np.cross(direction(sim, poses, joint, joint.axis), second)
            return np.outer(normal, normal) / (normal @ normal)
    raise NotImplementedError(joint.type)


def elastic_reactions(sim):
    """The reactions (joints, 6) of elastic joints under the loads that the reactions of the simulation carry."""
    parts, poses, length = list(sim.mechanism.parts), sim.poses(), sim.model.load_sharing.length
    stiffness, loads, springs = np.zeros((6 * len(parts),) * 2), np.zeros(6 * len(parts)), []
    for name, joint in sim.mechanism.all_joints.items():
        at = joint.child_pose.position
        at = at if joint.child == "ground" else poses[joint.child].position + poses[joint.child].rotation @ at
        relative = np.zeros((6, 6 * len(parts)))  # displacement of the child less that of the parent, at the joint
        for part, sign in ((joint.child, 1.0), (joint.parent, -1.0)):
            if part != "ground":
                arm, columns = at - poses[part].position, slice(6 * parts.index(part), 6 * parts.index(part) + 6)
                relative[:, columns] = sign * np.block([[np.eye(3), -skew(arm)], [np.zeros((3, 3)), np.eye(3)]])
        spring = np.zeros((6, 6))
        spring[:3, :3] = np.eye(3) / joint.compliance
        spring[3:, 3:] = length**2 / joint.compliance * moment_directions(sim, poses, joint)
        stiffness += relative.T @ spring @ relative
        loads += relative.T @ np.concatenate(sim.reactions()[name])
        springs.append(spring @ relative)
    displacements = np.linalg.lstsq(stiffness, loads, rcond=1e-11)[0]
    return np.array([spring @ displacements for spring in springs])


def reactions(sim):
    return np.array([np.concatenate(reaction) for reaction in sim.reactions().values()])


def reactions_by_casadi(sim):
    """The same from the functions of the equations as CasADi evaluates them, with the null space of all rows of G."""
    model, arguments = sim.model, (sim.time, sim.y, np.array(sim.inputs))
    equations, sharing = model.equations, model.load_sharing
    given, multipliers = np.array(equations.reactions(*arguments)), np.array(equations.multipliers(*arguments)).ravel()
    loads = equations.load_paths.loads(equations.load_paths.values(*arguments))
    stresses = np.linalg.svd(loads.gradient)[0][:, equations.start.rank :]
    by_stresses = loads.of_drives @ stresses
    if by_stresses.size:
        stresses = stresses @ np.linalg.svd(by_stresses)[2][np.linalg.matrix_rank(by_stresses, tol=1e-9) :].T
    joints = [*model.mechanism.joints.values(), *model.mechanism.closing.values()]
    weights = np.array([[np.sqrt(j.compliance)] * 3 + [np.sqrt(j.compliance) / sharing.length] * 3 for j in joints])
    own = [row.owner[0] == "constraints" for row in equations.rows]
    to_weighted = np.vstack([weights.reshape(-1, 1) * loads.of_reactions, np.eye(len(own))[own]])
    weighted = np.concatenate([(weights * given.T).ravel(), multipliers[own]])
    shares = stresses @ np.linalg.pinv(to_weighted @ stresses) @ -weighted
    return given.T + (loads.of_reactions @ shares).reshape(-1, 6)


def agree(found, expected, tolerance=1e-9):
    assert np.max(np.abs(found - expected)) < tolerance * np.max(np.abs(expected))


@pytest.mark.parametrize("name", ["bennett"])
def test_the_load_is_shared_as_by_elastic_joints(name):
    sim = Simulation.from_text(linkage_text(name, 0, driven=False))
    assert sim.model.load_sharing.indeterminacy > 0
    for _ in range(2):
        agree(reactions(sim), elastic_reactions(sim))
        agree(reactions(sim), reactions_by_casadi(sim), 1e-12)
        sim.step(60)


@pytest.mark.parametrize(("name", "can_share"), [("four_bar", False), ("scissor_lift", True)])
def test_the_self_stresses_of_plane_linkages_are_known_without_a_decomposition(name, can_share):
    """Those of a loop of joints alone carry nothing; the scissor lift also has constraints."""
    sim = Simulation.from_file(name)
    sim.step(40)
    sharing, paths = sim.model.load_sharing, sim.model.equations.load_paths
    assert len(paths.idle) == sharing.indeterminacy and sharing.can_share == can_share
    loads = paths.loads(paths.values(sim.time, sim.y, np.array(sim.inputs)))
    assert not loads.gradient[paths.idle].any()
    agree(reactions(sim), reactions_by_casadi(sim), 1e-12)
    of_model = sim.model.reactions(sim.time, sim.y, np.array(sim.inputs)).values()
    assert np.array([np.concatenate(one) for one in of_model]).tobytes() == reactions(sim).tobytes()


CRANKS = """
mechanism: cranks
parts:
  one: {mass: 0.5, center: [0.1, 0.02, 0], inertia: [0.01, 0.02, 0.01], points: {tip: [0.2, 0, 0]}}
  two: {mass: 0.4, center: [0.1, 0, 0], inertia: [0.01, 0.02, 0.01], points: {tip: [0.2, 0, 0]}}
  three: {mass: 0.3, center: [0.1, 0, 0], inertia: [0.01, 0.02, 0.01], points: {tip: [0.2, 0, 0]}}
  coupler:
    {mass: 1.2, center: [0.33, 0.01, 0.13], inertia: [0.02, 0.05, 0.03], points: {b2: [0.7, 0, 0], b3: [0.3, 0, 0.4]}}
ground: {points: {p2: [0.7, 0, 0], p3: [0.3, 0, 0.4]}}
joints:
  a1: {type: revolute, between: [ground, one], axis: [0, -1, 0], VALUES1}
  a2: {type: revolute, between: [ground.p2, two], axis: [0, -1, 0], VALUES2}
  a3: {type: revolute, between: [ground.p3, three], axis: [0, -1, 0], VALUES3}
  b1: {type: revolute, between: [one.tip, coupler], axis: [0, -1, 0], VALUES4}
  b2: {type: revolute, between: [two.tip, coupler.b2], axis: [0, -1, 0], VALUES5}
  b3: {type: revolute, between: [three.tip, coupler.b3], axis: [0, -1, 0], VALUES6}
"""
CRANK, COUPLED, CUT = "position: 0.6, velocity: 10", "position: 0.6, guess: true", "cut: true"
COUPLER = "position: -0.6, guess: true"
CUTS = [
    (CRANK, COUPLED, COUPLED, COUPLER, CUT, CUT),
    (CRANK, CUT, CUT, COUPLER, COUPLER, COUPLER),
    (CRANK, COUPLED, COUPLED, CUT, COUPLER, CUT),
]


def test_the_reactions_do_not_depend_on_the_joints_that_are_cut():
    found = []
    for values in CUTS:
        text = CRANKS
        for number, value in enumerate(values, start=1):
            text = text.replace(f"VALUES{number}", value)
        sim = Simulation.from_text(text)
        sim.run(0.13)
        found.append({name: np.concatenate(reaction) for name, reaction in sim.reactions().items()})
    for other in found[1:]:
        for name, reaction in found[0].items():
            assert other[name] == pytest.approx(reaction, abs=1e-8)


def test_reactions_change_smoothly_where_two_of_three_cranks_lie_flat():
    text = CRANKS
    for number, value in enumerate(CUTS[0], start=1):
        text = text.replace(f"VALUES{number}", value)
    sim = Simulation.from_text(text)
    samples = []
    while sim.q[0] < 0.6 + 2.0 * np.pi:
        samples.append(reactions(sim))
        sim.step()
    samples = np.array(samples)
    second = np.diff(samples, 2, axis=0)
    assert np.max(np.abs(second)) < 1e-3 * np.max(np.abs(samples))


SLIDES = """
mechanism: slides
parts: {table: {mass: 3, inertia: [0.1, 0.1, 0.1]}}
joints:
  left: {type: prismatic, between: [ground, table], axis: [1, 0, 0], compliance: LEFT}
  right: {type: prismatic, between: [ground, table], axis: [1, 0, 0]}
"""


@pytest.mark.parametrize("compliance", [0.25, 1.0, 4.0])
def test_the_share_of_a_joint_is_inverse_to_its_compliance(compliance):
    sim = Simulation.from_text(SLIDES.replace("LEFT", str(compliance)))
    assert sim.model.load_sharing.indeterminacy == 5
    left, right = (sim.reactions()[name].force[2] for name in ("left", "right"))
    assert left + right == pytest.approx(3 * 9.81, rel=1e-12)
    assert left * compliance == pytest.approx(right, rel=1e-12)


def test_multipliers_agree_with_the_reactions():
    """The multipliers of a closing slide are its forces along z and y and its moments, up to order and sign."""
    sim = Simulation.from_text(SLIDES.replace("LEFT", "1").replace("axis: [1, 0, 0]}", "axis: [1, 0, 0], cut: true}"))
    force = sim.reactions()["right"].force[2]
    assert force == pytest.approx(1.5 * 9.81, rel=1e-12)
    assert np.max(np.abs(sim.multipliers()["right"])) == pytest.approx(force, rel=1e-12)


def test_a_mechanism_in_which_nothing_is_redundant_keeps_its_bits():
    sim = Simulation.from_file("spherical_pendulum")
    sim.step(50)
    model = sim.model
    assert model.load_sharing.indeterminacy == 0
    expected = np.array(model.equations.reactions(sim.time, sim.state, np.array(sim.inputs))).T
    assert reactions(sim).tobytes() == expected.tobytes()


def test_the_joints_are_named_whose_force_equilibrium_does_not_determine():
    sim = Simulation.from_text(SLIDES.replace("LEFT", "1"))
    state = sim.time, sim.state, sim.inputs
    assert sim.model.load_sharing.undetermined_forces(*state) == ["left", "right"]
    sim = Simulation.from_file("four_bar")  # its redundant rows carry nothing
    assert sim.model.load_sharing.undetermined_forces(sim.time, sim.state, sim.inputs) == []
