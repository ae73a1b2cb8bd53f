"""A floor in one word: which shapes touch it, and where the base of a robot starts."""

import numpy as np
import pytest

from mbd_sim import Simulation, load_mechanism
from mbd_sim.base.errors import MechanismError
from mbd_sim.files.load import parse_mechanism
from mbd_sim.files.on_floor import on_floor
from mbd_sim.files.text.yaml_text import mechanism_text

LEGS = {"front": (0.2, 0.1), "back": (-0.2, 0.1), "right": (0.0, -0.1)}
FEET = [f"{name}_foot" for name in LEGS]
URDF = """<robot name="tripod">
<link name="body">
  <inertial><mass value="2"/><inertia ixx="0.1" iyy="0.1" izz="0.1"/></inertial>
  <visual><geometry><box size="9 9 9"/></geometry></visual>
  <collision name="trunk"><geometry><sphere radius="0.1"/></geometry></collision>
</link>
{legs}
</robot>"""
LEG = """<link name="{name}_leg">
  <inertial><origin xyz="0 0 -0.1"/><mass value="0.2"/><inertia ixx="0.01" iyy="0.01" izz="0.01"/></inertial>
  <visual><geometry><mesh filename="leg.stl"/></geometry></visual>
</link>
<link name="{name}_foot"><collision><geometry>{foot}</geometry></collision></link>
<joint name="{name}_hip" type="revolute">
  <origin xyz="{x} {y} 0"/><parent link="body"/><child link="{name}_leg"/><axis xyz="0 1 0"/>
  <limit lower="-0.5" upper="0.5" effort="10" velocity="5"/>
</joint>
<joint name="{name}_ankle" type="fixed">
  <origin xyz="0 0 -0.3"/><parent link="{name}_leg"/><child link="{name}_foot"/>
</joint>"""


def robot(foot='<sphere radius="0.03"/>', legs=LEGS):
    return URDF.format(legs="\n".join(LEG.format(name=name, x=x, y=y, foot=foot) for name, (x, y) in legs.items()))


def test_what_is_only_drawn_touches_nothing():
    mechanism = parse_mechanism(robot(), base="free")
    assert [shape.size for shape in mechanism.parts["body"].touching] == [(0.1,)]
    assert not mechanism.parts["front_leg"].touching
    assert [shape.size for shape in mechanism.parts["front_foot"].touching] == [(0.03,)]


def test_shapes_without_collisions_stay_drawn_only():
    text = robot().replace("<collision", "<visual").replace("</collision", "</visual")
    with pytest.raises(MechanismError, match="no part with a shape can touch"):
        on_floor(parse_mechanism(text, base="free"))


@pytest.mark.parametrize(("foot", "below"), [('<sphere radius="0.03"/>', 0.03), ('<box size="0.1 0.1 0.04"/>', 0.02)])
def test_the_lowest_point_is_on_the_floor(foot, below):
    """Finds a floor that takes the shapes that are drawn, and a base that starts above the floor or in it."""
    mechanism = on_floor(parse_mechanism(robot(foot), base="free"))
    assert mechanism.joints["base"].position[:3] == pytest.approx([0, 0, 0.3 + below], abs=1e-15)
    assert {contact.first.at.part for contact in mechanism.contacts} == {"body", *FEET}


def test_turned_bases_and_changed_positions_stand_too():
    """The base is lifted along z of ground, after the values of the file were changed."""
    changes = {
        "joints.base.orientation": {"axis": [1, 2, 0], "angle": "35 deg"},
        "joints.front_hip.position": 0.4,
        "contacts.floor.friction": 0.3,
    }
    mechanism = on_floor(parse_mechanism(robot(legs={"front": (0.2, 0.1)}), base="free"), changes)
    gaps = [reading.gap for reading in Simulation(mechanism, method="tsitouras8").contacts().values()]
    assert min(gaps) == pytest.approx(0.0, abs=1e-15)
    assert mechanism.contacts[0].law.friction == 0.3


PLANAR = """mechanism: planar
parts:
  slide: {}
  body: {shape: {type: block, size: [0.2, 0.1, 0.4], mass: 2}}
"""
WAYS_UP = {
    "slides": (
        "{rail: {type: prismatic, between: [ground.wall, slide], axis: [1, 0, 0], position: 0.3}, "
        "lift: {type: prismatic, between: [slide, body], axis: [0, -1, 0], position: 0.5}}",
        "lift",
        -0.05,
    ),
    "planar": (
        "{lift: {type: planar, between: [ground.wall, body], axis: [0, 0, 1], x_axis: [0.6, 0.8, 0], position: [1, 2, 0]}}",
        "lift",
        [1 - 0.8 * 1.95, 2 - 0.6 * 1.95, 0],
    ),
}


@pytest.mark.parametrize(("joints", "base", "expected"), WAYS_UP.values(), ids=WAYS_UP)
def test_planar_bases_are_put_on_the_floor(joints, base, expected):
    """Finds bases without a free joint that stay in the floor or above it, and axes that are taken for those of ground."""
    text = PLANAR.replace("slide: {}", "slide: {mass: 1}" if "slide" in joints else "rest: {mass: 1}")
    turned = "{rotate: {axis: [1, 0, 0], angle: 90 deg}}"
    joints = (
        joints if "slide" in joints else joints.replace("{lift", "{rest: {type: fixed, between: [ground, rest]}, lift")
    )
    mechanism = on_floor(parse_mechanism(f"{text}joints: {joints}\nground: {{points: {{wall: {turned}}}}}\n"))
    gaps = [reading.gap for reading in Simulation(mechanism, method="tsitouras8").contacts().values()]
    assert min(gaps) == pytest.approx(0.0, abs=1e-15)
    assert np.atleast_1d(mechanism.joints[base].position) == pytest.approx(np.atleast_1d(expected), abs=1e-15)


@pytest.mark.parametrize("holds", ["stiffness: 5", "limits: {lower: 0, upper: 1}"])
def test_slides_that_are_held_or_moved_stay_where_they_are(holds):
    """Finds lifting axes of machines that are taken for bases."""
    text = PLANAR.replace("  slide: {}\n", "")
    joints = f"{{lift: {{type: prismatic, between: [ground, body], axis: [0, 0, 1], position: 0.7, {holds}}}}}"
    assert on_floor(parse_mechanism(f"{text}joints: {joints}\n")).joints["lift"].position == 0.7


def test_a_converted_file_stands_as_well():
    mechanism = on_floor(parse_mechanism(robot(), base="free"))
    again = parse_mechanism(mechanism_text(mechanism.source))
    assert again.joints["base"].position.tolist() == mechanism.joints["base"].position.tolist()
    assert [contact.quantity for contact in again.contacts] == [contact.quantity for contact in mechanism.contacts]


def test_what_is_welded_to_ground_touches_no_floor():
    mechanism = on_floor(parse_mechanism(robot()))
    assert {contact.first.at.part for contact in mechanism.contacts} == set(FEET)


def test_a_floor_of_the_file_stays_and_bases_are_not_lowered_to_it():
    text = mechanism_text(parse_mechanism(robot(), base="free").source)
    text += (
        "contacts:\n  table: {parts: [front_foot, right_foot], plane: ground.top}\nground: {points: {top: [0, 0, H]}}\n"
    )
    high, low = (on_floor(parse_mechanism(text.replace("H", height))) for height in ("0.5", "-2"))
    assert high.joints["base"].position[2] == pytest.approx(0.83) and low.joints["base"].position[2] == 0.0
    assert {contact.name for contact in high.contacts} == {"table"}


def test_of_many_bodies_only_the_ends_touch_and_a_remark_says_so(monkeypatch):
    monkeypatch.setattr("mbd_sim.files.on_floor.MOST", 3)
    mechanism = on_floor(parse_mechanism(robot(), base="free"))
    assert {contact.first.at.part for contact in mechanism.contacts} == set(FEET)
    assert any("only front_foot, back_foot, right_foot" in remark for remark in mechanism.source.remarks)
    assert mechanism.source.data["contacts"]["floor"]["without"] == ["body"]


def test_limits_become_stops_in_one_word(tmp_path):
    (tmp_path / "r.urdf").write_text(robot())
    mechanism = load_mechanism(tmp_path / "r.urdf", limits="stops")
    assert all(mechanism.joints[f"{name}_hip"].limits[0].restitution == 0.0 for name in LEGS)
    simulation = Simulation(mechanism)
    simulation.set_efforts({"front_hip": 5.0})
    simulation.step(500)
    assert simulation.q[0] == pytest.approx(0.5, abs=1e-12)


def test_limits_with_a_law_of_their_own_keep_it():
    text = mechanism_text(parse_mechanism(robot()).source) + "limits: stops\n"
    plain = parse_mechanism(text)
    assert [limits.restitution for joint in plain.joints.values() for limits in joint.limits] == [0.0, 0.0, 0.0]
    elastic = parse_mechanism(text.replace("upper: 0.5", "upper: 0.5, stiffness: 100", 1))
    assert sorted(str(limits.restitution) for joint in elastic.joints.values() for limits in joint.limits) == [
        "0.0",
        "0.0",
        "None",
    ]


def test_a_robot_lands_and_stands():
    """A robot with springs in its hips comes to rest on its three feet, which carry its weight."""
    springs = {
        f"joints.{name}_hip.{key}": value for name in LEGS for key, value in (("stiffness", 200), ("damping", 5))
    }
    mechanism = on_floor(parse_mechanism(robot(), base="free"), springs)
    simulation = Simulation(mechanism, method="tsitouras8")
    simulation.run(until=2.0)
    weight = 9.81 * sum(part.mass for part in mechanism.parts.values())
    force = sum(reading.force for reading in simulation.contacts().values())
    assert force == pytest.approx([0.0, 0.0, weight], abs=1e-6)
    assert np.max(np.abs(simulation.u)) < 1e-6


def test_a_robot_with_a_fixed_base_in_its_floor_is_told_to_free_it(tmp_path):
    """It was told to use --floor, which had been given."""
    (tmp_path / "tripod.urdf").write_text(robot())
    with pytest.raises(MechanismError, match="Its base is fixed: --base free"):
        Simulation(load_mechanism(tmp_path / "tripod.urdf", floor=True))
