"""Mechanisms made of files: the tree, joints, points and parts."""

import math

import numpy as np
import pytest

from mbd_sim.files.load import load_mechanism, parse_mechanism
from test.generators.mechanism_texts import PENDULUM, changed, part_of

ARM = """
mechanism: arm
gravity: [0, 0, -1.62]
integrator: {method: rk4, step: 0.5 ms}
ground: {points: {wall: [1, 2, 3]}}
parts:
  hand: {mass: 1}
  upper: {mass: 2, points: {end: {at: [0, 0, -1], rotate: {axis: [0, 0, 1], angle: 90 deg}}}}
  lower: {mass: 3, points: {top: [0, 0, 0.5], end: [0, 0, -0.5]}}
  kite: {mass: 4}
joints:
  wrist: {type: fixed, between: [lower.end, hand]}
  elbow: {type: revolute, between: [lower.top, upper.end], axis: [0, 3, 4]}
  flight:
    type: free
    between: [ground, kite]
    position: [1, 2, 3]
    orientation: {axis: [0, 0, 1], angle: 90 deg}
    velocity: [4, 5, 6]
    angular_velocity: [7, 8, 9]
  shoulder: {type: prismatic, between: [ground.wall, upper], axis: [0, 0, -2], position: 0.25, velocity: -1}
"""


@pytest.fixture
def arm():
    return parse_mechanism(ARM)


def test_the_tree_leads_from_ground_outwards_whatever_the_declared_order(arm):
    assert arm.tree == ("flight", "shoulder", "elbow", "wrist")
    reached = {"ground"}
    for joint in arm.tree_joints():
        assert joint.inboard in reached
        reached.add(joint.outboard)
    assert reached == {"ground", *arm.parts}


def test_joints_keep_their_declared_order(arm):
    assert list(arm.joints) == ["wrist", "elbow", "flight", "shoulder"]
    assert arm.coordinate_names == (
        "elbow", "flight.x", "flight.y", "flight.z", "flight.rx", "flight.ry", "flight.rz", "shoulder",
    )  # fmt: skip


def test_a_joint_walked_from_its_second_part_is_reversed(arm):
    assert {name for name, joint in arm.joints.items() if joint.reversed} == {"elbow"}
    elbow = arm.joints["elbow"]
    assert (elbow.parent, elbow.child, elbow.inboard, elbow.outboard) == ("lower", "upper", "upper", "lower")


def test_a_joint_is_at_its_points_with_their_orientation(arm):
    elbow, shoulder = arm.joints["elbow"], arm.joints["shoulder"]
    assert elbow.parent_pose.position.tolist() == [0.0, 0.0, 0.5]
    assert elbow.parent_pose.rotation.tolist() == np.eye(3).tolist()
    assert elbow.child_pose.position.tolist() == [0.0, 0.0, -1.0]
    assert elbow.child_pose.rotation == pytest.approx(np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]]), abs=1e-15)
    assert shoulder.parent_pose.position.tolist() == [1.0, 2.0, 3.0]
    assert shoulder.child_pose.position.tolist() == [0.0, 0.0, 0.0]


def test_axes_have_length_one_and_states_are_as_given(arm):
    assert arm.joints["elbow"].axis == pytest.approx(np.array([0, 0.6, 0.8]))
    shoulder, flight = arm.joints["shoulder"], arm.joints["flight"]
    assert shoulder.axis.tolist() == [0.0, 0.0, -1.0]
    assert (shoulder.position.tolist(), shoulder.velocity.tolist()) == ([0.25], [-1.0])
    half = math.sqrt(0.5)
    assert flight.position == pytest.approx(np.array([1, 2, 3, half, 0, 0, half]))
    assert flight.velocity.tolist() == [4.0, 5.0, 6.0, 7.0, 8.0, 9.0]
    assert arm.joints["wrist"].position.size == 0


def test_settings_and_masses_are_as_given(arm):
    assert (arm.name, arm.method, arm.step) == ("arm", "rk4", 0.0005)
    assert arm.gravity.tolist() == [0.0, 0.0, -1.62]
    assert arm.mass == 10.0
    assert arm.ground_points["wall"].position.tolist() == [1.0, 2.0, 3.0]


def test_what_is_not_given_has_the_documented_default():
    mechanism = parse_mechanism(changed(("    position: 90 deg\n", "")))
    pin = mechanism.joints["pin"]
    assert mechanism.gravity.tolist() == [0.0, 0.0, -9.81]
    assert (mechanism.method, mechanism.step, mechanism.description) == ("auto", 0.001, "")
    assert (pin.stiffness, pin.rest, pin.damping, pin.limits, pin.effort_limit) == (0.0, 0.0, 0.0, (), None)
    assert (pin.position.tolist(), pin.velocity.tolist(), pin.reversed) == ([0.0], [0.0], False)
    assert mechanism.effort_limits().tolist() == [math.inf]


def test_limits_and_efforts_are_as_given():
    end = "    position: 90 deg\n"
    limits = "    limits: {lower: -1, upper: 180 deg, stiffness: 50}\n    effort_limit: 7\n"
    springs = "    stiffness: 3\n    rest: 0.5\n    damping: 0.25\n    velocity: 2\n"
    pin = parse_mechanism(changed((end, end + limits + springs))).joints["pin"]
    assert (pin.limits[0].lower, pin.limits[0].upper, pin.limits[0].stiffness) == (-1.0, math.pi, 50.0)
    assert (pin.stiffness, pin.rest, pin.damping, pin.effort_limit) == (3.0, 0.5, 0.25, 7.0)
    assert pin.velocity.tolist() == [2.0]


def test_a_part_without_shape_is_a_point_mass_or_has_its_given_inertia():
    point = part_of("{mass: 2, center: [1, 2, 3]}")
    assert (point.mass, point.center.tolist(), point.inertia.any()) == (2.0, [1.0, 2.0, 3.0], False)
    moments = part_of("{mass: 2, inertia: [1, 2, 2.5]}")
    assert moments.inertia.tolist() == np.diag([1, 2, 2.5]).tolist() and not moments.center.any()
    full = part_of("{mass: 2, inertia: {xx: 1, yy: 2, zz: 2.5, xy: -0.1, xz: 0.2, yz: 0.3}}")
    assert full.inertia.tolist() == [[1, -0.1, 0.2], [-0.1, 2, 0.3], [0.2, 0.3, 2.5]]


def test_beside_a_given_inertia_shapes_are_only_drawn():
    part = part_of("{mass: 1, inertia: [1, 2, 3], shape: {type: block, size: [9, 9, 9], color: '#00ff7f'}}")
    assert part.inertia.tolist() == np.diag([1, 2, 3]).tolist()
    (shape,) = part.shapes
    assert (shape.kind, shape.size, shape.color, shape.hole) == ("block", (9.0, 9.0, 9.0), "#00ff7f", False)


def test_shapes_are_drawn_centerd_with_their_axis_along_z():
    part = part_of(
        """{mass: 1, inertia: [1, 1, 1], shapes: [
          {type: rod, from: [1, 0, 0], to: [1, 2, 0], radius: 0.1},
          {type: cylinder, radius: 0.2, length: 3, axis: [2, 0, 0], at: [0, 0, 5]}]}"""
    )
    rod, cylinder = part.shapes
    assert (rod.size, rod.pose.position.tolist()) == ((2.0, 0.1), [1.0, 1.0, 0.0])
    assert (rod.pose.rotation @ [0, 0, 1]).tolist() == [0.0, 1.0, 0.0]
    assert (cylinder.size, cylinder.pose.position.tolist()) == ((3.0, 0.2), [0.0, 0.0, 5.0])
    assert (cylinder.pose.rotation @ [0, 0, 1]).tolist() == [1.0, 0.0, 0.0]


def test_a_massless_part_may_be_between_massive_ones():
    mechanism = parse_mechanism(
        """
        mechanism: gimbal
        parts: {frame: {mass: 0, shape: {type: ring, radius: 1}}, wheel: {mass: 1, inertia: [1, 1, 2]}}
        joints:
          outer: {type: revolute, between: [ground, frame], axis: [1, 0, 0]}
          inner: {type: revolute, between: [frame, wheel], axis: [0, 1, 0]}
        """
    )
    frame = mechanism.parts["frame"]
    assert (frame.mass, frame.inertia.any(), len(frame.shapes)) == (0.0, False, 1)


def test_a_massless_part_may_be_fixed_to_a_massive_one():
    extra = "  tool: {mass: 0}\njoints:\n  grip: {type: fixed, between: [rod.tip, tool]}\n"
    assert parse_mechanism(changed(("joints:\n", extra))).mass == 2.0


def test_empty_keys_count_as_not_given():
    text = changed(
        ("    mass: m\n", "    mass: m\n    center:\n    inertia: null\n"), ("90 deg\n", "90 deg\n    limits: ~\n")
    )
    assert parse_mechanism(text).joints["pin"].limits == ()


def test_the_source_is_kept_with_the_mechanism():
    mechanism = parse_mechanism(PENDULUM, "somewhere.yaml")
    assert mechanism.source.text == PENDULUM and mechanism.source.file == "somewhere.yaml"
    assert mechanism.source.line(("joints", "pin", "axis")) == 14


def test_a_long_chain_is_built_in_order():
    count = 1100  # more than Python calls within each other
    parts = "".join(f"  p{i}: {{mass: 1}}\n" for i in range(count))
    joints = "".join(
        f"  j{i}: {{type: fixed, between: [{f'p{i - 1}' if i else 'ground'}, p{i}]}}\n" for i in reversed(range(count))
    )
    mechanism = parse_mechanism(f"mechanism: chain\nparts:\n{parts}joints:\n{joints}")
    assert mechanism.tree == tuple(f"j{i}" for i in range(count))


def test_the_shipped_double_rod_is_what_its_file_says():
    mechanism = load_mechanism("double_rod")
    assert mechanism.tree == ("shoulder", "elbow")
    for part in mechanism.parts.values():
        assert part.mass == 1.0 and part.center.tolist() == [0.0, 0.0, -0.5]
        assert part.inertia == pytest.approx(np.diag([1 / 12, 1 / 12, 0]), abs=1e-16)
    assert mechanism.joints["shoulder"].position == pytest.approx([math.pi / 2])
