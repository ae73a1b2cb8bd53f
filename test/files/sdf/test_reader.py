"""SDF as a mechanism: closed forms, couplings, poses, problems with their lines, and the list of what was left out."""

import math

import numpy as np
import pytest

from mbd_sim import Kinematics
from mbd_sim.base.errors import MechanismError
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.files.text.yaml_text import mechanism_text
from test.files.sdf.models import PENDULUM, ROBOT
from test.generators.mechanisms import accelerations, derived

MASS = "<inertial><mass>1</mass><inertia><ixx>0.1</ixx><iyy>0.1</iyy><izz>0.1</izz></inertia></inertial>"


def model(content, attributes=""):
    return f'<sdf version="1.9"><model name="m"{attributes}>\n{content}\n</model></sdf>'


def link(name, inner=""):
    return f'<link name="{name}">{inner}{MASS}</link>'


def joint(name, kind, parent, child, rest="<axis><xyz>0 0 1</xyz></axis>"):
    return f'<joint name="{name}" type="{kind}"><parent>{parent}</parent><child>{child}</child>{rest}</joint>'


def test_a_pendulum_with_spring_and_damper():
    """(I + m l²) q'' = -m g l sin q - k (q - q₀) - d q', with the rod hanging at q = 0."""
    q, u = 0.7, -1.3
    found = accelerations(derived(PENDULUM), np.array([q]), np.array([u]))
    exact = (-2 * 9.81 * 0.5 * math.sin(q) - 3 * (q - 0.4) - 0.5 * u) / (0.3 + 2 * 0.25)
    assert found[0] == pytest.approx(exact, rel=1e-14)


def test_a_screw_falls_with_its_lead():
    """(I + m p²) q'' = -m g p with p = lead / 2π; the older key has the opposite sign and is in rad/m."""
    for pitch in ("<screw_thread_pitch>0.5</screw_thread_pitch>", f"<thread_pitch>{-4 * math.pi!r}</thread_pitch>"):
        screw = joint("s", "screw", "world", "a", f"<axis><xyz>0 0 1</xyz></axis>{pitch}")
        equations = derived(model(link("a") + screw))
        p = 0.5 / (2 * math.pi)
        found = accelerations(equations, np.zeros(1), np.zeros(1))[0]
        assert found == pytest.approx(-9.81 * p / (0.1 + p * p), rel=1e-14)


def test_a_gearbox_couples_two_rotations():
    """θ₂ = -ratio θ₁, so that (I₂ ratio² + I₁) θ₁'' is the torque on the first wheel; one joint is declared backward."""
    parts = link("case") + link("first") + link("second")
    joints = joint("f", "revolute", "world", "case", "<axis><xyz>0 1 0</xyz></axis>")
    joints += joint("a", "revolute", "case", "first") + joint("b", "revolute", "second", "case")
    gear = "<gearbox_ratio>3</gearbox_ratio><gearbox_reference_body>case</gearbox_reference_body>"
    axes = "<axis><xyz>0 0 1</xyz></axis><axis2><xyz>0 0 -1</xyz></axis2>"
    mechanism = parse_mechanism(model(parts + joints + joint("g", "gearbox", "first", "second", axes + gear)))
    (coupling,) = mechanism.constraints
    assert dict(coupling.factors) == {"a": 3.0, "b": 1.0}  # b turns the case about z relative to the second wheel


def test_up_to_version_1_4_the_axes_of_gearboxes_are_in_the_models_axes():
    """The links are turned, and the axes are parallel only in the model's axes."""
    links = link("case") + link("first", "<pose>0 0 1 1.2 0 0</pose>") + link("second", "<pose>0 1 1 0 0.3 0</pose>")
    axis = "<axis><xyz>0 0 1</xyz></axis>"
    joints = joint("f", "revolute", "world", "case", "<axis><xyz>0 1 0</xyz></axis>")
    joints += joint("a", "revolute", "case", "first", axis) + joint("b", "revolute", "case", "second", axis)
    gear = "<gearbox_ratio>2</gearbox_ratio><gearbox_reference_body>case</gearbox_reference_body>"
    axes = f"{axis}<axis2><xyz>0 0 1</xyz></axis2>"
    text = model(links + joints + joint("g", "gearbox", "first", "second", axes + gear))
    (coupling,) = parse_mechanism(text.replace('version="1.9"', 'version="1.4"')).constraints
    assert dict(coupling.factors) == {"a": 2.0, "b": 1.0}
    with pytest.raises(MechanismError, match="no revolute joint about <axis> connects"):
        parse_mechanism(text)


def test_a_mimic_is_a_coupling():
    mimic = '<axis><xyz>0 0 1</xyz><mimic joint="a" axis="axis"><multiplier>2</multiplier><offset>0.3</offset>'
    mimic += "<reference>0.1</reference></mimic></axis>"
    text = model(link("x") + link("y") + joint("a", "revolute", "world", "x") + joint("b", "revolute", "x", "y", mimic))
    (coupling,) = parse_mechanism(text).constraints
    assert dict(coupling.factors) == {"b": 1.0, "a": -2.0}
    assert coupling.value.at(0.0) == pytest.approx(0.1)


def test_loops_are_closed():
    text = model(
        link("x") + link("y") + joint("a", "revolute", "world", "x") + joint("b", "revolute", "x", "y")
        + joint("c", "prismatic", "world", "y", "<axis><xyz>1 0 0</xyz></axis>")
    )  # fmt: skip
    assert len(parse_mechanism(text).closing) == 1


def test_models_are_free_static_or_fixed():
    text = model(link("x", "<pose>1 2 3 0 0 0.5</pose>"))
    free = parse_mechanism(text).joints["base"]
    assert free.type == "free"
    assert free.position[:3].tolist() == [1.0, 2.0, 3.0]
    fixed = parse_mechanism(text, base="fixed")
    assert fixed.joints["base"].type == "fixed"
    static = parse_mechanism(text.replace("<link", "<static>true</static><link"))
    for mechanism in (fixed, static):
        np.testing.assert_allclose(Kinematics(mechanism).poses()["x"].position, [1, 2, 3], atol=1e-15)


def test_names_of_nested_models_and_points():
    mechanism = parse_mechanism(ROBOT)
    assert [*mechanism.parts] == [
        "robot::foot",
        "robot::arm",
        "robot::slider",
        "robot::hand::palm",
        "robot::hand::finger",
        "post::body",
    ]
    assert mechanism.ground_points["table"].position.tolist() == [1.0, 2.0, 0.5]
    assert "mount" in mechanism.parts["robot::foot"].points
    assert parse_mechanism(mechanism_text(mechanism.source)).source.data == mechanism.source.data


def test_models_are_included(tmp_path):
    (tmp_path / "arm").mkdir()
    (tmp_path / "arm" / "model.sdf").write_text(
        model(link("x") + link("y", "<pose>0 0 1 0 0 0</pose>") + joint("j", "revolute", "x", "y"))
    )
    main = tmp_path / "main.sdf"
    include = "<include><uri>model://arm</uri><name>{0}</name><pose>{1} 0 0 0 0 0</pose></include>"
    main.write_text(
        f'<sdf version="1.9"><world name="w">{include.format("one", 1)}{include.format("two", 2)}</world></sdf>'
    )
    mechanism = load_mechanism(main)
    assert [*mechanism.parts] == ["one::x", "one::y", "two::x", "two::y"]
    assert Kinematics(mechanism).poses()["two::y"].position.tolist() == [2.0, 0.0, 1.0]
    main.write_text('<sdf version="1.9"><world name="w">\n<include><uri>model://leg</uri></include></world></sdf>')
    with pytest.raises(MechanismError, match=r"main\.sdf:2: include\.uri: there is no such model"):
        load_mechanism(main)


def test_a_placement_frame_is_what_the_pose_places():
    text = model(link("x", "<pose>0 0 1 0 0 0</pose>") + "<pose>5 0 0 0 0 0</pose>", ' placement_frame="x"')
    assert Kinematics(parse_mechanism(text)).poses()["x"].position.tolist() == [5.0, 0.0, 0.0]


def test_what_is_left_out_is_listed_with_its_line():
    notes = parse_mechanism(
        model(
            '<link name="x"><sensor name="s"/>\n<collision name="c"/><visual name="v"><transparency>1</transparency></visual></link>\n<plugin name="p" filename="f"/>'
        )
    ).source.notes
    assert "links without <inertial>, which have 1 kg and 1 kg·m² in SDF: link[x] (line 2)" in notes
    assert "untyped sensors, which are not read: link[x] (line 2)" in notes
    assert "<collision> without a shape: link[x] (line 3)" in notes
    assert "<transparency> of <visual>: link[x].visual[v] (line 3)" in notes
    assert "<plugin>: plugin[p] (line 4)" in notes


def test_unread_attributes_and_elements_are_listed_at_any_depth():
    inside = """<inertial><mass>2</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia>
<fluid_added_mass/></inertial><inertial/>
<visual name="v"><pose relative_to="x">0 0 0 0 0 0</pose><geometry><mesh><uri>a.stl</uri><submesh/></mesh></geometry></visual>
<collision name="c"><geometry><sphere><radius>1</radius></sphere></geometry><surface><contact/></surface></collision>"""
    hinge = """<joint name="j" type="revolute" reversed="1"><parent>world</parent><child>x</child>
<axis><xyz expressed_in="x" scale="2">0 0 1</xyz><limit><lower>0</lower><upper>1</upper><stiffness>9</stiffness></limit></axis></joint>"""
    notes = parse_mechanism(
        f'<sdf version="1.9"><model name="m" color="red"><link name="x" layer="2">{inside}</link>{hinge}</model></sdf>'
    ).source.notes
    for note in (
        "color of <model>: model[m] (line 1)",
        "layer of <link>: link[x] (line 1)",
        "<fluid_added_mass> of <inertial>: link[x].inertial (line 2)",
        "<inertial> that is not the first of <link>: link[x] (line 2)",
        "relative_to of <pose>: link[x].visual[v].pose (line 3)",
        "<submesh> of <mesh>: link[x].visual[v].geometry.mesh (line 3)",
        "<contact> of <surface>: link[x].collision[c].surface (line 4)",
        "reversed of <joint>: joint[j] (line 4)",
        "scale of <xyz>: joint[j].axis.xyz (line 5)",
        "<stiffness> of <limit>: joint[j].axis.limit (line 5)",
    ):
        assert note in notes


X = link("x")
MISTAKES = {
    model(X + "\n" + joint("j", "hinge", "world", "x")): r":3: joint\[j\]\.type: unknown type 'hinge'",
    model(X + "\n" + joint("j", "revolute", "world", "y")): r":3: joint\[j\]\.child: there is no frame 'y'.*x",
    model(X + "\n<joint name='j' type='ball'><child>x</child></joint>"): r":3: joint\[j\]\.parent: <parent> is missing",
    model(X + "\n" + link("x")): r":3: link\[x\]: has the name of another frame, on line 2",
    model('<link name="a"><pose>0 0 0</pose></link>'): r":2: link\[a\]\.pose: has 3 numbers.*6",
    model('<frame name="a" attached_to="b"/>\n<frame name="b" attached_to="a"/>' + X): r"itself, through other frames",
    model(
        '<link name="a"><pose relative_to="q">0 0 0 0 0 0</pose></link>'
    ): r":2: link\[a\]\.pose\.relative_to: there is no",
    model(
        '<link name="a"><inertial auto="true"/></link>'
    ): r":2: link\[a\]\.inertial\.auto: .* Give <mass> and <inertia>",
    model(X + joint("j", "revolute", "world", "x", "<axis><xyz>0 0 0</xyz></axis>")): r"must not be zero",
    model(X + joint("j", "revolute", "world", "world")): r"connects a link with itself",
    model(""): r"has no <link>",
    '<sdf version="1.9"><world name="a"/><world name="b"/></sdf>': r"has several worlds",
}


@pytest.mark.parametrize("text", MISTAKES, ids=range(len(MISTAKES)))
def test_mistakes_are_reported_with_line_and_remedy(text):
    with pytest.raises(MechanismError, match=MISTAKES[text]):
        parse_mechanism(text)
