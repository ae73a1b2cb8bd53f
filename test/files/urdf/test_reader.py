"""URDF in: what each element becomes, and that a robot moves as its URDF says."""

import json
import re

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.errors import MechanismError, NoInertiaError
from mbd_sim.cli.main import main
from mbd_sim.dynamics.equations import derive
from mbd_sim.dynamics.math.expressions import evaluated
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.files.text.yaml_text import mechanism_text, parse_source
from test.generators.mechanisms import accelerations, random_state
from test.generators.urdf_robots import arm, energies, quadruped
from test.oracles import kane

ROBOTS = {"arm": arm(), "quadruped": quadruped()}


def robot(*elements, name="r"):
    return f'<robot name="{name}">\n' + "\n".join(elements) + "\n</robot>"


def link(name, inside=""):
    return (
        f'<link name="{name}"><inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1"/></inertial>{inside}</link>'
    )


def joint(name, kind, inside="", parent="a", child="b"):
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{inside}</joint>'


def pair(kind, inside=""):
    """A mechanism of two links with a joint between them."""
    return parse_mechanism(robot(link("a"), link("b"), joint("j", kind, inside)))


def problems_of(text):
    with pytest.raises(MechanismError) as caught:
        parse_mechanism(text, "r.urdf")
    return [str(problem) for problem in caught.value.problems]


def problem_of(text):
    (problem,) = problems_of(text)
    return problem


@pytest.mark.parametrize(("name", "base"), [*zip(ROBOTS, ("fixed", "free"), strict=True)])
def test_energies_are_those_of_the_urdf(name, base):
    mechanism, rng = parse_mechanism(ROBOTS[name], base=base), np.random.default_rng(1)
    equations = derive(mechanism)
    for _ in range(5):
        q, u, _ = random_state(mechanism, rng)
        flying, names = None, mechanism.coordinate_names
        positions = q
        if base == "free":
            flying, positions, names = (q[:3], q[3:7], u[:3], u[3:6]), q[7:], names[6:]
        where = dict(zip(names, positions, strict=True))
        speeds = dict(zip(names, u[len(u) - len(names) :], strict=True))
        found = [
            value.item() for value in map(np.array, equations.energies(0.0, np.concatenate([q, u, np.zeros(3)])).nz)
        ]
        assert found == pytest.approx(energies(ROBOTS[name], where, speeds, flying), rel=1e-12)


@pytest.mark.parametrize(("name", "base"), [*zip(ROBOTS, ("fixed", "free"), strict=True)])
def test_accelerations_are_those_of_kane(name, base):
    mechanism, rng = parse_mechanism(ROBOTS[name], base=base), np.random.default_rng(2)
    equations = derive(mechanism)
    for _ in range(3):
        q, u, efforts = random_state(mechanism, rng)
        exact = kane.equations(mechanism, q, u, efforts, 0.0).accelerations
        assert accelerations(equations, q, u, efforts) == pytest.approx(
            exact, rel=1e-9, abs=1e-9 * np.max(np.abs(exact))
        )


@pytest.mark.parametrize(("name", "base"), [*zip(ROBOTS, ("fixed", "free"), strict=True)])
def test_accelerations_are_those_of_pinocchio(name, base):
    pin = pytest.importorskip("pinocchio", reason="needs the extra 'robots': pip install pin")
    from test.oracles.urdf_oracle import Oracle

    mechanism, rng = parse_mechanism(ROBOTS[name], base=base), np.random.default_rng(3)
    equations, oracle = derive(mechanism), Oracle(pin, ROBOTS[name], mechanism, base == "free")
    for _ in range(5):
        state = random_state(mechanism, rng)
        exact = oracle.accelerations(*state)
        assert accelerations(equations, *state) == pytest.approx(exact, rel=1e-9, abs=1e-9 * np.max(np.abs(exact)))


@pytest.mark.parametrize(("name", "base"), [*zip(ROBOTS, ("fixed", "free"), strict=True)])
def test_its_text_alone_makes_the_same_mechanism(name, base):
    mechanism = parse_mechanism(ROBOTS[name], base=base)
    text = mechanism_text(mechanism.source)
    assert "urdf" not in parse_source(text).data and parse_source(text).data == mechanism.source.data
    again = parse_mechanism(text)
    assert mechanism_text(again.source) == text
    first, second = map(derive, (mechanism, again))
    y = first.start_state + np.random.default_rng(0).normal(size=first.start_state.size)
    inputs = first.inputs_without_commands
    assert first.start_state.tobytes() == second.start_state.tobytes()
    assert evaluated(first.rates, 0.0, y, inputs).tobytes() == evaluated(second.rates, 0.0, y, inputs).tobytes()


def test_a_file_is_loaded_by_its_name(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(arm())
    mechanism = load_mechanism(path)
    assert mechanism.name == "seven_axes"
    assert mechanism.coordinate_names == tuple(f"axis{i}" for i in range(1, 8))


def test_links_without_inertia_are_parts_that_can_be_named():
    mechanism = parse_mechanism(arm())
    assert {"base_link", "flange", "tool0"} <= set(mechanism.parts)
    assert mechanism.parts["tool0"].mass == 0.0
    assert np.allclose(Simulation(mechanism).poses()["pedestal"].position, 0.0)


def test_limits_damping_and_friction():
    joint = parse_mechanism(arm()).joints["axis3"]
    assert (joint.limits[0].lower, joint.limits[0].upper, joint.limits[0].stiffness) == (-2.2, 2.8, None)
    assert (joint.effort_limit, joint.velocity_limit, joint.damping[0]) == (70.0, 2.5, 0.3)
    assert joint.friction.coulomb == 0.02
    continuous = parse_mechanism(quadruped()).joints["FL_hip_joint"]
    assert continuous.limits == () and continuous.effort_limit == 23.7


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_limits_without_a_range_between_them_mean_none_as_in_bullet_and_gazebo(kind):
    mechanism = pair(kind, '<axis xyz="0 0 1"/>\n<limit lower="1" upper="-1" effort="2" velocity="1"/>')
    joint = mechanism.joints["j"]
    assert joint.limits == () and joint.effort_limit == 2.0
    assert any(re.search(r"limits without a range .* unlimited.*joint\[j\]", note) for note in mechanism.source.notes)


@pytest.mark.parametrize(("upper", "said"), [("109", True), ("6.2832", False), ("1e9", False)])
def test_limits_that_look_like_degrees_are_remarked(upper, said):
    mechanism = pair("revolute", f'<axis xyz="0 0 1"/><limit lower="0" upper="{upper}" effort="1" velocity="1"/>')
    assert any("look like degrees" in note for note in mechanism.source.notes) == said


@pytest.mark.parametrize(
    ("kind", "type_"),
    [
        ("fixed", "fixed"),
        ("revolute", "revolute"),
        ("continuous", "revolute"),
        ("prismatic", "prismatic"),
        ("planar", "planar"),
        ("floating", "free"),
    ],
)
def test_joint_types(kind, type_):
    mechanism = pair(kind, '<axis xyz="0 3 4"/><limit lower="0" upper="1" effort="1" velocity="1"/>')
    found = mechanism.joints["j"]
    assert (found.type, found.parent, found.child) == (type_, "a", "b")
    if kind not in ("fixed", "floating"):
        assert found.axis == pytest.approx([0, 0.6, 0.8])


def test_the_axis_is_x_where_none_is_given():
    assert pair("continuous").joints["j"].axis.tolist() == [1, 0, 0]


def test_a_planar_joint_moves_on_the_plane_across_its_axis():
    simulation = Simulation(pair("planar", '<origin xyz="1 2 3"/><axis xyz="0 0 1"/>'))
    simulation.reset(q=[0.5, 0.25, 0.1])
    assert simulation.poses()["b"].position == pytest.approx([1.5, 2.25, 3.0])


def test_a_mimic_couples_two_joints():
    text = robot(
        link("a"),
        link("b"),
        link("c"),
        joint("j", "continuous"),
        joint("k", "prismatic", '<mimic joint="j" multiplier="-0.5" offset="0.2"/>', child="c"),
    )
    simulation = Simulation.from_text(text)
    simulation.set_efforts({"j": 3.0})
    simulation.run(until=0.2)
    turn, slide = simulation.q
    assert abs(turn) > 0.01 and slide == pytest.approx(-0.5 * turn + 0.2, abs=1e-12)


def test_an_inertia_is_turned_into_the_axes_of_its_link():
    turned = '<inertial><origin xyz="0 1 0" rpy="0 0 1.5707963267948966"/><mass value="1"/>'
    turned += '<inertia ixx="1" iyy="2" izz="2.5" ixy="0.1" ixz="0" iyz="0"/></inertial>'
    part = parse_mechanism(robot(f'<link name="a">{turned}</link>')).parts["a"]
    assert part.center.tolist() == [0, 1, 0]
    assert part.inertia == pytest.approx(np.array([[2, -0.1, 0], [-0.1, 1, 0], [0, 0, 2.5]]), abs=1e-15)


def test_inertias_that_no_body_has_are_used_as_given_and_noted():
    bad = '<link name="b"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="3"/></inertial></link>'
    light = '<link name="c"><inertial><mass value="0"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>'
    text = robot(link("a"), bad, light, joint("j", "continuous"), joint("k", "fixed", parent="b", child="c"))
    mechanism = parse_mechanism(text)
    assert np.diag(mechanism.parts["b"].inertia).tolist() == [1, 1, 3]
    assert np.diag(mechanism.parts["c"].inertia).tolist() == [1, 1, 1]
    assert mechanism.source.notes == (
        "inertia that no rigid body can have, used as given: link[b]",
        "inertia without mass, used as given: link[c]",
    )
    assert (
        parse_mechanism(mechanism_text(mechanism.source)).parts["b"].inertia.tolist()
        == mechanism.parts["b"].inertia.tolist()
    )


def test_unread_attributes_and_elements_are_listed_at_any_depth():
    inside = """<visual><geometry><box size="1 1 1" shell="1"/></geometry>
<material name="m"><color rgba="1 0 0 1"/><texture filename="t.png"/></material></visual>"""
    hinge = """<joint name="j" type="planar"><parent link="a"/><child link="b"/>
<axis xyz="0 0 1"/><limit effort="1" velocity="1" acceleration="3"/><hardware/></joint>"""
    notes = parse_mechanism(robot(f'<link name="a" color="red">{inside}</link>', link("b"), hinge)).source.notes
    found = " ".join(notes)
    for note in (
        "color of <link>: link[a] (line ",
        "shell of <box>: link[a].visual.geometry.box (line ",
        "<texture> of <material>: link[a].visual.material[m] (line ",
        "acceleration of <limit>: joint[j].limit (line ",
        "<hardware> of <joint>: joint[j] (line ",
        "<limit> of planar joints: joint[j]",
    ):
        assert note in found


def test_shapes_and_colors():
    inside = """
      <visual><origin xyz="1 0 0" rpy="0 0 0.5"/><geometry><box size="1 2 3"/></geometry><material name="red"/></visual>
      <visual><geometry><cylinder radius="1" length="2"/></geometry></visual>
      <visual><geometry><sphere radius="0.5"/></geometry><material name="x"><color rgba="0 0.5 1 1"/></material></visual>
      <visual><origin xyz="0 1 0"/><geometry><mesh filename="package://x/y.stl" scale="1 2 3"/></geometry></visual>
      <visual><geometry><box size="0 0 0"/></geometry></visual>
      <collision><geometry><box size="9 9 9"/></geometry></collision>"""
    material = '<material name="red"><color rgba="1 0 0 0.5"/></material>'
    mechanism = parse_mechanism(robot(material, link("a", inside)))
    shapes = mechanism.parts["a"].shapes
    assert [(shape.kind, shape.size, shape.color) for shape in shapes] == [
        ("block", (1, 2, 3), "#ff0000"),
        ("cylinder", (2, 1), None),
        ("sphere", (0.5,), "#0080ff"),
    ]
    assert shapes[0].pose.position.tolist() == [1, 0, 0] and mechanism.parts["a"].mass == 2.0
    (mesh,) = mechanism.parts["a"].meshes
    assert (mesh.file, mesh.scale) == ("package://x/y.stl", (1, 2, 3)) and mesh.pose.position.tolist() == [0, 1, 0]
    assert len(mechanism.source.notes) == 2


def test_collision_shapes_are_drawn_where_the_visual_ones_are_meshes():
    inside = '<visual><geometry><mesh filename="x"/></geometry></visual><collision><geometry><sphere radius="1"/></geometry></collision>'
    assert [shape.kind for shape in parse_mechanism(robot(link("a", inside))).parts["a"].shapes] == ["sphere"]


def test_a_massless_root_named_world_is_ground():
    text = robot('<link name="world"/>', link("a"), joint("j", "floating", '<origin xyz="0 0 2"/>', "world", "a"))
    mechanism = parse_mechanism(text)
    assert mechanism.joints["j"].parent == "ground" and list(mechanism.parts) == ["a"]
    assert mechanism.ground_points["j"].position.tolist() == [0, 0, 2]
    with pytest.raises(MechanismError, match="stands for ground"):
        parse_mechanism(text, base="free")


def test_names_are_kept_unless_they_cannot_be_names():
    text = robot(
        link("left-foot.1"),
        link("left_foot.1"),
        link("ground"),
        link("tip{1}"),
        joint("tip", "continuous", parent="left-foot.1", child="tip{1}"),
        joint("1st joint", "continuous", parent="left-foot.1", child="left_foot.1"),
        joint("base", "continuous", parent="left_foot.1", child="ground"),
        name="my robot",
    )
    mechanism = parse_mechanism(text)
    assert mechanism.name == "my robot"
    assert list(mechanism.parts) == ["left-foot.1", "left_foot.1", "link_ground", "tip_1_"]
    assert list(mechanism.joints) == ["base_2", "tip", "1st joint", "base"]
    assert "ground → link_ground, tip{1} → tip_1_" in mechanism.source.notes[0]


def test_what_is_not_the_robot_is_noted():
    text = robot(link("a"), '<transmission name="t1"/>', '<gazebo reference="a"/>', "<gazebo/>")
    assert parse_mechanism(text).source.notes == ("<transmission>: t1", "<gazebo>: a, without a name")


BROKEN = """<robot name="broken">
  <link name="a">
    <inertial>
      <mass value="two"/>
      <inertia ixx="1" iyy="1"/>
    </inertial>
    <visual><origin xyz="0 1"/><geometry><box size="1 2 ${z}"/></geometry></visual>
  </link>
  <link name="b"/>
  <link name="b"/>
  <joint name="hinge" type="hinge">
    <parent link="a"/><child link="c"/>
  </joint>
  <joint name="slide" type="prismatic">
    <parent link="a"/><child link="b"/>
    <axis xyz="0 0 0"/>
    <limit lower="-1" upper="1" effort="-2"/>
    <dynamics damping="-1"/>
    <mimic joint="hing"/>
  </joint>
</robot>"""


def test_all_problems_are_reported_with_line_element_value_and_remedy():
    found = problems_of(BROKEN)
    assert found == [
        "r.urdf:4: link[a].inertial.mass.value: 'two' is not a number (got 'two'). Write plain numbers.",
        "r.urdf:5: link[a].inertial.inertia: 'izz' is missing. Add it.",
        "r.urdf:7: link[a].visual.origin.xyz: has 2 numbers (got '0 1'). Write 3 numbers separated by spaces.",
        "r.urdf:7: link[a].visual.box.size: '${z}' is not a number (got '1 2 ${z}'). "
        "This is a xacro expression: name the file .urdf.xacro, so that it is expanded.",
        "r.urdf:10: link[b]: is given twice, first on line 9. Rename one of them.",
        "r.urdf:12: joint[hinge].child.link: there is no link 'c'. Valid: a, b.",
        "r.urdf:16: joint[slide].axis.xyz: must not be zero (got '0 0 0'). Write for example 0 0 1.",
        "r.urdf:17: joint[slide].limit.effort: must not be negative (got '-2'). Write its size.",
        "r.urdf:18: joint[slide].dynamics.damping: must not be negative (got '-1'). Write its size.",
        "r.urdf:19: joint[slide].mimic.joint: there is no joint 'hing'. Did you mean 'hinge'?",
    ]


@pytest.mark.parametrize(
    ("elements", "expected"),
    [
        ([link("a"), '<link name="b"/>'], "link[b]: the robot is not connected: 2 links have no parent (a, b)."),
        (
            [link("a"), link("b"), joint("j", "fixed"), joint("k", "fixed", parent="b", child="a")],
            "link[a]: the links form a loop: a, b.",
        ),
        (
            [link("a"), link("b"), link("c"), joint("j", "fixed"), joint("k", "fixed", parent="c", child="b")],
            "joint[k].child.link: the link 'b' is already the child of joint 'j'.",
        ),
        ([link("a"), link("b"), '<joint name="j" type="fixed"/>'], "joint[j]: <parent link=…> is missing. Add it."),
        (["<link/>", link("a")], "link: 'name' is missing. Add it."),
        (['<link name="a"><inertial/></link>'], "link[a].inertial: <mass> is missing."),
        (['<link name="a"><visual/></link>'], "link[a].visual: has no shape in its <geometry>."),
        ([link("a"), link("b"), joint("j", "hinge")], "joint[j].type: unknown type 'hinge'."),
        ([link("a"), link("b"), joint("j", "floating", '<mimic joint="j"/>')], "joint[j].mimic.joint: a joint cannot mimic"),
        (
            [link("a"), link("b"), link("c"), joint("i", "revolute"), joint("j", "revolute", '<mimic joint="i" multiplier="0"/>', child="c")],
            "joint[j].mimic.multiplier: is 0, so this joint does not follow the other one",
        ),
        (['<link name="a"><inertial><mass value="1e50"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>'],
         "link[a].inertial.mass: is 1e+50, too large to compute with"),
    ],
)  # fmt: skip
def test_problems(elements, expected):
    assert any(expected in problem for problem in problems_of(robot(*elements)))


def test_problems_of_the_mechanism_have_the_line_of_the_urdf():
    text = robot(link("a"), '<link name="b"/>', joint("j", "continuous"))
    with pytest.raises(
        NoInertiaError, match=r"^r.urdf:4: joint\[j\]: nothing that this joint moves has mass: 'b' is a"
    ):
        derive(parse_mechanism(text, "r.urdf"))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("<robot><link></robot>", "r.urdf:1: not valid XML: mismatched tag"),
        ("<robot>\n<link name='a' name='b'/></robot>", "r.urdf:2: not valid XML: duplicate attribute"),
        ("<sdf/>", "has no <link>"),
        ("<mujoco/>", "has no <body>"),
        ("<html/>", "this is not URDF"),
        ("<robot/>", "robot: has no <link>"),
        (
            '<robot xmlns:y="x">\n<xacro:macro name="a"/></robot>',
            "r.urdf:2: ",
        ),
        ("<robot>" + "<a>" * 300 + "</a>" * 300 + "</robot>", "nested deeper than 200 levels"),
        ("<robot>" + "<a/>" * 100_001 + "</robot>", "more than 60000 values"),
        ("<robot>" + " " * 1_000_001 + "</robot>", "longer than 1000000 characters"),
        ("<robot name='\ud800'/>", "U+D800 is not allowed"),
    ],
    ids=range(11),
)
def test_what_is_not_a_urdf_is_refused(text, expected):
    assert expected in problem_of(text)


@pytest.mark.parametrize(
    "inside",
    [
        '<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">',
        '<!ENTITY a SYSTEM "file:///etc/passwd">',
        '<!ENTITY % a SYSTEM "http://localhost/x">%a;',
    ],
)
def test_entities_are_refused(inside):
    text = f'<?xml version="1.0"?>\n<!DOCTYPE robot [{inside}]>\n<robot name="&a;"><link name="a"/></robot>'
    assert problem_of(text) == (
        "r.urdf:2: DOCTYPE: a document type declaration is not allowed (got 'robot'). "
        "Remove it, and the entities that it declares."
    )


def test_damaged_files_are_answered_with_a_mechanism_error():
    rng, whole = np.random.default_rng(4), arm()
    for _ in range(40):
        start, length = rng.integers(len(whole)), rng.integers(1, 40)
        put = str(rng.choice(["", "-1", "x", "<link/>", '"', "nan", "1e99", "link1"]))
        try:
            parse_mechanism(whole[:start] + put + whole[start + length :])
        except MechanismError as error:
            assert str(error)


def test_convert_prints_a_mechanism_file_that_loads(tmp_path, capsys):
    path = tmp_path / "four.urdf"
    path.write_text(quadruped())
    assert main(["convert", str(path), "--base", "free"]) == 0
    text = capsys.readouterr().out
    assert text.startswith("# From four.urdf.\nmechanism: four_legs\n")
    assert parse_mechanism(text).joints["base"].type == "free"
    assert main(["convert", "double_rod", "--base", "free"]) == 1
    assert "'base' needs a URDF" in capsys.readouterr().err


def test_check_tells_what_was_left_out(tmp_path, capsys):
    path = tmp_path / "arm.urdf"
    path.write_text(arm())
    assert main(["check", str(path), "--json"]) == 0
    remarks = json.loads(capsys.readouterr().out)["remarks"]
    assert any(
        remark.startswith("from the URDF, meshes, drawn and passed on to exported URDF: link[link1]")
        for remark in remarks
    )
