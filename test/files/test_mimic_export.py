"""Who mimics whom in exports: as in the file, and for gears and couplings so that every equation holds."""

import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from mbd_sim.base.errors import MechanismError
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.files.mjcf.writer import to_mjcf
from mbd_sim.files.sdf.writer import to_sdf
from mbd_sim.files.text.yaml_text import mechanism_text, yaml_text
from mbd_sim.files.urdf.motions import mimics_of
from mbd_sim.files.urdf.writer import ControlTopics, left_out, to_urdf

TOPICS = ControlTopics("/c", "/s")
INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'


def link(name):
    return f'<link name="{name}">{INERTIAL}</link>'


def hand(rng, count):
    """A robot whose joints mimic others at random, in chains too; and leader, multiplier and offset by follower."""
    mimics, text = {}, link("palm")
    order = [f"j{i}" for i in rng.permutation(count)]  # in which they lead: not that of the file
    for place, name in enumerate(order[1:], start=1):
        if rng.random() < 0.7:
            mimics[name] = (order[rng.integers(place)], round(rng.uniform(-3, 3), 3) or 1.0, round(rng.normal(), 3))
    for i in range(count):
        name, kind = f"j{i}", rng.choice(["revolute", "prismatic", "continuous"])
        parent = f"l{rng.integers(i)}" if i and rng.random() < 0.5 else "palm"
        law = ""
        if name in mimics:
            leader, multiplier, offset = mimics[name]
            law = f'<mimic joint="{leader}" multiplier="{multiplier}" offset="{offset}"/>'
        limit = '<limit lower="-9" upper="9" effort="1" velocity="1"/>'
        ends = f'<parent link="{parent}"/><child link="l{i}"/><axis xyz="0 0 1"/>'
        text += link(f"l{i}") + f'<joint name="{name}" type="{kind}">{ends}{limit}{law}</joint>'
    return f'<robot name="hand">{text}</robot>', mimics


def written_mimics(robot):
    found = {}
    for joint in robot.findall("joint[mimic]"):
        mimic = joint.find("mimic")
        found[joint.get("name")] = mimic.get("joint"), float(mimic.get("multiplier")), float(mimic.get("offset"))
    return found


@pytest.mark.parametrize("seed", range(2))
def test_mimics_are_exported_as_in_the_file(seed):
    rng = np.random.default_rng(seed)
    text, expected = hand(rng, int(rng.integers(2, 9)))
    mechanism = parse_mechanism(text)
    robot = ElementTree.fromstring(to_urdf(mechanism, TOPICS))
    assert written_mimics(robot) == expected
    assert not any("constraints" in kind for kind in left_out(mechanism))
    commanded = {joint.get("name") for joint in robot.findall("ros2_control/joint[command_interface]")}
    assert commanded == set(mechanism.coordinate_names) - expected.keys()
    for exported in (to_urdf(mechanism), to_sdf(mechanism).text):
        again = mimics_of(parse_mechanism(exported))
        assert {name: (one.joint, one.multiplier, one.offset) for name, one in again.items()} == expected
    equalities = ElementTree.fromstring(to_mjcf(mechanism).text).findall("equality/joint")
    assert {one.get("joint1"): one.get("joint2") for one in equalities} == {
        follower: leader for follower, (leader, _, _) in expected.items()
    }


def train(rng, count):
    """Hinges of which gears, racks and couplings connect some, listed in any order; and their actuators."""
    joints = [f"  j{i}: {{type: revolute, between: [ground, p{i}], axis: [0, 0, 1]}}" for i in range(count)]
    parts = [f"  p{i}: {{mass: 1, inertia: [1, 1, 1]}}" for i in range(count)]
    edges, constraints = [], []
    for i in range(1, count):
        if rng.random() < 0.8:
            edges.append(tuple(f"j{k}" for k in rng.permutation([i, rng.integers(i)])))
    for number, place in enumerate(rng.permutation(len(edges))):
        a, b = edges[place]
        if rng.random() < 0.5:
            law = f"{{type: gear, joints: [{a}, {b}], radii: [{rng.uniform(1, 3)}, {rng.uniform(1, 3)}]}}"
        else:
            terms = f"{{{a}: {rng.uniform(0.3, 3)}, {b}: {rng.uniform(-3, -0.3)}}}"
            law = f"{{type: coupling, terms: {terms}, value: {rng.normal()}}}"
        constraints.append(f"  c{number}: {law}")
    motors = [i for i in range(count) if rng.random() < 0.2]
    actuators = [f"  m{i}: {{type: effort, joint: j{i}}}" for i in motors]
    sections = {"parts": parts, "joints": joints, "constraints": constraints, "actuators": actuators}
    text = "mechanism: train\n" + "".join(
        f"{name}:\n" + "\n".join(rows) + "\n" for name, rows in sections.items() if rows
    )
    return text, [f"j{i}" for i in motors]


@pytest.mark.parametrize("seed", range(12))
def test_every_equation_holds_where_all_followers_mimic_their_leaders(seed):
    rng = np.random.default_rng(seed)
    text, actuated = train(rng, int(rng.integers(2, 9)))
    mechanism = parse_mechanism(text)
    mimics = written_mimics(ElementTree.fromstring(to_urdf(mechanism)))
    assert len(mimics) == len(mechanism.constraints)
    leaders = set(mechanism.coordinate_names) - mimics.keys()
    values = {name: rng.normal() for name in leaders}
    for follower, (leader, multiplier, offset) in mimics.items():
        assert leader in leaders  # many readers do not follow chains
        values[follower] = multiplier * values[leader] + offset
        assert leader in actuated or follower not in actuated
    for constraint in mechanism.constraints:
        left = sum(factor * values[name] for name, factor in constraint.factors.items())
        assert left == pytest.approx(constraint.value.at(0.0), abs=1e-11)


PLAY = """
mechanism: play
parts: {a: {mass: 1, inertia: [1, 1, 1]}, b: {mass: 1, inertia: [1, 1, 1]}}
joints:
  x: {type: revolute, between: [ground, a], axis: [0, 0, 1]}
  y: {type: revolute, between: [ground, b], axis: [0, 0, 1]}
constraints: {c: {type: coupling, terms: {x: 1, y: -1}, LAW}}
"""


@pytest.mark.parametrize("law", ["backlash: 0.1", "bound: at_least", "value: t"])
def test_a_relation_that_is_no_equation_of_two_coordinates_is_listed(law):
    mechanism = parse_mechanism(PLAY.replace("LAW", law))
    assert not mimics_of(mechanism)
    assert "constraints: c" in left_out(mechanism)
    assert any("constraints: c" in note for note in to_sdf(mechanism).left_out)


def test_two_followers_that_mimic_each_other_are_exported_without_a_circle():
    text, _ = hand(np.random.default_rng(0), 2)
    text = re.sub("<mimic[^>]*/>", "", text)
    for name, other in (("j0", "j1"), ("j1", "j0")):
        text = re.sub(rf'(<joint name="{name}".*?)</joint>', rf'\1<mimic joint="{other}"/></joint>', text)
    assert written_mimics(ElementTree.fromstring(to_urdf(parse_mechanism(text)))) == {"j0": ("j1", 1.0, 0.0)}


CONTROLLED = """
  <ros2_control name="hand" type="system">
    <hardware><plugin>a/B</plugin><param name="x">1 &lt; 2 &amp; "3"</param></hardware>
    <joint name="j0"><command_interface name="effort"><param name="min">-1</param></command_interface></joint>
  </ros2_control>
  <ros2_control name="tool" type="sensor"><sensor name="s" x:y="é"/><x:z/></ros2_control>
"""


def plain(element):
    return element.tag, element.attrib, (element.text or "").strip(), [plain(child) for child in element]


def test_blocks_of_ros2_control_stay_and_one_is_added_for_other_joints_only(tmp_path):
    text, _ = hand(np.random.default_rng(3), 2)
    text = re.sub("<mimic[^>]*/>", "", text).replace('name="hand">', 'name="hand" xmlns:x="http://x">', 1)
    (tmp_path / "hand.urdf").write_text(text.replace("</robot>", CONTROLLED + "</robot>"), encoding="utf-8")
    (tmp_path / "more.yaml").write_text("urdf: hand.urdf\ndescription: an extended robot\n", encoding="utf-8")
    expected = [plain(one) for one in ElementTree.fromstring(f"<r xmlns:x='u'>{CONTROLLED}</r>")]
    converted = mechanism_text(load_mechanism(tmp_path / "hand.urdf").source)
    (tmp_path / "converted.yaml").write_text(converted, encoding="utf-8")
    for write in (to_mjcf, to_sdf):
        assert "<ros2_control> blocks: hand, tool" in write(load_mechanism(tmp_path / "hand.urdf")).left_out
    assert '\n  <ros2_control name="hand" type="system">\n    <hardware>\n' in converted
    for file in ("hand.urdf", "more.yaml", "converted.yaml"):
        written = to_urdf(load_mechanism(tmp_path / file), TOPICS).replace("<robot ", "<robot xmlns:x='u' ", 1)
        *kept, added = ElementTree.fromstring(written).findall("ros2_control")
        assert [plain(one) for one in kept] == expected
        assert (added.get("name"), [joint.get("name") for joint in added.findall("joint")]) == ("hand_2", ["j1"])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<ros2_control name='a'>", "not valid XML: mismatched tag"),
        ("<ros2_control/>\n<link/>", "must consist of <ros2_control> elements"),
        ("text", "must consist of <ros2_control> elements"),
        ("<ros2_control/></all><all>", "not valid XML"),
    ],
)
def test_what_is_no_block_of_ros2_control_is_refused(text, message):
    data = {
        "mechanism": "m",
        "parts": {"a": {"mass": 1}},
        "joints": {"j": {"type": "free", "between": ["ground", "a"]}},
    }
    with pytest.raises(MechanismError) as caught:
        parse_mechanism(yaml_text(data | {"ros2_control": text}))
    (problem,) = caught.value.problems
    assert problem.key == "ros2_control" and problem.message.startswith(message)


def test_no_block_is_added_where_those_of_the_urdf_have_all_joints():
    text, _ = hand(np.random.default_rng(3), 1)
    robot = ElementTree.fromstring(
        to_urdf(parse_mechanism(text.replace("</robot>", CONTROLLED.replace("x:", "x_") + "</robot>")), TOPICS)
    )
    assert [block.get("name") for block in robot.findall("ros2_control")] == ["hand", "tool"]


UNIVERSAL = """
mechanism: cross
parts: {a: {mass: 1, inertia: [1, 1, 1]}, b: {mass: 1, inertia: [1, 1, 1]}}
joints:
  u: {type: universal, between: [ground, a], axes: [[1, 0, 0], [0, 1, 0]]}
  y: {type: revolute, between: [ground, b], axis: [0, 0, 1]}
constraints: {c: {type: coupling, terms: {ENDS}, value: 0.1}}
"""


@pytest.mark.parametrize("ends", ["u.second: 1, y: -2", "y: 1, u.second: -2", "u.first: 1, u.second: -2"])
def test_coordinates_of_universal_joints_are_named_in_sdf(ends):
    mechanism = parse_mechanism(UNIVERSAL.replace("ENDS", ends))
    (first,), (again,) = mechanism.constraints, parse_mechanism(to_sdf(mechanism).text).constraints
    scale = first.factors["u.second"] / again.factors["u.second"]
    assert {name: scale * factor for name, factor in again.factors.items()} == pytest.approx(dict(first.factors))
    assert scale * again.value.at(0.0) == pytest.approx(first.value.at(0.0))


@pytest.mark.parametrize("follower", ["", ", follower: slave"])
def test_a_coordinate_mimics_a_drive(follower):
    """In SDF, angles count from the start, where the drive is not at zero."""
    mechanism = parse_mechanism(f"""
mechanism: m
parts: {{a: {{mass: 1, inertia: [1, 1, 1]}}, b: {{mass: 1, inertia: [1, 1, 1]}}}}
joints:
  slave: {{type: revolute, between: [ground, b], axis: [0, 0, 1]}}
  master: {{type: revolute, between: [ground, a], axis: [0, 0, 1], drive: 0.3 + t}}
constraints: {{k: {{type: coupling, terms: {{slave: -1, master: 2}}, value: 0.1{follower}}}}}
""")
    robot = ElementTree.fromstring(to_urdf(mechanism, TOPICS))
    assert written_mimics(robot) == {"slave": ("master", 2.0, -0.1)}
    (coupling,) = parse_mechanism(to_sdf(mechanism).text).constraints
    assert dict(coupling.factors) == {"slave": 1.0, "master": -2.0}
    assert coupling.value.at(0.0) == pytest.approx(0.5, abs=1e-15)
