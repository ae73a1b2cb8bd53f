"""Every joint type has all that the package needs to know of it: a new one fails here until it is complete."""

from typing import get_args
from xml.etree import ElementTree

import casadi as ca
import numpy as np
import pytest

from mbd_sim import Simulation, parse_mechanism
from mbd_sim.dynamics.constraints.rows import branch_checks, joint_frames, loop_equations
from mbd_sim.dynamics.kinematics.joint_motions import JOINT_MOTIONS
from mbd_sim.dynamics.kinematics.links import build_links
from mbd_sim.dynamics.kinematics.poses import BodySymbols
from mbd_sim.files.mjcf.writer import to_mjcf
from mbd_sim.files.schema.joints import AnyJointSpec
from mbd_sim.files.sdf.writer import to_sdf
from mbd_sim.files.urdf.writer import to_urdf
from mbd_sim.mechanism.elements.joint_types import JOINT_KINDS, JointType, LoopCondition
from mbd_sim.pictures.drawing.picture import compose
from mbd_sim.pictures.shapes.extent import extent_of
from mbd_sim.pictures.shapes.primitives import primitives

KEYS = {
    "revolute": "axis: [0, 0, 1]",
    "prismatic": "axis: [0, 0, 1]",
    "screw": "axis: [0, 0, 1], lead: 0.1",
    "cylindrical": "axis: [0, 0, 1]",
    "universal": "axes: [[0, 0, 1], [1, 0, 0]]",
    "planar": "axis: [0, 0, 1], x_axis: [1, 0, 0]",
    "spherical": "",
    "free": "",
    "fixed": "",
}
FILE = """
mechanism: one_joint
parts:
  carrier: {{mass: 1, inertia: [1, 1, 1], shape: {{type: sphere, radius: 0.1}}}}
  body: {{mass: 1, inertia: [1, 1, 1], shape: {{type: sphere, radius: 0.1}}}}
joints:
  base: {{type: revolute, between: [ground, carrier], axis: [0, 1, 0]}}
  joint: {{type: {type}, between: [carrier, body], {keys}}}
"""
URDF_TYPES = {
    "revolute": ["continuous"],
    "prismatic": ["prismatic"],
    "screw": ["continuous", "prismatic"],
    "cylindrical": ["prismatic", "continuous"],
    "universal": ["continuous", "continuous"],
    "planar": ["prismatic", "prismatic", "continuous"],
    "spherical": ["floating"],
    "free": ["floating"],
    "fixed": ["fixed"],
}
EQUATIONS = {
    "coincident points": 3,
    "point on axis": 2,
    "point in plane": 1,
    "parallel axes": 2,
    "equal orientations": 3,
    "constant angle between axes": 1,
    "advance by the lead": 1,
}


@pytest.fixture(scope="module")
def simulations():
    return {type_: Simulation.from_text(FILE.format(type=type_, keys=KEYS[type_])) for type_ in JOINT_KINDS}


def test_the_schema_the_table_and_the_motions_have_the_same_types():
    specifications = get_args(get_args(AnyJointSpec)[0])
    in_files = [get_args(specification.model_fields["type"].annotation)[0] for specification in specifications]
    assert set(in_files) == set(JOINT_KINDS) == set(JOINT_MOTIONS) == set(get_args(JointType)) == set(KEYS)
    assert len(in_files) == len(JOINT_KINDS)


@pytest.mark.parametrize("type_", JOINT_KINDS)
def test_its_motion_has_its_coordinates(type_, simulations):
    kind = JOINT_KINDS[type_]
    link = build_links(simulations[type_].mechanism)[1]
    motion = JOINT_MOTIONS[type_](link.axes, ca.SX.sym("q", kind.nq), ca.SX.sym("u", kind.nv))
    assert motion.partial_velocities.shape == (6, kind.nv)
    assert motion.q_rates.numel() == kind.nq
    simulation = simulations[type_]
    assert len(simulation.coordinate_names) == 1 + kind.nv
    simulation.run(until=0.01)
    assert np.all(np.isfinite(simulation.state))


@pytest.mark.parametrize("type_", JOINT_KINDS)
def test_its_directions_are_those_of_its_motion(type_, simulations):
    """The coordinates' directions, in the axes of the frames that they name, are the columns of S at q = 0."""
    simulation, kind = simulations[type_], JOINT_KINDS[type_]
    joint, link = simulation.mechanism.joints["joint"], build_links(simulation.mechanism)[1]
    q, u = ca.SX.sym("q", kind.nq), ca.SX.sym("u", kind.nv)
    at_zero = np.zeros(kind.nq)
    if kind.quaternion is not None:
        at_zero[kind.quaternion] = 1.0
    motion = JOINT_MOTIONS[type_](link.axes, q, u)
    columns = np.array(ca.Function("columns", [q], [ca.densify(motion.partial_velocities)])(at_zero))
    turn = joint.parent_pose.rotation.T @ (np.eye(3) @ link.X_PF.rotation)  # the link's axes may be rotated
    for column, coordinate in zip(columns.T, kind.coordinates, strict=True):
        moving = column[:3] if coordinate.rotation else column[3:]
        np.testing.assert_allclose(turn @ moving, joint.direction(coordinate), atol=1e-12)


@pytest.mark.parametrize("type_", JOINT_KINDS)
def test_its_loop_equations_leave_its_freedoms(type_, simulations):
    joint = simulations[type_].mechanism.joints["joint"]
    bodies = BodySymbols(build_links(simulations[type_].mechanism))
    first, second = joint_frames(joint, bodies)
    equations = list(loop_equations(joint, first, second, first.rotation))
    assert len(equations) == 6 - joint.kind.nv
    assert len(equations) == sum(EQUATIONS[condition] for condition in joint.kind.loop_conditions)
    assert all(check.numel() == 1 for check in branch_checks(joint, first, second))
    assert set(EQUATIONS) == set(get_args(LoopCondition))


@pytest.mark.parametrize("type_", JOINT_KINDS)
def test_it_has_a_form_in_urdf(type_, simulations):
    robot = ElementTree.fromstring(to_urdf(simulations[type_].mechanism))
    found = [joint.get("type") for joint in robot.findall("joint") if joint.get("name", "").startswith("joint")]
    assert found == URDF_TYPES[type_]


@pytest.mark.parametrize("type_", JOINT_KINDS)
@pytest.mark.parametrize("write", [to_sdf, to_mjcf])
def test_it_moves_alike_when_another_format_is_read_back(type_, write, simulations):
    mechanism = simulations[type_].mechanism
    read = parse_mechanism(write(mechanism).text)
    assert sum(len(joint.coordinate_names) for joint in read.joints.values()) >= 1 + JOINT_KINDS[type_].nv
    one, other = (Simulation(each, method="rk4") for each in (mechanism, read))
    for simulation in (one, other):
        simulation.run(until=0.2)
    np.testing.assert_allclose(*(found.poses()["body"].position for found in (one, other)), atol=1e-9)


@pytest.mark.parametrize("type_", JOINT_KINDS)
def test_it_has_a_picture(type_, simulations):
    simulation = simulations[type_]
    assert compose(simulation.mechanism, simulation.poses()).sheet.paths


@pytest.mark.parametrize("type_", JOINT_KINDS)
def test_it_has_primitives_for_viewers(type_, simulations):
    model = simulations[type_].model
    drawn = primitives(model.mechanism, extent_of(model), lambda mesh: True)
    assert any(one.kind == "joints" and one.path[0] == "joint" for one in drawn) == JOINT_KINDS[type_].connects
