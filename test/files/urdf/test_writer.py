"""URDF out: its tree of frames places every part where the engine places it, and read again it moves alike."""

import dataclasses
import json
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from hypothesis import given, settings

from mbd_sim import Simulation
from mbd_sim.base.geometry.rotation import about, from_rpy
from mbd_sim.cli.main import main
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.files.urdf.writer import floating_joints, left_out, to_urdf
from test.generators.mechanisms import KINDS, accelerations, random_state, random_trees
from test.oracles import kane

TURNED = """
mechanism: turned
parts:
  base:
    mass: 2
    shape: {type: block, size: [0.4, 0.3, 0.2], color: "#aa3300"}
    points: {top: {at: [0.1, 0, 0.2], rotate: {rpy: [0.3, -0.2, 0.5]}}}
  arm:
    mass: 1
    shape: {type: cylinder, radius: 0.05, length: 0.6}
    points: {end: {at: [0, 0.1, -0.3], rotate: {axis: [1, 2, 3], angle: 0.7}}}
  slide: {mass: 1, shape: {type: sphere, radius: 0.1}}
joints:
  swing: {type: revolute, between: [arm.end, base.top], axis: [1, 2, -1], position: 0.4}
  foot: {type: fixed, between: [ground, base]}
  rail:
    type: prismatic
    between: [arm, slide]
    axis: [0, 3, 4]
    position: 0.2
    limits: {lower: -1, upper: 1}
    effort_limit: 7
"""


def vector(element, name):
    return np.array([float(word) for word in element.get(name).split()])


def frames(urdf, positions):
    """Link frames by walking the URDF, as a URDF consumer does."""
    found = {"ground": (np.zeros(3), np.eye(3))}
    for joint in ElementTree.fromstring(urdf).findall("joint"):
        at, turned = found[joint.find("parent").get("link")]
        origin = joint.find("origin")
        at, turned = at + turned @ vector(origin, "xyz"), turned @ from_rpy(*vector(origin, "rpy"))
        if joint.get("type") in ("revolute", "continuous"):
            turned = turned @ about(vector(joint.find("axis"), "xyz"), positions[joint.get("name")])
        if joint.get("type") == "prismatic":
            at = at + turned @ vector(joint.find("axis"), "xyz") * positions[joint.get("name")]
        found[joint.find("child").get("link")] = (at, turned)
    return found


@pytest.mark.parametrize("source", ["double_rod", TURNED], ids=["double_rod", "turned"])
def test_the_frames_of_the_urdf_are_those_of_the_engine(source):
    simulation = Simulation.from_text(source) if "\n" in source else Simulation.from_file(source)
    found = frames(to_urdf(simulation.mechanism), dict(zip(simulation.coordinate_names, simulation.q, strict=True)))
    for name, pose in simulation.poses().items():
        assert found[name][0] == pytest.approx(pose.position, abs=1e-14)
        assert found[name][1] == pytest.approx(pose.rotation, abs=1e-14)


def test_masses_limits_and_colors_are_there():
    robot = ElementTree.fromstring(to_urdf(Simulation.from_text(TURNED).mechanism))
    assert [float(mass.get("value")) for mass in robot.iter("mass")] == [2.0, 1.0, 1.0]
    rail = robot.find("joint[@name='rail']/limit")
    assert [float(rail.get(key)) for key in ("lower", "upper", "effort")] == [-1.0, 1.0, 7.0]
    assert robot.find("link[@name='base']/visual/material/color").get("rgba").startswith("0.6666")


def test_a_free_joint_floats():
    robot = ElementTree.fromstring(to_urdf(Simulation.from_file("tumbling").mechanism))
    assert [joint.get("type") for joint in robot.iter("joint")] == ["floating"]


EVERY_AXIAL_TYPE = """
mechanism: chain
parts:
  a: {mass: 2, center: [0.1, 0, 0.2], inertia: {xx: 0.2, yy: 0.3, zz: 0.25, xy: 0.01}, points: {p: [0.3, 0, 0.1]}}
  b: {mass: 1, inertia: [0.1, 0.1, 0.1], points: {p: {at: [0, 0.2, 0], rotate: {rpy: [0.3, 1.5707963, 0.1]}}}}
  c: {mass: 1, center: [0, 0, -0.3], inertia: [0.1, 0.2, 0.15], points: {p: {at: [0, 0, 1], rotate: {rpy: [1, 2, 3]}}}}
  d: {mass: 3, inertia: [0.4, 0.5, 0.6], points: {p: [1, 2, 3]}}
  e: {mass: 1, inertia: [0.1, 0.1, 0.1]}
  f: {mass: 1, inertia: [0.1, 0.1, 0.1]}
  g: {mass: 1, inertia: [0.1, 0.1, 0.1]}
joints:
  plane: {type: planar, between: [a.p, ground], axis: [1, 2, 3], damping: [1, 2, 3],
          stiffness: [4, 5, 6], rest: [0.1, 0.2, -0.3]}
  cross: {type: universal, between: [a, b.p], axes: [[1, 0, 0], [1, 1, 0]], damping: [0.1, 0.2]}
  tube: {type: cylindrical, between: [c.p, b], axis: [0, 1, 1], damping: [0.3, 0.4]}
  bolt: {type: screw, between: [c, d.p], axis: [0, 0, 1], lead: 0.3, damping: 0.2, stiffness: 2, rest: 0.4}
  swing: {type: revolute, between: [d, e], axis: [1, 0, 1], friction: {coulomb: 0.5, viscous: 0.1}, damping: 0.2,
          limits: {lower: -1, upper: 2}, velocity_limit: 3}
  slide: {type: prismatic, between: [f, d], axis: [1, 1, 1], friction: {coulomb: 0.5}, effort_limit: 8,
          stiffness: 5, rest: -0.2}
  float: {type: free, between: [ground, g]}
"""


def kept_by_urdf(text):
    """A random tree without what URDF cannot say."""
    data = json.loads(text)
    data.pop("forces", None)
    for name, joint in data["joints"].items():
        ball = joint["type"] in ("spherical", "free")
        for key in ("drive", "spring", "damper", *(("stiffness", "rest") if ball else ())):
            joint.pop(key, None)
        if "friction" in joint:
            joint["friction"] = {"coulomb": joint["friction"]["coulomb"]}
        if "limits" in joint:
            joint["limits"] = {"lower": joint["limits"]["lower"], "upper": joint["limits"]["upper"]}
        if joint["type"] == "spherical" or (joint["type"] == "free" and not inboard_first(joint)):
            data["joints"][name] = {"type": "fixed", "between": joint["between"]}
    return json.dumps(data)


def inboard_first(joint):
    first, second = (0 if end.startswith("ground") else 1 + int(end.partition(".")[0][1:]) for end in joint["between"])
    return first < second


def check_again(mechanism, rng):
    """Hold the accelerations of a mechanism against those of its URDF, read again."""
    again = dataclasses.replace(parse_mechanism(to_urdf(mechanism)), gravity=mechanism.gravity)
    q, u, efforts = random_state(mechanism, rng)
    where, _, _ = kane.coordinate_slices(mechanism)
    there, nq, nv = kane.coordinate_slices(again)
    q2, u2, efforts2 = np.zeros(nq), np.zeros(nv), np.zeros(nv)
    pairs = []
    for name, joint in mechanism.joints.items():
        in_q, in_u = where[name]
        labels = joint.motion_names
        if joint.type == "free":
            labels, groups = [name], [(in_q, in_u)]
        else:
            groups = [
                (slice(i, i + 1), slice(j, j + 1))
                for i, j in zip(range(in_q.start, in_q.stop), range(in_u.start, in_u.stop), strict=True)
            ]
        for label, (from_q, from_u) in zip(labels, groups, strict=True):
            q2[there[label][0]], u2[there[label][1]] = q[from_q], u[from_u]
            efforts2[there[label][1]] = efforts[from_u]
            pairs.append((from_u, there[label][1]))
        if joint.type == "screw":
            travel = there[f"{name}.travel"]
            q2[travel[0]], u2[travel[1]] = (joint.lead / (2.0 * np.pi) * value for value in (q[in_q], u[in_u]))
    found, expected = accelerations(derive(again), q2, u2, efforts2), accelerations(derive(mechanism), q, u, efforts)
    if not len(u):
        return
    oracle = kane.equations(mechanism, q, u, efforts, 0.0)
    difference = np.concatenate([found[theirs] - expected[ours] for ours, theirs in pairs])
    order = np.concatenate([np.arange(ours.start, ours.stop) for ours, _ in pairs])
    largest = max(np.linalg.norm(oracle.scale * expected), 1.0)
    assert np.linalg.norm(oracle.scale[order] * difference) <= 1e-12 * max(1.0, 1e-3 * oracle.condition) * largest


def test_every_axial_type_comes_back():
    check_again(parse_mechanism(EVERY_AXIAL_TYPE), np.random.default_rng(0))


@settings(max_examples=5, deadline=None)
@given(random_trees())
def test_random_trees_come_back(drawn):
    text, rng = drawn
    check_again(parse_mechanism(kept_by_urdf(text)), rng)


@pytest.mark.parametrize("name", KINDS[::2])
def test_every_shipped_mechanism_is_written(name):
    mechanism = load_mechanism(name)
    robot = ElementTree.fromstring(to_urdf(mechanism))
    links = [link.get("name") for link in robot.iter("link") if link in list(robot)]
    assert len(set(links)) == len(links) and set(mechanism.parts) < set(links)
    assert sum(float(mass.get("value")) for mass in robot.iter("mass")) == pytest.approx(mechanism.mass)
    names = [joint.get("name") for joint in robot.findall("joint")]
    assert len(set(names)) == len(names) == len(links) - 1


def test_several_coordinates_become_a_chain_named_as_in_joint_states():
    robot = ElementTree.fromstring(to_urdf(parse_mechanism(EVERY_AXIAL_TYPE)))
    types = {joint.get("name"): joint.get("type") for joint in robot.findall("joint")}
    expected = {
        "plane.x": "prismatic",
        "plane.y": "prismatic",
        "plane.angle": "continuous",
        "cross.first": "continuous",
        "cross.second": "continuous",
        "tube.displacement": "prismatic",
        "tube.angle": "continuous",
        "bolt": "continuous",
        "bolt.travel": "prismatic",
        "swing": "revolute",
        "float": "floating",
    }
    assert expected.items() <= types.items()
    assert float(robot.find("joint[@name='bolt.travel']/mimic").get("multiplier")) == pytest.approx(0.3 / (2 * np.pi))
    dynamics = robot.find("joint[@name='swing']/dynamics")
    assert [float(dynamics.get(key)) for key in ("damping", "friction")] == [pytest.approx(0.3), 0.5]
    limit = robot.find("joint[@name='swing']/limit")
    assert [float(limit.get(key)) for key in ("velocity", "effort")] == [3.0, 1e6]


GEARED = """
mechanism: geared
parts:
  a: {mass: 1, inertia: [1, 1, 1]}
  b: {mass: 1, inertia: [1, 1, 1]}
  c: {mass: 1, inertia: [1, 1, 1]}
joints:
  first: {type: revolute, between: [ground, a], axis: [0, 0, 1], stiffness: 3}
  second: {type: revolute, between: [ground, b], axis: [0, 0, 1]}
  third: {type: prismatic, between: [ground, c], axis: [0, 0, 1]}
constraints:
  mesh: {type: gear, joints: [first, second], radii: [1, 2]}
  drum: {type: coupling, terms: {first: 0.5, third: -1}, value: -0.25}
forces:
  rope: {type: spring, between: [a, c], stiffness: 1}
"""


def test_gears_and_couplings_become_mimics_and_what_is_left_out_is_named():
    text = to_urdf(parse_mechanism(GEARED))
    again = parse_mechanism(text)
    factors = [constraint.factors for constraint in again.constraints]
    assert factors == [{"second": 1.0, "first": 0.5}, {"third": 1.0, "first": -0.5}]
    assert again.constraints[1].value.at(0.0) == 0.25
    assert "<!-- not in this file: springs, dampers and forces: rope -->" in text
    loop = to_urdf(load_mechanism("four_bar"))
    assert "<!-- not in this file: joints that close loops: rocker_pin; positions and velocities at the start: " in loop


STARTED = """
mechanism: started
parts: PARTS
joints:
  hinge: {type: revolute, between: [ground, a], axis: [0, 1, 0], position: 30 deg}
  slide: {type: prismatic, between: [a, b], axis: [0, 0, 1], velocity: 1}
  still: {type: revolute, between: [b, c], axis: [0, 1, 0]}
  driven: {type: revolute, between: [c, d], axis: [0, 1, 0], drive: 1 + t}
  ball: {type: spherical, between: [d, e], orientation: {axis: [1, 0, 0], angle: 0.1}}
  rest: {type: spherical, between: [e, f]}
  flight: {type: free, between: [ground, g], position: [0, 0, 1]}
""".replace("PARTS", str({name: {"mass": 1, "inertia": [1, 1, 1]} for name in "abcdefg"}))


def test_start_values_are_listed_as_left_out():
    assert "positions and velocities at the start: hinge, slide, ball, flight" in left_out(parse_mechanism(STARTED))


UNLISTED = """
mechanism: unlisted
gravity: [1, 0, -9]
parts: {arm: {shape: {type: rod, to: [0, 0, -1], mass: 1}}, ball: {shape: {type: sphere, radius: 0.1, mass: 1}}}
joints:
  hinge: {type: revolute, between: [ground, arm], axis: [0, 1, 0], friction: {coulomb: 1, static: 2, stribeck_velocity: 0.1}}
  slide: {type: prismatic, between: [arm, ball], axis: [0, 0, 1], friction: {coulomb: 1}}
actuators: {push: {type: effort, joint: slide, rotor_inertia: 1e-4, lead: 10 mm}}
contacts: {floor: {parts: [ball], plane: ground, stiffness: 1e4}}
"""
LISTED = (
    "gravity: [1.0, 0.0, -9.0]", "friction other than Coulomb's: hinge", "actuators: push", "contacts, of which only the shapes are here: floor"
)  # fmt: skip


@pytest.mark.parametrize("command", [["urdf"], ["convert", "--to", "urdf"]])
def test_what_changes_the_accelerations_is_listed_in_the_file_and_printed(tmp_path, capsys, command):
    file = tmp_path / "unlisted.yaml"
    file.write_text(UNLISTED.replace("type: sphere, radius: 0.1", "type: sphere, at: [0, 0, 0.5], radius: 0.1"))
    assert main([*command, str(file)]) == 0
    printed = capsys.readouterr()
    assert printed.err == "".join(f"note: not in this file: {sentence}\n" for sentence in LISTED)
    assert f"<!-- not in this file: {'; '.join(LISTED)} -->" in printed.out


def test_the_command_prints_it(capsys):
    assert main(["urdf", "double_rod"]) == 0
    assert parse_mechanism(capsys.readouterr().out).coordinate_names == ("shoulder", "elbow")


def test_meshes_are_written_and_the_shapes_beside_them_collide():
    text = """
mechanism: meshed
parts:
  a:
    mass: 1
    shape: {type: sphere, radius: 0.1, color: "#ff0000"}
    meshes: [{file: "package://x/y.dae", scale: [1, 1, 2], at: [0, 0, 1], rotate: {rpy: [0, 0, 1]}, color: "#00ff00"}]
joints: {j: {type: fixed, between: [ground, a]}}
"""
    written = to_urdf(parse_mechanism(text))
    link = ElementTree.fromstring(written).find("link[@name='a']")
    assert link.find("visual/geometry/mesh").attrib == {"filename": "package://x/y.dae", "scale": "1.0 1.0 2.0"}
    assert link.find("collision/geometry/sphere").get("radius") == "0.1" and len(link.findall("visual")) == 1
    part = parse_mechanism(written).parts["a"]
    assert part.meshes[0].color == "#00ff00" and [shape.kind for shape in part.shapes] == ["sphere"]
    assert part.mass == 1.0 and part.inertia[0, 0] == pytest.approx(0.004)


def test_floating_joints_are_those_that_joint_states_cannot_move():
    free = parse_mechanism(
        "mechanism: m\nparts: {b: {mass: 1, inertia: [1, 1, 1], points: {c: {at: [0, 0, 1], rotate: {axis: [0, 0, 1], angle: 1}}}}, a: {mass: 1}}\n"
        "joints:\n  base: {type: free, between: [ground, b.c]}\n"
        "  ball: {type: revolute, between: [b, a], axis: [0, 0, 1]}\n"
    )
    (base,) = floating_joints(free)
    assert (base.parent, base.child, base.part) == ("ground", "base_frame", "b")
    assert base.pose.position.tolist() == [0.0, 0.0, 1.0]
    assert floating_joints(load_mechanism("double_rod")) == []
