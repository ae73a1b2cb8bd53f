"""A mechanism written as SDF and read again has the same accelerations; test_drake has another reader."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from mbd_sim.cli.main import main
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.files.sdf.writer import to_sdf
from test.files.mjcf.test_writer import replaced_start
from test.files.sdf.models import ROBOT
from test.generators.mechanisms import AUDITED, consistent_state, random_state
from test.oracles.mujoco_oracle import OwnAccelerations

JOINTS = """
mechanism: joints
parts:
  wheel: {mass: 2, shape: {type: disc, radius: 0.3}, points: {rim: {at: [0.3, 0, 0], rotate: {rpy: [0.3, 0.2, 0.1]}}}}
  collar: {mass: 1, shape: {type: cylinder, radius: 5 cm, length: 10 cm}}
  bob: {mass: 1, center: [0, 0.1, -1], inertia: [0.02, 0.03, 0.01]}
  nut: {mass: 0.5, inertia: [0.01, 0.02, 0.02], points: {end: {at: [0, 0.1, 0], rotate: {rpy: [1, 0, 0]}}}}
  puck: {mass: 0.5, inertia: [0.01, 0.02, 0.02], points: {end: {at: [0, 0.1, 0], rotate: {rpy: [1, 0, 0]}}}}
  top: {mass: 0.5, shape: {type: disc, radius: 0.1, at: [0, 0, 0.2]}}
joints:
  hinge: {type: revolute, between: [wheel.rim, ground], axis: [0, 0, 1], damping: 0.1, friction: {coulomb: 0.2}}
  guide: {type: cylindrical, between: [wheel.rim, collar], axis: [0, 1, 1], stiffness: [80, 2], rest: [0.1, 0], damping: [1, 2]}
  cross: {type: universal, between: [collar, bob], axes: [[1, 0, 0], [1, 1, 0]], stiffness: [3, 4], damping: [0.1, 0.2]}
  thread: {type: screw, between: [nut.end, bob], axis: [0, 0, 1], lead: 20 mm}
  table: {type: planar, between: [puck.end, ground], axis: [0, 0, 1], x_axis: [1, 1, 0]}
  point: {type: spherical, between: [puck, top]}
"""
LIGHT = 1e-8  # relative to the largest acceleration: links between the joints of a chain have 1e-9 kg


def again(mechanism):
    return parse_mechanism(to_sdf(mechanism).text)


def renamed(name):
    """The name that a joint or a coordinate has after it was written: SDF reserves `::`."""
    return name.replace("::", "_").replace("robot_foot_base", "base")


def pieces(mechanism, q):
    """The coordinates by name; those of joints with a quaternion together."""
    found, start = {}, 0
    for name, joint in mechanism.joints.items():
        values = q[start : start + joint.kind.nq]
        start += joint.kind.nq
        if joint.kind.quaternion is not None:
            found[renamed(name)] = [*values]
        else:
            found |= {renamed(one): [value] for one, value in zip(joint.motion_names, values, strict=True)}
    return found


def compare(first, second, states, offsets=None, tolerance=1e-10):
    """Accelerations of both, by the names of coordinates."""
    one, other = OwnAccelerations(first), OwnAccelerations(second)
    names = [renamed(name) for name in first.coordinate_names]
    own_names = [renamed(name) for name in second.coordinate_names]
    assert sorted(names) == sorted(own_names)
    places = [names.index(name) for name in own_names]
    for q, u, efforts in states:
        exact = one(q, u, efforts)
        values = pieces(first, q - (0.0 if offsets is None else offsets))
        moved = np.concatenate([values[name] for name in pieces(second, np.zeros(len(q)))])
        found = other(moved, u[places], efforts[places])
        assert np.max(np.abs(found - exact[places])) <= tolerance * np.max(np.abs(exact))


@pytest.mark.parametrize("name", ["double_rod", "six_axis_arm"])
def test_shipped_trees(name):
    mechanism, rng = load_mechanism(name), np.random.default_rng(1)
    compare(mechanism, again(mechanism), [random_state(mechanism, rng) for _ in range(3)])


def test_springs_dampers_and_reversed_joints():
    mechanism, rng = parse_mechanism(AUDITED.replace(", STOP", "")), np.random.default_rng(2)
    compare(mechanism, again(mechanism), [random_state(mechanism, rng) for _ in range(3)])


def test_every_type_of_joint():
    mechanism, rng = parse_mechanism(JOINTS), np.random.default_rng(3)
    compare(mechanism, again(mechanism), [random_state(mechanism, rng, reach=0.7) for _ in range(3)], tolerance=LIGHT)


def test_a_loop_is_written_where_it_is_closed():
    mechanism, rng = load_mechanism("four_bar"), np.random.default_rng(4)
    equations = OwnAccelerations(mechanism).equations
    second = again(mechanism)
    assert len(second.closing) == 1
    states = [consistent_state(equations, rng) for _ in range(3)]
    compare(mechanism, second, states, offsets=equations.start.q, tolerance=1e-9)


def test_limits_of_joints_of_a_loop_count_from_where_it_is_closed():
    limits = "    position: 90 deg\n    limits: {lower: -10 deg, upper: 200 deg}\n"
    text = load_mechanism("four_bar").source.text.replace("    position: 90 deg\n", limits, 1)
    (found,) = again(parse_mechanism(text)).joints["crank_pivot"].limits
    assert np.degrees([found.lower, found.upper]) == pytest.approx([-100.0, 110.0], rel=1e-12)


def test_what_was_read_is_written_and_read_again():
    first, rng = parse_mechanism(ROBOT), np.random.default_rng(5)
    compare(first, again(first), [random_state(first, rng) for _ in range(2)])


def test_mimics_and_limits_count_from_the_start_of_a_loop():
    text = """
mechanism: pair
parts: {a: {mass: 1, inertia: [1, 1, 1]}, b: {mass: 1, inertia: [1, 1, 1]}}
joints:
  x: {type: revolute, between: [ground, a], axis: [0, 0, 1], limits: {lower: -1, upper: 2}}
  y: {type: revolute, between: [ground, b], axis: [0, 0, 1], position: 0.3}
constraints: {link: {type: coupling, terms: {y: 1, x: -2}, value: 0.3}}
"""
    (coupling,) = again(parse_mechanism(text)).constraints
    assert dict(coupling.factors) == {"y": 1.0, "x": -2.0} or dict(coupling.factors) == {"x": 1.0, "y": -0.5}
    (limits,) = again(parse_mechanism(text)).joints["x"].limits
    assert (limits.lower, limits.upper) == (-1.0, 2.0)


def test_the_command_prints_the_file_and_what_it_lacks(capsys):
    assert main(["convert", "four_bar", "--to", "sdf"]) == 0
    printed = capsys.readouterr()
    assert parse_mechanism(printed.out).source.format == "SDF"
    assert "note: not in this file: coordinates, which count from the start: crank_pivot" in printed.err


def test_a_start_away_from_zero_is_listed():
    mechanism = load_mechanism("double_rod")
    moved = replaced_start(mechanism, np.array([0.4, 0.2]), np.zeros(2))
    (note,) = [note for note in to_sdf(moved).left_out if "start" in note]
    assert note == f"positions and velocities at the start: {', '.join(mechanism.joints)}"


@pytest.mark.parametrize("axis", ["type: revolute", "type: prismatic", "type: screw, lead: 20 mm"])
def test_ranges_and_speeds_of_drives_that_follow_commands_are_limits(axis):
    """SDF has no place for their acceleration. A range may be open on one side."""
    text = f"""
mechanism: driven
parts: {{a: {{mass: 1, inertia: [1, 1, 1]}}, b: {{mass: 1, inertia: [1, 1, 1]}}}}
joints:
  one: {{between: [a, ground], {axis}, axis: [0, 0, 1], drive: {{command: position, bandwidth: 8, velocity_limit: 0.5,
         acceleration_limit: 1.2, lower: -1, upper: 2}}}}
  two: {{between: [b, a], {axis}, axis: [0, 0, 1], drive: {{command: position, bandwidth: 8, upper: 3}}}}
"""
    document = to_sdf(parse_mechanism(text))
    assert "limits on the acceleration of drives: one" in document.text
    joints = {one.get("name"): one.find("axis/limit") for one in ElementTree.fromstring(document.text).iter("joint")}
    found = {name: {one.tag: float(one.text) for one in limit} for name, limit in joints.items()}
    assert found == {
        "one": {"lower": -1.0, "upper": 2.0, "velocity": 0.5},
        "two": {"lower": -np.inf, "upper": 3.0},
    }
